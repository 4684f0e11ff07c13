# SPDX-License-Identifier: MIT
"""A right leg that stands, squats, swings and walks, and three probes on it, with the
truth of every joint: the input of `benchmarks/limb/legs.py`.

The foot's path comes first, then the knee's bend by the lengths of thigh and shank. The
leg walks along x (east). Rates and forces are differences of the exact course.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.curves import STEP
from imud.virtual.leg_probes import RATE_HZ, Wear, floor, worn
from imud.virtual.motion import Motion
from imud.virtual.sensors import World

SEGMENTS = ("thigh", "shank", "foot")
THIGH_M, SHANK_M, ANKLE_M, TOE_M = 0.42, 0.43, 0.08, 0.17
REACH_M = 0.845  # hip to ankle of a leg that stands
STAND_S, SQUAT_S, RAISE_S = 6.0, 3.0, 2.5
FLAT, RISE = 0.42, 0.62  # shares of a stride: the foot lies, then its heel rises
HEEL_RAD = math.radians(-50.0)  # the foot's pitch when the toe leaves

CHAIN = f"""\
name = "right-leg"
side = "right"

[segments.thigh]
length_m = {THIGH_M}
probe = "thigh"

[segments.shank]
parent = "thigh"
joint = "knee"
length_m = {SHANK_M}
probe = "shank"

[segments.foot]
parent = "shank"
joint = "ankle"
length_m = {ANKLE_M}
probe = "foot"
contact = true

