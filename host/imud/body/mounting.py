# SPDX-License-Identifier: MIT
"""How each probe sits on its segment: from standing still, and from a motion.

Standing gives the direction of up (y) in each probe. Ahead (x) comes from where the
person faces, or from the hinge axis that a motion shows, which needs no heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.body import hinge
from imud.body.chain import Chain
from imud.body.hinge import AlignmentRefused, HingeAxis
from imud.body.tracks import Track, turning
from imud.rotation import FloatArray

UP = np.array([0.0, 0.0, 1.0])
WALKS_M_S2 = 3.0  # change of force; squats have 1, walking 10
STILL_RAD_S = math.radians(12.0)  # rms of a person who stands still
STANDING_S = 1.0  # at least
SWAPPED = 0.85  # a child's force changes by less than this share of its parent's
POSTURE = math.radians(1.5)  # of how straight people stand
FACING = math.radians(8.0)  # of the direction that they face


ALIKE_MIN = 0.3  # correlation of the pushes of two neighbours
UPSIDE_DOWN = -0.8  # of up along a probe's own axis
UPRIGHT_MAX = 0.3  # of an axis across up, a share

_Right = tuple[FloatArray, float]  # a direction in a probe, and its sigma in rad


@dataclass(frozen=True, slots=True)
class Mount:
    """One probe on its segment.

    `up_sigma`: of y about the horizontal axes; `facing_sigma`: of x about y; rad.
    """

    probe_from_segment: FloatArray
    up_sigma: float
    facing_sigma: float
    method: str  # "pose" or "motion"


@dataclass(frozen=True, slots=True)
class Aligned:
    """The result of an alignment: mounts by segment, hinges, remarks for people."""

    mounts: Mapping[str, Mount]
    axes: Mapping[str, HingeAxis]
    remarks: tuple[str, ...]


def by_pose(chain: Chain, standing: Mapping[str, Track], facing_rad: float) -> Aligned:
    """From standing straight and still, all segments upright, facing `facing_rad`
    (counterclockwise from east). `standing`: tracks by segment.
    Raises AlignmentRefused.
    """
    ahead = np.array([math.cos(facing_rad), math.sin(facing_rad), 0.0])
    mounts = {}
    for segment in chain.segments:
        if segment.name not in standing or segment.joint.freedom:
            continue
        quat, heading_sigma = _stood(segment.name, standing[segment.name])
        up, x = (rotation.rotate(rotation.inverse(quat), each) for each in (UP, ahead))
        facing_sigma = math.hypot(FACING, heading_sigma)
        mounts[segment.name] = Mount(
            _frame(up, x, is_x=True), POSTURE, min(facing_sigma, math.pi), "pose"
        )
    return Aligned(mounts, {}, ())


def by_motion(
    chain: Chain,
    standing: Mapping[str, Track],
    moving: Mapping[str, Track],
    facing_rad: float | None = None,
    walking: Mapping[str, Track] | None = None,
) -> Aligned:
    """From standing still, then a motion that bends every hinge.

    `walking` distinguishes left from right where `moving` alone does not. Segments
    without a hinge take ahead from `facing_rad`, which may be None if there are none.
    `moving` has the same times for all. Raises AlignmentRefused.
    """
    axes: dict[str, HingeAxis] = {}
    for parent, child in chain.joints():
        if child.joint.is_hinge and parent.name in moving and child.name in moving:
            one, other = moving[parent.name], moving[child.name]
            good = np.isfinite(one.gyr).all(axis=1) & np.isfinite(other.gyr).all(axis=1)
            if good.sum() < hinge.ROWS_MIN:
                raise AlignmentRefused(
                    f"{parent.name} and {child.name}: no motion to align by"
                )
            rate_hz = 1.0 / float(np.median(np.diff(one.times_s)))
            try:
                axes[child.name] = hinge.axis(one.gyr[good], other.gyr[good], rate_hz)
            except AlignmentRefused as refused:
                raise AlignmentRefused(
                    f"{parent.name} and {child.name}: {refused}"
                ) from None
    rights = _rights(chain, axes, standing, (moving, walking or moving))
    plain = None
    if facing_rad is not None:
        plain = by_pose(chain, standing, facing_rad).mounts
    mounts: dict[str, Mount] = {}
    for segment in chain.segments:
        name = segment.name
        if name not in standing or segment.joint.freedom:
            continue
        if name in rights:
            quat, _ = _stood(name, standing[name])
            up = rotation.rotate(rotation.inverse(quat), UP)
            axis, sigma = _mean_right(up, rights[name])
            mounts[name] = Mount(_frame(up, axis, is_x=False), POSTURE, sigma, "motion")
        elif plain is not None:
            mounts[name] = plain[name]
        else:
            raise AlignmentRefused(f"{name} has no hinge; give the facing direction")
    return Aligned(mounts, axes, _remarks(mounts))


def _stood(name: str, track: Track) -> tuple[FloatArray, float]:
    """The mean attitude of a probe while it stands, and its heading's sigma."""
    good = np.isfinite(track.quat).all(axis=1)
    times, quat = track.times_s[good], track.quat[good]
    if len(times) < 2 or times[-1] - times[0] < STANDING_S:
        raise AlignmentRefused(f"{name}: no pose to align by; stand still for 3 s")
    moved = float(np.sqrt((turning(track)[good] ** 2).mean()))
    if moved > STILL_RAD_S:
        raise AlignmentRefused(
            f"{name} moved at {math.degrees(moved):.0f} deg/s; stand still for 3 s"
        )
    mean = np.linalg.eigh(quat.T @ quat)[1][:, -1]
    sigma = track.heading_sigma[good]
    known = sigma[np.isfinite(sigma)]
    return mean, float(known.mean()) if len(known) else math.pi


