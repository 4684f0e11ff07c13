# SPDX-License-Identifier: MIT
"""Segments of joints about any axes: at the pose that a recording begins with they all
have the same frame, so that their angles are 0 there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from imud import rotation
from imud.body import heading, joints, posture
from imud.body.chain import Chain, Segment
from imud.body.hinge import AlignmentRefused
from imud.body.joints import JointModel
from imud.body.mounting import Mount
from imud.body.tracks import Track
from imud.rotation import FloatArray

LEVEL = math.radians(0.7)  # of a probe at rest
# y up and x east, as an upright segment stands that faces east.
UPRIGHT = rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))

Pose = tuple[float, float]  # from and to, s

KNOWN = math.radians(5.0)  # a better known zero needs no more motion


def learnt(chain: Chain, found: Mapping[str, Track]) -> dict[str, JointModel]:
    """The joints about any axes that motion shows, by child; or AlignmentRefused."""
    known = {}
    for parent, child in chain.joints():
        if child.joint.freedom and parent.name in found and child.name in found:
            try:
                known[child.name] = joints.learn(
                    child.joint, found[parent.name], found[child.name]
                )
            except AlignmentRefused as refused:
                raise AlignmentRefused(
                    f"{parent.name} and {child.name}: {refused}"
                ) from None
    return known


def mounted(
    chain: Chain,
    found: Mapping[str, Track],
    known: Mapping[str, JointModel],
    pose: Pose,
    mounts: Mapping[str, Mount],
    facing_rad: float | None,
) -> dict[str, Mount]:
    """With the mounts of all segments that `mounts` lacks, by the pose.

    `found`: tracks of the same times, of all the recording.
    """
    done = dict(mounts)
    stood: dict[str, FloatArray] = {}  # world_from_segment, in the root's heading
    turned: dict[str, float] = {}
    for segment in chain.segments:
        name, above = segment.name, segment.parent
        if name not in found:
            continue
        quat = mean(found[name], pose)
        turned[name], sigma = 0.0, 0.0
        if above in stood and name in known:
            rows = (found[name].times_s >= pose[0]) & (found[name].times_s < pose[1])
            turn, sigma = known[name].at_rest(found[above], found[name], rows)
            turned[name] = turned[above] + turn
            quat = rotation.multiply(heading.about_up(turned[name]), quat)
        if name in done:
            stood[name] = rotation.multiply(quat, done[name].probe_from_segment)
            continue
        if above in stood:
            stood[name] = stood[above]
        else:
            stood[name] = rotation.multiply(
                heading.about_up(facing_rad or 0.0), UPRIGHT
            )
        mount = rotation.multiply(rotation.inverse(quat), stood[name])
        done[name] = Mount(mount, LEVEL, sigma, "pose")
    return done


def remarks(chain: Chain, mounts: Mapping[str, Mount]) -> list[str]:
    """The angles without a zero, and the motion that would show it."""
    return [
        f"{child.name}: the zero of its {_what(child)} is unknown: turn the whole limb "
        f"until the axis between {parent.name} and {child.name} is level for a few "
        "seconds, or use magnetometers"
        for parent, child in _unsure(chain, mounts, posture.WITHHELD)
    ]


def is_open(chain: Chain, mounts: Mapping[str, Mount]) -> bool:
    """Whether more motion could show a zero better."""
    return bool(_unsure(chain, mounts, KNOWN))


def _unsure(
    chain: Chain, mounts: Mapping[str, Mount], above: float
) -> list[tuple[Segment, Segment]]:
    """Parent and child of the joints whose zero has a larger error than that, rad."""
    return [
        (parent, child)
        for parent, child in chain.joints()
        if child.joint.freedom
        and child.name in mounts
        and mounts[child.name].facing_sigma > above
    ]


def _what(child: Segment) -> str:
    return "angle" if child.joint.freedom == 1 else "angles"


def signed(
    known: Mapping[str, JointModel], mounts: Mapping[str, Mount], chain: Chain
) -> dict[str, JointModel]:
    """The same, each axis with its largest part in its segment's frame positive."""
    found = dict(known)
    for parent, child in chain.joints():
        joint = known.get(child.name)
        if joint is None or joint.axes is None:
            continue
        signs = [
            _sign(mounts[each.name], axis)
            for each, axis in zip((parent, child), joint.axes, strict=True)
        ]
        if joint.joint.freedom == 1:
            signs[1] = signs[0]
        first, second = (s * a for s, a in zip(signs, joint.axes, strict=True))
        cosine = joint.cosine * signs[0] * signs[1]
        found[child.name] = replace(joint, axes=(first, second), cosine=cosine)
    return found


def _sign(mount: Mount, axis: FloatArray) -> float:
    there = rotation.rotate(rotation.inverse(mount.probe_from_segment), axis)
    return float(np.sign(there[np.argmax(np.abs(there))]))


def mean(track: Track, pose: Pose) -> FloatArray:
    """The mean attitude of a probe in a pose."""
    quat = track.between(*pose).quat
    quat = quat[np.isfinite(quat[:, 0])]
    return np.asarray(np.linalg.eigh(quat.T @ quat)[1][:, -1])