[segments.foot.marks]
toe = [{TOE_M}, -{ANKLE_M}, 0.0]
"""


@dataclass(frozen=True, slots=True)
class Manner:
    """How a leg moves, and how loosely its probes sit."""

    stride_s: float = 1.15
    stride_m: float = 1.15
    walk_s: float = 60.0
    squats: int = 4
    raises: int = 4
    mount_deg: float = 30.0  # by which each probe is turned against its segment
    wobble_deg: float = 1.3  # rms of an axis while walking, of soft tissue
    play_deg: float = 3.0  # amplitude of the turns about a joint's other axes
    is_disturbed: bool = True  # iron near the floor


Stages = Mapping[str, tuple[float, float]]  # from and to, s


@dataclass(frozen=True, slots=True)
class Leg:
    """The samples of each probe, and the truth: world_from_segment, (n, 4); the ankle's
    place in m; flexion, abduction, internal rotation by joint in rad; stages in s.
    """

    motions: Mapping[str, Motion]
    quats: Mapping[str, FloatArray]
    angles: Mapping[str, FloatArray]
    ankle: FloatArray
    stages: Stages


# Planar course: pitches of thigh, shank, foot (about z to the right) and the ankle.
_Course = tuple[FloatArray, FloatArray]


def made(seed: int, manner: Manner | None = None) -> Leg:
    """A leg at RATE_HZ; always the same for the same seed."""
    manner = manner or Manner()
    random = np.random.default_rng([seed, 0x1E6])
    stages = {"stand": _stand(STAND_S)}
    stages["squat"] = _joined([_squat(random) for _ in range(manner.squats)])
    stages["raise"] = _joined([_raise(random) for _ in range(manner.raises)])
    stages["rest"] = _stand(2.0)
    stages["walk"] = _walk(manner)
    stages["end"] = _stand(2.0, stages["walk"][1][-1])
    pitch, ankle = _joined(list(stages.values()))
    ends = np.cumsum([len(each[0]) for each in stages.values()]) / RATE_HZ
    starts = np.concatenate([[0.0], ends[:-1]])
    spans = dict(
        zip(stages, zip(starts.tolist(), ends.tolist(), strict=True), strict=True)
    )
    angles, quats = _turned(pitch, manner, random)
    walked_m = manner.walk_s / manner.stride_s * manner.stride_m
    world = floor(walked_m, random) if manner.is_disturbed else World()
    hip = ankle - _along(quats["shank"], SHANK_M) - _along(quats["thigh"], THIGH_M)
    origins = {"thigh": hip, "shank": ankle - _along(quats["shank"], SHANK_M)}
    origins["foot"] = ankle
    moving = np.zeros(len(pitch), bool)
    for name in ("squat", "raise", "walk"):
        first, last = (round(each * RATE_HZ) for each in spans[name])
        moving[first:last] = True
    walking = slice(*(round(each * RATE_HZ) for each in spans["walk"]))
    wear = Wear(manner.mount_deg, manner.wobble_deg, walking, moving)
    motions = {
        name: worn(name, (quats[name], origins[name]), wear, world, random)
        for name in SEGMENTS
    }
    return Leg(motions, quats, angles, ankle, spans)


def _stand(seconds: float, ankle: FloatArray | None = None) -> _Course:
    count = round(seconds * RATE_HZ)
    place = np.array([0.0, 0.0, ANKLE_M]) if ankle is None else ankle
    return np.zeros((count, 3)), np.broadcast_to(place, (count, 3))


def _joined(parts: list[_Course]) -> _Course:
    return (
        np.concatenate([each[0] for each in parts]),
        np.concatenate([each[1] for each in parts]),
    )


def _there_and_back(seconds: float) -> FloatArray:
    """From 0 to 1 and back to 0, without a jump of acceleration."""
    u = np.arange(round(seconds * RATE_HZ)) / (seconds * RATE_HZ)
    return np.asarray(STEP(1.0 - np.abs(1.0 - 2.0 * u)))


def _squat(random: np.random.Generator) -> _Course:
    """The foot lies, the knee goes ahead, the hip goes back."""
    depth = _there_and_back(SQUAT_S * random.uniform(0.9, 1.1))
    thigh = math.radians(70.0 * random.uniform(0.8, 1.1)) * depth
    shank = math.radians(-28.0 * random.uniform(0.8, 1.1)) * depth
    pitch = np.stack([thigh, shank, np.zeros_like(depth)], axis=1)
    return pitch, np.broadcast_to([0.0, 0.0, ANKLE_M], pitch.shape)


def _raise(random: np.random.Generator) -> _Course:
    """The hip stays, the thigh rises, the shank swings back, the foot bends."""
    share = _there_and_back(RAISE_S * random.uniform(0.9, 1.1))
    thigh = math.radians(50.0 * random.uniform(0.8, 1.1)) * share
    shank = math.radians(-45.0 * random.uniform(0.6, 1.1)) * share
    waving = np.sin(6.0 * np.pi * np.arange(len(share)) / len(share))
    foot = shank + math.radians(25.0) * share * waving
    pitch = np.stack([thigh, shank, foot], axis=1)
    down = THIGH_M * _down(thigh) + SHANK_M * _down(shank)
    hip = np.array([0.0, 0.0, ANKLE_M + THIGH_M + SHANK_M])
    return pitch, hip + down


def _down(pitch: FloatArray) -> FloatArray:
    """Where a segment of 1 m ends, from its start."""
    none = np.zeros_like(pitch)
    return np.stack([np.sin(pitch), none, -np.cos(pitch)], axis=1)


def _smooth(u: FloatArray) -> FloatArray:
    return np.asarray(STEP(np.clip(u, 0.0, 1.0)))


def _walk(manner: Manner) -> _Course:
    """Strides of one length; it begins and ends standing."""
    strides = round(manner.walk_s / manner.stride_s)
    t = np.arange(round(strides * manner.stride_s * RATE_HZ)) / RATE_HZ
    phase = t / manner.stride_s
    count, share = np.floor(phase), phase % 1.0
    begins = np.where(count == 0, 0.5, 1.0)  # the first swing is half as long
    before = np.where(count == 0, 0.0, (count - 0.5) * manner.stride_m)
    # The foot turns about its toe, then swings to the next place.
    lift = _smooth((share - FLAT) / (RISE - FLAT))
    land = _smooth((share - RISE) / (1.0 - RISE))
    foot = HEEL_RAD * lift * (1.0 - land)
    arm = rotation.rotate(
        rotation.from_rotation_vector(np.outer(-foot, [0.0, 1.0, 0.0])),
        np.array([-TOE_M, 0.0, ANKLE_M]),
    )
    ankle = np.array([TOE_M, 0.0, 0.0]) + arm
    ankle[:, 0] += before + begins * manner.stride_m * land
    ankle[:, 2] += (
        0.05 * np.sin(np.pi * np.clip((share - RISE) / (1 - RISE), 0, 1)) ** 3
    )
    # The hip passes over the foot in the middle of its rest, at an even pace.
    pace = manner.stride_m / manner.stride_s
    middle = (FLAT / 2.0 + 0.08) * manner.stride_s
    hip_x = pace * (t - middle - manner.stride_s / 2.0)
    start = _smooth(t / (manner.stride_s * 0.9))
    hip_x = hip_x * start
    end = t[-1] - t
    last = ankle[-1, 0]
    gone = _smooth(1.0 - end / (manner.stride_s * 0.9))
    hip_x = hip_x * (1.0 - gone) + last * gone
    wave = np.cos(4.0 * np.pi * (t - middle) / manner.stride_s)
    hip_z = ANKLE_M + REACH_M - 0.030 + 0.022 * wave
    stood = np.maximum(1.0 - start, gone)
    hip_z = hip_z * (1.0 - stood) + (ANKLE_M + THIGH_M + SHANK_M) * stood
    away = np.stack([hip_x - ankle[:, 0], hip_z - ankle[:, 2]], axis=1)
    bent = (1.0 - stood) * np.stack(_bent(away))
    return np.stack([*bent, foot], axis=1), ankle


def _bent(away: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pitches of thigh and shank by the hip's place over the ankle."""
    reach = np.linalg.norm(away, axis=1)
    most = THIGH_M + SHANK_M
    # Smoothly kept under the leg's length.
    reach = most - np.logaddexp(0.0, (most - reach) * 60.0) / 60.0
    lean = np.arctan2(-away[:, 0], away[:, 1])
    hip = (THIGH_M**2 + reach**2 - SHANK_M**2) / (2.0 * THIGH_M * reach)
    ankle = (SHANK_M**2 + reach**2 - THIGH_M**2) / (2.0 * SHANK_M * reach)
    thigh = lean + np.arccos(np.clip(hip, -1.0, 1.0))
    shank = lean - np.arccos(np.clip(ankle, -1.0, 1.0))
    return thigh, shank


