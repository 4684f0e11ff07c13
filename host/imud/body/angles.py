# SPDX-License-Identifier: MIT
"""Joint angles of attitudes, and their errors by those of the attitudes.

Angles follow Grood and Suntay: flexion about z of the parent, rotation about y of the
child, abduction about the axis across both (J. Biomech. Eng. 105:136, 1983). Other
joints turn about axes that motion has shown.
"""

from __future__ import annotations

import numpy as np

from imud import rotation
from imud.body.chain import Joint, Side
from imud.body.mounting import Mount
from imud.rotation import FloatArray

X, Y, Z = np.eye(3)
FLAT = (
    0.05  # of axes that lie so nearly in a plane that their angles are not told apart
)


def joint_angles(
    parent: FloatArray, child: FloatArray, joint: Joint, side: Side
) -> FloatArray:
    """Flexion, abduction and internal rotation, rad, (n, 3), of world_from_segment."""
    turn = rotation.to_matrix(rotation.multiply(rotation.inverse(parent), child))
    flexion = np.arctan2(-turn[..., 0, 1], turn[..., 1, 1])
    adduction = np.arcsin(np.clip(turn[..., 2, 1], -1.0, 1.0))
    internal = np.arctan2(-turn[..., 2, 0], turn[..., 2, 2])
    out = -1.0 if side == "right" else 1.0
    return np.stack([joint.flexion * flexion, out * adduction, -out * internal], -1)


def from_angles(angles: FloatArray, joint: Joint, side: Side) -> FloatArray:
    """parent_from_child of the angles that joint_angles() gives."""
    out = -1.0 if side == "right" else 1.0
    signs = np.array([joint.flexion, out, -out])
    flexion, adduction, internal = np.moveaxis(angles * signs, -1, 0)
    none = np.zeros_like(flexion)
    turns = (
        np.stack([none, none, flexion], -1),
        np.stack([adduction, none, none], -1),
        np.stack([none, internal, none], -1),
    )
    first, second, third = map(rotation.from_rotation_vector, turns)
    return rotation.multiply(first, rotation.multiply(second, third))


def about(axis: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """The angles about a unit axis by which `start` comes to `end`, rad, (n,)."""
    flat = [each - (each @ axis)[..., None] * axis for each in (start, end)]
    return np.asarray(
        np.arctan2(np.cross(flat[0], flat[1]) @ axis, (flat[0] * flat[1]).sum(-1))
    )


def hinge_angle(turn: FloatArray, axis: FloatArray) -> FloatArray:
    """Of parent_from_child (n, 4), about the axis, which both have: rad, (n, 1)."""
    angle = 2.0 * np.arctan2(turn[:, 1:] @ axis, turn[:, 0])
    return np.asarray((angle[:, None] + np.pi) % (2.0 * np.pi) - np.pi)


def universal_angles(
    turn: FloatArray, first: FloatArray, second: FloatArray
) -> FloatArray:
    """Of parent_from_child (n, 4): about the parent's axis, then the child's, both in
    the frame that the segments share when the angles are 0: rad, (n, 2).
    """
    swung = about(
        first, np.broadcast_to(second, (len(turn), 3)), rotation.rotate(turn, second)
    )
    back = rotation.rotate(rotation.inverse(turn), first)
    turned = about(second, back, np.broadcast_to(first, back.shape))
    return np.stack([swung, turned], axis=1)


def turning_axes(
    joint: Joint,
    parent: FloatArray,
    child: FloatArray,
    own: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """The axes of the angles in the world, (n, 3, k); `parent`, `child`:
    world_from_segment; `own`: the axes that motion showed, in the segments' frames.
    """
    if joint.freedom == 1 and own is not None:
        return rotation.rotate(parent, own[0])[..., None]
    if joint.freedom == 2 and own is not None:
        pair = rotation.rotate(parent, own[0]), rotation.rotate(child, own[1])
        return np.stack(pair, axis=2)
    flexing, turning = rotation.rotate(parent, Z), rotation.rotate(child, Y)
    across = np.cross(turning, flexing)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-3)
    return np.stack([flexing, across, turning], axis=2)


def errors(
    axes: FloatArray,
    quats: tuple[FloatArray, FloatArray],
    sigmas: tuple[FloatArray, FloatArray],
    mounts: tuple[Mount, Mount],
    wobble: float,
    facing_share: float = 1.0,
) -> FloatArray:
    """One sigma of angles about `axes` of the world (n, 3, k), rad, (n, k).

    `quats`: world_from_segment of both; `sigmas`: of both levels together, and of the
    heading between them, (n,); `wobble`: of each probe on its segment;
    `facing_share`: of the variance of a mount's facing that is left.
    """
    back = np.linalg.pinv(np.nan_to_num(axes), rcond=FLAT)
    tilt, turn = sigmas
    level = np.stack([tilt, tilt, turn], axis=1) ** 2
    variance = np.einsum("nij,nj->ni", back**2, np.nan_to_num(level))
    # A mount is wrong about its segment's axes: y by facing, x and z by posture.
    for quat, mount in zip(quats, mounts, strict=True):
        own = np.array([mount.up_sigma, mount.facing_sigma, mount.up_sigma]) ** 2
        into = back @ np.nan_to_num(rotation.to_matrix(quat))
        own[1] *= facing_share
        variance += np.einsum("nij,j->ni", into**2, own + wobble**2)
    found = np.sqrt(variance)
    is_missing = ~np.isfinite(quats[0][:, 0]) | ~np.isfinite(quats[1][:, 0])
    found[is_missing] = np.nan
    return np.asarray(found)
