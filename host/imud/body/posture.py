# SPDX-License-Identifier: MIT
"""Joint angles with their errors, and where the joints are.

angles.py defines the angles, heading.py brings the headings of probes into step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.body import angles, heading
from imud.body.chain import Chain, Joint, Side
from imud.body.heading import HeadingFilter
from imud.body.joints import JointModel
from imud.body.mounting import Mount
from imud.body.tracks import Track
from imud.rotation import FloatArray

# Soft tissue lets a probe turn by this against the bone, rms of an axis.
WOBBLE = math.radians(1.3)
# Only turns across its axis show how loose the probes of a joint sit, and the axis that
# is found takes up some of them: those about it are so much larger.
HIDDEN = 1.3
# Headings in step compensate most of a wrong facing while a person stands.
FACING_SHARE = 0.25
# An angle whose error is larger than this is not stated.
WITHHELD = math.radians(30.0)


@dataclass(frozen=True, slots=True)
class Posture:
    """A body over time; NaN where a segment is missing.

    `quats`: world_from_segment by segment, headings in step with the root's. `angles`:
    those that the joint names, rad, (n, k) by child; `sigmas` their errors.
    """

    times_s: FloatArray
    quats: dict[str, FloatArray]
    angles: dict[str, FloatArray]
    sigmas: dict[str, FloatArray]


def of(
    chain: Chain,
    tracks: Mapping[str, Track],
    mounts: Mapping[str, Mount],
    known: Mapping[str, JointModel] | None = None,
    steps: dict[str, HeadingFilter] | None = None,
) -> Posture:
    """The posture from tracks of the same times, by segment. `known`: joints of which
    motion has shown the axes, by child.

    Headings are known from the whole recording; with `steps`, which begin empty and are
    kept from call to call, only from the past.
    """
    times_s = next(iter(tracks.values())).times_s
    found = Posture(times_s, {}, {}, {})
    turned: dict[str, FloatArray] = {}
    seen = known or {}
    loose = _loose(seen)
    for segment in chain.segments:
        name, above = segment.name, segment.parent
        track, mount = tracks.get(name), mounts.get(name)
        turned[name] = np.zeros(len(times_s))
        if track is None or mount is None:
            found.quats[name] = np.full((len(times_s), 4), np.nan)
            continue
        own = rotation.multiply(track.quat, mount.probe_from_segment)
        if above is None or above not in tracks or above not in mounts:
            found.quats[name] = own
            continue
        beside = mounts[above], mount
        joint = seen.get(name) or _upright(segment.joint, beside)
        turn, off = _turn(joint, (tracks[above], track), steps, name)
        turned[name] = np.nan_to_num(turn) + turned[above]
        quat = rotation.multiply(heading.about_up(turned[name]), own)
        quat[~np.isfinite(turn)] = np.nan
        found.quats[name] = quat
        both = found.quats[above], quat
        axes = axes_of(joint, beside)
        found.angles[name] = angles_of(joint, both, axes, chain.side)
        tilts = np.hypot(tracks[above].tilt_sigma, track.tilt_sigma)
        wobble = WOBBLE
        if joint.joint.freedom and loose:
            # A measurement of one axis by two probes contains the errors of their
            # levels.
            play = math.sqrt((joint.play**2 + loose**2) / 2.0) if joint.play else loose
            wobble = HIDDEN * play / math.sqrt(2.0)
            tilts = np.zeros(len(times_s))
        found.sigmas[name] = angles.errors(
            angles.turning_axes(joint.joint, *both, axes),
            both,
            (tilts, off),
            beside,
            wobble,
            1.0 if joint.joint.freedom else FACING_SHARE,
        )
        if joint.joint.freedom:
            is_unknown = found.sigmas[name] > WITHHELD
            found.angles[name][is_unknown] = found.sigmas[name][is_unknown] = np.nan
    return found


def _loose(known: Mapping[str, JointModel]) -> float:
    """How far the probes of a chain turn against their segments, as two of them show
    it: rms of all its joints, rad; 0 if none shows it.
    """
    plays = [each.play for each in known.values() if each.play > 0.0]
    return float(np.sqrt(np.mean(np.square(plays)))) if plays else 0.0


def _upright(joint: Joint, mounts: tuple[Mount, Mount]) -> JointModel:
    """A joint of the body: it turns mainly about z of both segments."""
    first, second = (rotation.rotate(m.probe_from_segment, angles.Z) for m in mounts)
    return JointModel(joint, (first, second), math.radians(joint.play_deg))


def _turn(
    joint: JointModel,
    both: tuple[Track, Track],
    steps: dict[str, HeadingFilter] | None,
    name: str,
) -> tuple[FloatArray, FloatArray]:
    """The turn of the child's heading, and its sigma."""
    if steps is None:
        return joint.turns(*both)
    is_there = np.isfinite(both[0].quat[:, 0]) & np.isfinite(both[1].quat[:, 0])
    step = steps.setdefault(name, HeadingFilter())
    return heading.follow(step, both[0].times_s, is_there, joint.sights(*both))


def axes_of(
    joint: JointModel, mounts: tuple[Mount, Mount]
) -> tuple[FloatArray, FloatArray] | None:
    """Its axes in the frames of the segments."""
    if joint.axes is None:
        return None
    first, second = (
        rotation.rotate(rotation.inverse(mount.probe_from_segment), axis)
        for mount, axis in zip(mounts, joint.axes, strict=True)
    )
    return first, second


def angles_of(
    joint: JointModel,
    quats: tuple[FloatArray, FloatArray],
    axes: tuple[FloatArray, FloatArray] | None,
    side: Side,
) -> FloatArray:
    """The angles of a joint between world_from_segment of both, rad, (n, k)."""
    parent, child = quats
    turn = rotation.multiply(rotation.inverse(parent), child)
    if joint.joint.freedom == 1 and axes is not None:
        return angles.hinge_angle(turn, axes[0])
    if joint.joint.freedom == 2 and axes is not None:
        return angles.universal_angles(turn, *axes)
    return angles.joint_angles(parent, child, joint.joint, side)


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
