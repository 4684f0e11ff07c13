# SPDX-License-Identifier: MIT
"""A whole recording of a body: it finds where the person stands still, aligns by what
follows, and computes posture and the paths of feet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from imud.body import contact, mounting, posture, tracks, zero
from imud.body.chain import Chain
from imud.body.contact import FootPath
from imud.body.hinge import AlignmentRefused
from imud.body.joints import JointModel
from imud.body.mounting import Mount
from imud.body.posture import Posture
from imud.body.tracks import BoolArray, Track, turning
from imud.rotation import FloatArray

RATE_HZ = 100.0
STILL_S = 1.5
MOTION_S = 5.0  # at least, of a motion that aligns
STILL_RAD_S = math.radians(10.0)
BEGIN_S = 0.5
# Angles about any axes are 0 in the end of the first rest, when filters have settled,
# but before it moves.
POSE_S, BEFORE_S = 1.5, 0.3


@dataclass(frozen=True, slots=True)
class BodyAnalysis:
    """Posture over time, paths of segments with `contact`, and remarks for people.
    `mounts` and `known`: how the probes sit, and joints about any axes, by child.
    """

    posture: Posture
    paths: Mapping[str, FootPath]
    mounts: Mapping[str, Mount]
    known: Mapping[str, JointModel]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Alignment:
    """How the probes sit, joints about any axes by child, remarks for people.

    `pose`: from and to, s, in which angles about any axes are 0. `upright`: the mounts
    without a zero. `on_motion`, `on_zeros`: remarks on the motion that aligns, and on
    zeros that no motion has shown.
    """

    mounts: Mapping[str, Mount]
    known: Mapping[str, JointModel]
    on_motion: tuple[str, ...]
    pose: tuple[float, float]
    upright: Mapping[str, Mount]
    on_zeros: tuple[str, ...] = ()

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*self.on_motion, *self.on_zeros)


def of(
    chain: Chain, by_probe: Mapping[str, Track], facing_rad: float | None = None
) -> BodyAnalysis:
    """All of a recording: standing, a motion that aligns, standing again, the rest.

    `facing_rad`: where the person faces while standing,
    counterclockwise from east; with None, hinges that bend show what is ahead.

    Raises AlignmentRefused, with a text for users.
    """
    given = {
        each.name: by_probe[each.probe]
        for each in chain.segments
        if each.probe is not None and each.probe in by_probe
    }
    if not given:
        raise AlignmentRefused("none of its probes has data")
    times_s = tracks.common_times(list(given.values()), RATE_HZ)
    if len(times_s) < RATE_HZ * STILL_S:
        raise AlignmentRefused("the recordings of its probes hardly overlap in time")
    found = {name: tracks.joined(each, times_s) for name, each in given.items()}
    known = aligned(chain, found, facing_rad)
    remarks = [
        f"{each.name}: {each.probe} has no data"
        for each in chain.segments
        if each.probe is not None and each.name not in given
    ]
    remarks += known.remarks
    paths = {
        each.name: contact.path(given[each.name])
        for each in chain.segments
        if each.is_contact and each.name in given and given[each.name].acc is not None
    }
    for name, path in paths.items():
        remarks += [f"{name}: {remark}" for remark in path.remarks]
    body = posture.of(chain, found, known.mounts, known.known)
    return BodyAnalysis(body, paths, known.mounts, known.known, tuple(remarks))


def aligned(
    chain: Chain, found: Mapping[str, Track], facing_rad: float | None
) -> Alignment:
    """By tracks of the same times, by segment. Raises AlignmentRefused."""
    mounts: dict[str, Mount] = {}
    if any(not child.joint.freedom for _, child in chain.joints()):
        stood, mounts, why = align(chain, found, facing_rad)
    else:
        stood, why = _begin(found)
    known = zero.learnt(
        chain, {n: t.between(stood[1], math.inf) for n, t in found.items()}
    )
    pose = max(stood[0], stood[1] - POSE_S), stood[1] - BEFORE_S
    begun = Alignment({}, known, tuple(why), pose, mounts)
    return zeroed(chain, begun, found, facing_rad)


def zeroed(
    chain: Chain,
    begun: Alignment,
    found: Mapping[str, Track],
    facing_rad: float | None,
) -> Alignment:
    """With the zeros that tracks show, which begin at the pose, as far as there are
    any.
    """
    mounts = zero.mounted(
        chain, found, begun.known, begun.pose, begun.upright, facing_rad
    )
    return replace(
        begun,
        mounts=mounts,
        known=zero.signed(begun.known, mounts, chain),
        on_zeros=tuple(zero.remarks(chain, mounts)),
    )


def _begin(found: Mapping[str, Track]) -> tuple[tuple[float, float], list[str]]:
    """The pose in which angles are 0, and remarks."""
    try:
        return standing(found)[0], []
    except AlignmentRefused:
        start_s = float(next(iter(found.values())).times_s[0])
        words = f"it never rests: angles are 0 at the mean of the first {BEGIN_S:g} s"
        return (start_s, start_s + BEGIN_S), [words]


def align(
    chain: Chain, found: Mapping[str, Track], facing_rad: float | None
) -> tuple[tuple[float, float], dict[str, Mount], list[str]]:
    """The mounts of a body that stands, moves to align, stands again; from and to of
    the first standing, s; remarks. Raises AlignmentRefused.
    """
    (begin_s, end_s), *later = standing(found)
    again_s = next((each[0] for each in later if each[0] > end_s + MOTION_S), math.inf)
    stood = {name: each.between(begin_s, end_s) for name, each in found.items()}
    moving = {name: each.between(end_s, again_s) for name, each in found.items()}
    walking = {name: each.between(end_s, math.inf) for name, each in found.items()}
    try:
        by_motion = mounting.by_motion(chain, stood, moving, facing_rad, walking)
        mounts, remarks = dict(by_motion.mounts), [*by_motion.remarks]
    except AlignmentRefused as refused:
        if facing_rad is None:
            raise
        blind = [n for n, t in stood.items() if np.isnan(t.heading_sigma).all()]
        if blind:
            raise AlignmentRefused(
                f"{refused}; the pose alone needs headings, and {blind[0]} has none"
            ) from refused
        mounts = dict(mounting.by_pose(chain, stood, facing_rad).mounts)
        remarks = [f"aligned by the pose alone: {refused}"]
    try:
        mounting.check_order(chain, walking)
    except AlignmentRefused as refused:
        remarks.append(str(refused))
    return (begin_s, end_s), mounts, remarks


def standing(found: Mapping[str, Track]) -> list[tuple[float, float]]:
    """Each STILL_S or more in which no probe leans: from and to, s. At least one."""
    times_s = next(iter(found.values())).times_s
    edges = np.diff(np.concatenate([[False], is_still(found), [False]]).astype(int))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    spans = [
        (float(times_s[start]), float(times_s[end]))
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
        if times_s[end] - times_s[start] >= STILL_S
    ]
    if not spans:
        raise AlignmentRefused(
            "no pose to align by: stand still for 3 s at the beginning"
        )
    return spans


def is_still(found: Mapping[str, Track]) -> BoolArray:
    """Whether no probe leans, at each moment."""
    fastest: FloatArray = np.max([turning(each) for each in found.values()], axis=0)
    return np.asarray(np.nan_to_num(fastest, nan=np.inf) < STILL_RAD_S)
