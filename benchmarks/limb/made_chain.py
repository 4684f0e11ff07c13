# SPDX-License-Identifier: MIT
"""Made chains of five segments with joints of one, two and three degrees of freedom
about any axes, moved by hand, and the readings of probes on them 40 times a second.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.curves import STEP
from imud.virtual.leg_probes import RATE_HZ, felt, sprung
from imud.virtual.motion import Motion
from imud.virtual.sensors import Magnet, World

NAMES = ("one", "two", "three", "four", "five")
ARM = ("free", "hinge", "hinge", "hinge")
HAND = ("hinge", "universal", "hinge", "free")
LENGTH_M = 0.2
STILL_S = 5.0
EVERY = 25  # records of RATE_HZ in one at 40 Hz
UPRIGHT_OFF = 0.06  # of an axis that points up, rad
LOOSE_DEG = 3.0  # rms of an axis, of a probe on foam


@dataclass(frozen=True, slots=True)
class Made:
    """The readings of each probe at 40 Hz, and world_from_segment at those times."""

    motions: Mapping[str, Motion]
    quats: Mapping[str, FloatArray]
    toml: str

    @property
    def times_s(self) -> FloatArray:
        return np.arange(len(self.quats["one"])) * EVERY / RATE_HZ


def made(
    seed: int,
    joints: tuple[str, ...] = ARM,
    seconds: float = 60.0,
    *,
    is_loose: bool = False,
    is_upright: bool = False,
) -> Made:
    """A chain, always the same for the same seed; it rests STILL_S at the start. With
    `is_upright` the axes of its hinges then point up, within some degrees.
    """
    random = np.random.default_rng([seed, 0xC4A1])
    t = np.arange(round((STILL_S + seconds) * RATE_HZ)) / RATE_HZ
    moves = STEP(np.clip((t - STILL_S) / 1.5, 0.0, 1.0))
    start = _turned(random.normal(0.0, 0.8, 3))
    quat = rotation.multiply(_turned(_waves(t, random, 3, 0.5) * moves[:, None]), start)
    place = 0.15 * _waves(t, random, 3, 1.0) * moves[:, None]
    world = World(
        magnets=tuple(
            Magnet(tuple(at), tuple(moment))
            for at, moment in zip(
                random.normal((0.0, 0.0, -1.2), 1.0, (3, 3)),
                random.normal(0.0, 6.0, (3, 3)),
                strict=True,
            )
        )
    )
    quats: dict[str, FloatArray] = {}
    motions: dict[str, Motion] = {}
    for name, joint in zip(NAMES, ("", *joints), strict=True):
        if joint:
            place = place + rotation.rotate(quat, np.array([0.0, -LENGTH_M, 0.0]))
            up = rotation.rotate(rotation.inverse(quat[0]), np.array([0.0, 0.0, 1.0]))
            bend = _bends(joint, t, random, up if is_upright else None)
            still = _turned(random.normal(0.0, 0.5, 3))
            quat = rotation.multiply(
                quat, rotation.multiply(_eased(bend, moves), still)
            )
        body = quat
        if is_loose:
            soft = foam(quat, place, random)
            body = rotation.multiply(quat, rotation.from_rotation_vector(soft))
        mount = _turned(random.normal(0.0, 1.5, 3))
        at = place + rotation.rotate(
            body, np.array([0.0, -0.1, 0.0]) + random.normal(0.0, 0.02, 3)
        )
        motion = felt(rotation.multiply(body, mount), at, world, moves > 0.0, random)
        motions[name], quats[name] = at_40_hz(motion), quat[EVERY // 2 :: EVERY]
    count = min(len(motions["one"]), len(quats["one"]))
    quats = {name: each[:count] for name, each in quats.items()}
    return Made(motions, quats, toml_of(joints))


def foam(
    quat: FloatArray, place: FloatArray, random: np.random.Generator
) -> FloatArray:
    """How a probe turns on foam, rotation vectors in rad: a damped spring yields to the
    force in its segment, so it sags with gravity and lags behind the shaking.
    """
    push = np.gradient(np.gradient(place, 1.0 / RATE_HZ, axis=0), 1.0 / RATE_HZ, axis=0)
    force = rotation.rotate(
        rotation.inverse(quat), push + np.array([0.0, 0.0, GRAVITY_M_S2])
    )
    moving = slice(round((STILL_S + 2.0) * RATE_HZ), len(quat))
    turned = (force - force[0]) @ random.standard_normal((3, 3))
    return sprung(turned, moving, np.radians(LOOSE_DEG))


def toml_of(joints: tuple[str, ...]) -> str:
    """The file of such a chain."""
    parts = ['name = "five"\n', f'[segments.{NAMES[0]}]\nprobe = "{NAMES[0]}"\n']
    parts[1] += f"length_m = {LENGTH_M}\n"
    for above, name, joint in zip(NAMES, NAMES[1:], joints, strict=False):
        lines = f'[segments.{name}]\nparent = "{above}"\njoint = "{joint}"\n'
        parts.append(f'{lines}length_m = {LENGTH_M}\nprobe = "{name}"\n')
    return "\n".join(parts)


def at_40_hz(motion: Motion) -> Motion:
    """Rates and forces as means of EVERY records, the field as one of them."""
    count = len(motion) // EVERY
    gyr, acc = (
        each[: count * EVERY].reshape(count, EVERY, 3).mean(axis=1)
        for each in (motion.gyr, motion.acc)
    )
    return Motion(RATE_HZ / EVERY, gyr, acc, motion.mag[EVERY // 2 :: EVERY][:count])


def _waves(
    t: FloatArray, random: np.random.Generator, width: int, size: float
) -> FloatArray:
    """Sums of sines of 0.1 to 0.9 Hz: (n, width), about `size` rms."""
    pace = random.uniform(0.1, 0.9, (4, 1, width))
    phase = random.uniform(0.0, 2.0 * np.pi, (4, 1, width))
    share = size * random.uniform(0.4, 1.0, (4, 1, width))
    waves = share * np.sin(2.0 * np.pi * pace * t[:, None] + phase)
    return np.asarray(waves.sum(axis=0))


def _bends(
    joint: str, t: FloatArray, random: np.random.Generator, up: FloatArray | None
) -> FloatArray:
    """Rotation vectors of a joint over time, (k, n, 3): turns in this order; `up`: what
    the first axis is near, in the parent's frame.
    """
    if joint == "free":
        return _waves(t, random, 3, 0.5)[None]
    first = _unit(random)
    if up is not None:
        first = up + UPRIGHT_OFF * first
        first /= np.linalg.norm(first)
    turns = [_waves(t, random, 1, 0.6) * first]
    if joint == "universal":
        across = np.cross(first, _unit(random))
        turns.append(_waves(t, random, 1, 0.6) * across / np.linalg.norm(across))
    return np.stack(turns)


def _eased(bends: FloatArray, moves: FloatArray) -> FloatArray:
    """The product of turns, each from nothing at the start."""
    found = rotation.IDENTITY
    for bend in bends:
        found = rotation.multiply(found, _turned(bend * moves[:, None]))
    return found


def _unit(random: np.random.Generator) -> FloatArray:
    axis = random.standard_normal(3)
    return np.asarray(axis / np.linalg.norm(axis))


def _turned(angle_rad: FloatArray) -> FloatArray:
    return rotation.from_rotation_vector(angle_rad)