def _frame(up: FloatArray, other: FloatArray, *, is_x: bool) -> FloatArray:
    """probe_from_segment with y along `up`; x or z as near to `other` as can be."""
    y = up / np.linalg.norm(up)
    flat = other - y * (other @ y)
    flat = flat / np.linalg.norm(flat)
    x, z = (flat, np.cross(flat, y)) if is_x else (np.cross(y, flat), flat)
    return rotation.from_matrix(np.stack([x, y, z], axis=1))


def _rights(
    chain: Chain,
    axes: Mapping[str, HingeAxis],
    standing: Mapping[str, Track],
    motions: tuple[Mapping[str, Track], Mapping[str, Track]],
) -> dict[str, list[_Right]]:
    """The directions to the right in each probe that the hinges beside it show."""
    moving, walking = motions
    found: dict[str, list[_Right]] = {}
    for parent, child in chain.joints():
        hinge_axis = axes.get(child.name)
        if hinge_axis is None:
            continue
        first, second = hinge_axis.parent, hinge_axis.child
        stood = standing[parent.name], standing[child.name]
        moved = walking[parent.name], walking[child.name]
        if not _agree((first, second), stood, moved):
            second = -second
        if parent.name in found:
            # The joint above has shown where right is.
            is_left = float(first @ found[parent.name][0][0]) < 0.0
        elif child.joint.bends:
            turned = _turned(first, second, moving[parent.name], moving[child.name])
            is_left = turned * child.joint.flexion * child.joint.bends < 0.0
        else:
            raise AlignmentRefused(
                f"{child.name}: no joint above shows the direction in which it bends"
            )
        if is_left:
            first, second = -first, -second
        # A joint's play tilts the axis that its motion shows.
        sigma = math.hypot(hinge_axis.sigma_rad, math.radians(child.joint.play_deg))
        found.setdefault(parent.name, []).append((first, sigma))
        found.setdefault(child.name, []).append((second, sigma))
    return found


