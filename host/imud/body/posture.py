# SPDX-License-Identifier: MIT
"""Joint angles with their errors, and where the joints are.

Angles follow Grood and Suntay: flexion about z of the parent, rotation about y of the
child, abduction about the axis across both (J. Biomech. Eng. 105:136, 1983).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.body import heading
from imud.body.chain import Chain, Joint, Side
from imud.body.mounting import Mount
from imud.body.tracks import Track
from imud.rotation import FloatArray

# Soft tissue lets a probe turn by this against the bone, rms of an axis.
WOBBLE = math.radians(1.3)


@dataclass(frozen=True, slots=True)
class Posture:
    """A body over time; NaN where a segment is missing.

    `quats`: world_from_segment by segment, headings in step with the root's. `angles`:
    flexion, abduction, internal rotation, rad, (n, 3) by child; `sigmas` their errors.
    """

    times_s: FloatArray
    quats: Mapping[str, FloatArray]
    angles: Mapping[str, FloatArray]
    sigmas: Mapping[str, FloatArray]


def of(
    chain: Chain, tracks: Mapping[str, Track], mounts: Mapping[str, Mount]
) -> Posture:
    """The posture from tracks of the same times, by segment."""
    times_s = next(iter(tracks.values())).times_s
    quats, turned = {}, {}
    angles: dict[str, FloatArray] = {}
    sigmas: dict[str, FloatArray] = {}
    for segment in chain.segments:
        name = segment.name
        track, mount = tracks.get(name), mounts.get(name)
        if track is None or mount is None:
            quats[name] = np.full((len(times_s), 4), np.nan)
            turned[name] = np.zeros(len(times_s))
            continue
        own = rotation.multiply(track.quat, mount.probe_from_segment)
        above = segment.parent
        if above is None or above not in tracks or above not in mounts:
            quats[name], turned[name] = own, np.zeros(len(times_s))
            continue
        stated = np.stack([tracks[above].heading_sigma, track.heading_sigma], axis=1)
        parent = quats[above]
        # Headings are compared as the probes state them.
        bare = rotation.multiply(heading.about_up(-turned[above]), parent)
        turn, off = heading.in_step(segment.joint, times_s, bare, own, stated)
        turned[name] = np.nan_to_num(turn) + turned[above]
        quats[name] = rotation.multiply(heading.about_up(turned[name]), own)
        quats[name][~np.isfinite(turn)] = np.nan
        tilts = np.hypot(tracks[above].tilt_sigma, track.tilt_sigma)
        angles[name] = joint_angles(parent, quats[name], segment.joint, chain.side)
        sigmas[name] = errors(
            parent, quats[name], tilts, off, (mounts[above], mounts[name])
        )
    return Posture(times_s, quats, angles, sigmas)


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


def errors(
    parent: FloatArray,
    child: FloatArray,
    tilt: FloatArray,
    turn: FloatArray,
    mounts: tuple[Mount, Mount],
) -> FloatArray:
    """One sigma of the three angles, rad, (n, 3).

    `tilt`: of both probes' levels together; `turn`: of the heading between them.
    """
    z = np.array([0.0, 0.0, 1.0])
    y = np.array([0.0, 1.0, 0.0])
    flexing, turning = rotation.rotate(parent, z), rotation.rotate(child, y)
    across = np.cross(turning, flexing)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-3)
    axes = np.stack([flexing, across, turning], axis=2)
    back = np.linalg.pinv(np.nan_to_num(axes), rcond=0.05)
    level = np.stack([tilt, tilt, turn], axis=1) ** 2
    variance = np.einsum("nij,nj->ni", back**2, np.nan_to_num(level))
    # A mount is wrong about its segment's axes: y by facing, x and z by posture.
    for quat, mount in zip((parent, child), mounts, strict=True):
        own = np.array([mount.up_sigma, mount.facing_sigma, mount.up_sigma]) ** 2
        into = back @ np.nan_to_num(rotation.to_matrix(quat))
        # The heading in step takes up what a wrong facing does while standing.
        own[1] *= 0.25
        variance += np.einsum("nij,j->ni", into**2, own)
        variance += np.einsum("nij,j->ni", into**2, np.full(3, WOBBLE**2))
    found = np.sqrt(variance)
    found[~np.isfinite(parent).all(axis=1) | ~np.isfinite(child).all(axis=1)] = np.nan
    return np.asarray(found)


def places(chain: Chain, quats: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Where segments start and their marks are: "knee.start", "foot.toe" in m from the
    root's start, world axes, (n, 3).
    """
    found: dict[str, FloatArray] = {}
    for segment in chain.segments:
        quat = quats[segment.name]
        start = np.zeros((len(quat), 3))
        if segment.parent is not None:
            start = found[f"{segment.parent}.{segment.at}"]
        found[f"{segment.name}.start"] = start
        for mark, place in segment.marks.items():
            found[f"{segment.name}.{mark}"] = start + rotation.rotate(quat, place)
    return found