def _turned(
    pitch: FloatArray, manner: Manner, random: np.random.Generator
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Joint angles, and world_from_segment by the foot's and the angles."""
    upright = rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    thigh, shank, foot = pitch.T
    angles = {
        "shank": np.stack([thigh - shank, *_play(thigh - shank, manner, random)], 1),
        "foot": np.stack([foot - shank, *_play(foot - shank, manner, random)], 1),
    }
    z = np.array([0.0, 0.0, 1.0])
    quats = {
        "foot": rotation.multiply(
            upright, rotation.from_rotation_vector(np.outer(foot, z))
        )
    }
    for child, parent, flexion in (("foot", "shank", 1.0), ("shank", "thigh", -1.0)):
        turn = _joint(angles[child], flexion)
        quats[parent] = rotation.multiply(quats[child], rotation.inverse(turn))
    return angles, quats


def _play(
    flexion: FloatArray, manner: Manner, random: np.random.Generator
) -> list[FloatArray]:
    """Abduction and rotation: they follow flexion, with a shape of their own."""
    found = []
    for _ in range(2):
        size = math.radians(manner.play_deg) * random.uniform(0.5, 1.5)
        sign = random.choice([-1.0, 1.0])
        pace = random.uniform(1.5, 3.0)
        found.append(sign * size * np.sin(pace * flexion))
    return found


def _joint(angles: FloatArray, flexion: float) -> FloatArray:
    """parent_from_child of a right leg: about z, then x, then y."""
    none = np.zeros(len(angles))
    bend, out, turn = angles.T
    first, second, third = (
        rotation.from_rotation_vector(np.stack(each, axis=1))
        for each in (
            (none, none, flexion * bend),
            (-out, none, none),
            (none, turn, none),
        )
    )
    return rotation.multiply(first, rotation.multiply(second, third))


def _along(quat: FloatArray, length_m: float) -> FloatArray:
    """From a segment's start to its end, m, world."""
    return rotation.rotate(quat, np.array([0.0, -length_m, 0.0]))