def _mean_right(up: FloatArray, rights: list[_Right]) -> _Right:
    """The mean of several directions to the right across `up`, each with its weight."""
    total, weights = np.zeros(3), 0.0
    for axis, sigma in rights:
        flat = axis - up * (axis @ up)
        size = float(np.linalg.norm(flat))
        if size < UPRIGHT_MAX:
            raise AlignmentRefused(
                "the axis found is almost vertical; stand up straight and bend again"
            )
        total = total + flat / (size * sigma**2)
        weights += sigma**-2
    return total, weights**-0.5


def _agree(
    axes: tuple[FloatArray, FloatArray],
    stood: tuple[Track, Track],
    moved: tuple[Track, Track],
) -> bool:
    """Whether two axes point to the same side.

    Forces show it, as neighbours are pushed ahead together; without them, or where they
    do not decide, the headings of both probes.
    """
    pushes = [_ahead(axis, each) for axis, each in zip(axes, moved, strict=True)]
    if pushes[0] is not None and pushes[1] is not None:
        good = np.isfinite(pushes[0]) & np.isfinite(pushes[1])
        alike = float(np.corrcoef(pushes[0][good], pushes[1][good])[0, 1])
        if abs(alike) > ALIKE_MIN:
            return alike > 0.0
    in_world = []
    for axis, track in zip(axes, stood, strict=True):
        quat, _ = _stood("a segment", track)
        in_world.append(rotation.rotate(quat, axis)[:2])
    return bool(in_world[0] @ in_world[1] >= 0.0)


def _ahead(right: FloatArray, track: Track) -> FloatArray | None:
    """The level force across an axis that points to the right, m/s2, over time."""
    if track.acc is None:
        return None
    east, north, _ = rotation.rotate(track.quat, track.acc).T
    x, y, _ = rotation.rotate(track.quat, right).T
    return np.asarray((north * x - east * y) / np.hypot(x, y))


def _turned(first: FloatArray, second: FloatArray, one: Track, other: Track) -> float:
    """The mean turn of the child about the axis since the motion began, rad."""
    rate = np.nan_to_num(other.gyr @ second - one.gyr @ first)
    step = np.diff(one.times_s, prepend=one.times_s[0])
    return float(np.cumsum(rate * step).mean())


def check_order(chain: Chain, moving: Mapping[str, Track]) -> None:
    """Raises AlignmentRefused if a probe moves like one further up: two were swapped.

    While a limb swings or walks, the specific force changes more towards its end; in a
    squat it does not.
    """
    for parent, child in chain.joints():
        one, other = moving.get(parent.name), moving.get(child.name)
        if one is None or other is None or one.acc is None or other.acc is None:
            continue
        upper, lower = _change(one.acc), _change(other.acc)
        if upper > 0.5 and lower < SWAPPED * upper:
            raise AlignmentRefused(
                f"{child.probe} on {child.name} moves less than {parent.probe} on "
                f"{parent.name}; are the two swapped?"
            )


def is_walking(moving: Mapping[str, Track]) -> bool:
    """Whether each probe is pushed in each quarter of the time as in walking."""
    quarters = [
        part
        for track in moving.values()
        if track.acc is not None
        for part in np.array_split(track.acc, 4)
    ]
    return bool(quarters) and min(map(_change, quarters)) > WALKS_M_S2


def _change(acc: FloatArray) -> float:
    """By how much the specific force changes, without its peaks; m/s2."""
    size = np.linalg.norm(acc, axis=1)
    if not np.isfinite(size).any():
        return 0.0
    low, high = np.nanpercentile(size, (10.0, 90.0))
    return float(high - low)


def _remarks(mounts: Mapping[str, Mount]) -> tuple[str, ...]:
    """Remarks on how the probes are attached."""
    return tuple(
        f"the probe on {name} is upside down; the alignment allows for it"
        for name, mount in mounts.items()
        if rotation.to_matrix(mount.probe_from_segment)[:, 1].min() < UPSIDE_DOWN
    )
