# SPDX-License-Identifier: MIT
"""The samples of probes on a virtual leg: they sit askew on soft tissue, over a floor
with steel in it, and have the errors of a module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.motion import BoolArray, Motion
from imud.virtual.motions.module import SMALL
from imud.virtual.sensors import Magnet, World

RATE_HZ = 1000.0
STEEL_EVERY_M, STEEL_DEEP_M, STEEL_A_M2 = 1.5, 0.25, 4.0
SPRING_HZ, DAMPING = 6.0, 0.25  # of a probe on soft tissue
FIRM = 0.3  # the share of the wobble that a foot has
# From the start of the segment, m, in its frame.
PLACES = {
    "thigh": np.array([0.03, -0.2, 0.07]),
    "shank": np.array([0.05, -0.18, 0.03]),
    "foot": np.array([0.08, -0.03, 0.0]),
}
# Segment from probe as it is meant to sit: x points up the leg, z away from it.
USUAL = rotation.from_matrix(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))


@dataclass(frozen=True, slots=True)
class Wear:
    """How probes sit: turned by `mount_deg`, and wobbling by `wobble_deg` rms of an
    axis over the rows `walking`. `moving`: where the leg moves.
    """

    mount_deg: float
    wobble_deg: float
    walking: slice
    moving: BoolArray


def floor(length_m: float, random: np.random.Generator) -> World:
    """Steel under a floor along x, one piece every STEEL_EVERY_M on average."""
    places = np.arange(-1.5, length_m + 1.5, STEEL_EVERY_M)
    magnets = []
    for x in (places + random.uniform(-0.4, 0.4, len(places))).tolist():
        y = float(random.uniform(-0.3, 0.3))
        east, north, up = random.normal(0.0, STEEL_A_M2, 3).tolist()
        magnets.append(Magnet((x, y, -STEEL_DEEP_M), (east, north, up)))
    return World(magnets=tuple(magnets))


def worn(
    name: str,
    segment: tuple[FloatArray, FloatArray],
    wear: Wear,
    world: World,
    random: np.random.Generator,
) -> Motion:
    """The samples of the probe on a segment; `segment`: world_from_segment (n, 4) and
    the place of its start (n, 3), at RATE_HZ.
    """
    quat, origin = segment
    axis = random.standard_normal(3)
    askew = axis / np.linalg.norm(axis) * math.radians(wear.mount_deg)
    mount = rotation.multiply(rotation.from_rotation_vector(askew), USUAL)
    size = math.radians(wear.wobble_deg) * (FIRM if name == "foot" else 1.0)
    turned = rotation.from_rotation_vector(wobble(origin, wear.walking, size, random))
    body = rotation.multiply(quat, turned)
    place = origin + rotation.rotate(body, PLACES[name])
    probe = rotation.multiply(body, mount)
    return felt(probe, place, world, wear.moving, random)


def felt(
    probe: FloatArray,
    place: FloatArray,
    world: World,
    moving: BoolArray,
    random: np.random.Generator,
) -> Motion:
    """The samples of a calibrated module along its path: world_from_probe (n, 4) and
    places in m (n, 3) at RATE_HZ, `moving` where it is not at rest.
    """
    step = rotation.multiply(rotation.inverse(probe[:-1]), probe[1:])
    rate = rotation.to_rotation_vector(step) * RATE_HZ
    rate = np.concatenate([rate[:1], (rate[1:] + rate[:-1]) / 2.0, rate[-1:]])
    speed = np.gradient(place, 1.0 / RATE_HZ, axis=0)
    force = np.gradient(speed, 1.0 / RATE_HZ, axis=0)
    force[:, 2] += GRAVITY_M_S2
    back = rotation.inverse(probe)
    exact = Motion(
        RATE_HZ,
        rate,
        rotation.rotate(back, force),
        rotation.rotate(back, world.field_at(place)),
        quat=probe,
        position=place,
        velocity=speed,
        movement=moving,
        is_recorded=False,
    )
    return SMALL.drawn(random).measures(exact, random)


def wobble(
    origin: FloatArray, walking: slice, size: float, random: np.random.Generator
) -> FloatArray:
    """How soft tissue turns a probe, rotation vectors in rad: it lags behind the
    shaking, as a damped spring does; `size`: their rms of an axis while `walking`.
    """
    push = np.gradient(np.gradient(origin, 1.0 / RATE_HZ, axis=0), 1 / RATE_HZ, axis=0)
    return sprung(push @ random.standard_normal((3, 3)), walking, size)


def sprung(push: FloatArray, walking: slice, size: float) -> FloatArray:
    """The turns of a damped spring that a push (n, 3) at RATE_HZ makes, scaled to an
    rms of `size` of an axis over the rows `walking`.
    """
    stiff, damping = (2.0 * np.pi * SPRING_HZ) ** 2, 4.0 * np.pi * DAMPING * SPRING_HZ
    state, speed = np.zeros(3), np.zeros(3)
    found = np.empty_like(push)
    for index, row in enumerate(push):
        speed = speed + (row - stiff * state - damping * speed) / RATE_HZ
        state = state + speed / RATE_HZ
        found[index] = state
    return np.asarray(
        found * (size / max(float(np.sqrt((found[walking] ** 2).mean())), 1e-12))
    )
