# SPDX-License-Identifier: MIT
"""A foot that walks, jogs and runs in curves, and the probe on it, with the truth.

Harder than the leg of `imud.virtual.leg`: it meets the ground at a speed, shakes, rolls
while it carries, and its motion exceeds the sensor's range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.curves import BUMP, STEP
from imud.virtual.leg import ANKLE_M, TOE_M
from imud.virtual.leg_probes import PLACES, RATE_HZ, USUAL, felt
from imud.virtual.sensors import World

SENSOR_HZ = 200.0
# The rate error by a force, rms of an element: over three axes 0.1 deg/s a g, which
# is usual for MEMS.
RATE_BY_FORCE = math.radians(0.06) / GRAVITY_M_S2
SOLE_S = 0.004  # in which a foot is stopped, one sigma
SHAKE_M, SHAKE_HZ, SHAKE_S = 0.001, 40.0, 0.02
TWIST_RAD, TWIST_HZ, TWIST_S = 0.009, 25.0, 0.03
SLAP_S = 0.03  # from heel or toe to the whole foot
HELD = 0.5  # of the rise, in which the toe still stands


@dataclass(frozen=True, slots=True)
class Gait:
    """One stride: how long, how far, and how the foot meets the ground."""

    stride_s: float
    stride_m: float
    contact_s: float  # in which the foot stands still, but for rolling and shaking
    roll_rad_s: float
    rise_s: float = 0.14  # then its heel rises about the toe
    heel_rad: float = math.radians(-55.0)
    toe_rad: float = math.radians(18.0)  # at which it meets the ground
    clearance_m: float = 0.08
    impact_m_s: float = 0.8
    turns_rad: float = 0.1  # the random part of each stride's turn, one sigma


GAITS = {
    "stroll": Gait(1.4, 0.9, 0.55, 0.05, clearance_m=0.05, impact_m_s=0.3),
    "walk": Gait(1.1, 1.4, 0.32, 0.1, clearance_m=0.06, impact_m_s=0.6),
    "fast walk": Gait(0.9, 1.8, 0.2, 0.2, impact_m_s=1.0),
    "jog": Gait(0.76, 1.9, 0.14, 0.4, clearance_m=0.2, impact_m_s=1.2),
    "run": Gait(0.7, 2.6, 0.1, 0.6, 0.13, math.radians(-75.0), clearance_m=0.3),
    "sprint": Gait(0.56, 3.2, 0.1, 0.8, 0.11, math.radians(-85.0), clearance_m=0.35),
}


# In a room of some metres: a runner turns about after a few strides.
ROOM_RUN = Gait(0.66, 1.6, 0.11, 0.6, 0.13, math.radians(-75.0), turns_rad=0.5)
# Speeds up and down within one walk: so many strides of each.
MIXED = (("walk", 4), ("jog", 4), ("run", 5), ("sprint", 5), ("run", 4), ("walk", 3))


@dataclass(frozen=True, slots=True)
class Sensor:
    """The probe, and how long it stands at the beginning and the end."""

    has_compass: bool = True
    range_rad_s: float = math.radians(2000.0)
    range_m_s2: float = 16.0 * GRAVITY_M_S2
    stand_s: float = 8.0


USUAL_SENSOR = Sensor()
# As a foot on which recordings with optical truth are made: no compass, little rest.
BARE = Sensor(has_compass=False, stand_s=2.0)
# Its ranges end below the rates and forces of a runner's foot.
NARROW = Sensor(False, math.radians(900.0), 8.0 * GRAVITY_M_S2, 2.0)


@dataclass(frozen=True, slots=True)
class Walk:
    """The probe's readings at SENSOR_HZ, rad/s, m/s2, uT; its place, m; and when the
    foot stood: from and to, s.
    """

    times_s: FloatArray
    gyr: FloatArray
    acc: FloatArray
    mag: FloatArray
    place: FloatArray
    quat: FloatArray  # world_from_probe
    contacts: tuple[tuple[float, float], ...]


def mixed() -> list[Gait]:
    """From walking to sprinting and back."""
    return [GAITS[name] for name, count in MIXED for _ in range(count)]


def made(gait: Gait, strides: int, seed: int, sensor: Sensor = USUAL_SENSOR) -> Walk:
    """It stands, walks so many strides, and stands."""
    return of_strides([gait] * strides, seed, sensor)


def of_strides(gaits: Sequence[Gait], seed: int, sensor: Sensor) -> Walk:
    """It stands, takes these strides, and stands."""
    random = np.random.default_rng([seed, 0xF007])
    toe, pitch, yaw, contacts = _course(gaits, sensor.stand_s, random)
    count = len(pitch)
    shaken_m, twisted = _shaken(contacts, count, random)
    pitch = _soft(pitch[:, None])[:, 0]
    yaw = _soft(yaw[:, None])[:, 0]
    z, up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    upright = rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    turned = rotation.multiply(
        rotation.from_rotation_vector(np.outer(yaw, up)),
        rotation.multiply(upright, rotation.from_rotation_vector(np.outer(pitch, z))),
    )
    segment = rotation.multiply(turned, rotation.from_rotation_vector(twisted))
    ankle = _soft(toe) + rotation.rotate(segment, np.array([-TOE_M, ANKLE_M, 0.0]))
    place = ankle + rotation.rotate(segment, PLACES["foot"]) + shaken_m
    axis = random.standard_normal(3)
    askew = rotation.from_rotation_vector(axis / np.linalg.norm(axis) * 0.5)
    probe = rotation.multiply(segment, rotation.multiply(askew, USUAL))
    stands = round(sensor.stand_s * RATE_HZ)
    moving = np.ones(count, bool)
    moving[:stands] = moving[-stands:] = False
    seen = felt(probe, place, World(), moving, random)
    felt_too = seen.acc @ random.normal(0.0, RATE_BY_FORCE, (3, 3))
    every = round(RATE_HZ / SENSOR_HZ)
    rows = slice(every, count - every, every)

    def sampled(values: FloatArray, most: float) -> FloatArray:
        kernel = np.ones(every) / every
        means = [np.convolve(each, kernel, "same")[rows] for each in values.T]
        return np.asarray(np.clip(np.stack(means, axis=1), -most, most))

    mag = seen.mag[rows].copy()
    mag[np.arange(len(mag)) % 2 == 1] = np.nan
    if not sensor.has_compass:
        mag[:] = np.nan
    return Walk(
        np.arange(count)[rows] / RATE_HZ,
        sampled(seen.gyr + felt_too, sensor.range_rad_s),
        sampled(seen.acc, sensor.range_m_s2),
        mag,
        place[rows],
        probe[rows],
        tuple(contacts),
    )


def _course(
    gaits: Sequence[Gait], stand_s: float, random: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, list[tuple[float, float]]]:
    """Toe, pitch, yaw at RATE_HZ, and the contacts."""
    here, facing = np.zeros(3), float(random.uniform(-math.pi, math.pi))
    stands = round(stand_s * RATE_HZ)
    toes = [np.zeros((stands, 3))]
    pitches, yaws = [np.zeros(stands)], [np.full(stands, facing)]
    contacts = [(0.0, stand_s)]
    at_s, lean, turning = stand_s, 0.0, 0.0
    for index, gait in enumerate(gaits):
        slow = 0.6 if index in (0, len(gaits) - 1) else 1.0  # speeds up, and down
        length = slow * gait.stride_m * random.normal(1.0, 0.05)
        seconds = gait.stride_s * random.normal(1.0, 0.03)
        turning = 0.8 * turning + random.normal(0.0, gait.turns_rad)
        to = facing + turning
        ahead = np.array([math.cos(to), math.sin(to), random.normal(0.0, 0.01)])
        there = here + length * ahead
        # The heel rises about the toe, which leaves the ground meanwhile.
        rise = np.arange(round(gait.rise_s * RATE_HZ)) / (gait.rise_s * RATE_HZ)
        held = round(HELD * len(rise))
        swing_s = max(0.2, seconds - HELD * gait.rise_s - gait.contact_s - SLAP_S)
        u = np.arange(round(swing_s * RATE_HZ)) / (swing_s * RATE_HZ)
        meets = _meeting(u, gait.impact_m_s * swing_s / length)
        sink = gait.impact_m_s * 0.5 * swing_s * u**3 * (1.0 - u)
        lifted = gait.clearance_m * BUMP(u) + sink
        toes += [
            np.broadcast_to(here, (held, 3)),
            here + np.outer(meets, there - here) + np.outer(lifted, [0, 0, 1.0]),
        ]
        heel = gait.heel_rad * random.normal(1.0, 0.05)
        on = np.arange(len(u) + held - len(rise)) / len(u)
        pitches += [
            lean + (heel - lean) * STEP(rise),
            heel + (gait.toe_rad - heel) * STEP(np.minimum(1.0, on / on[-1] / 0.9)),
        ]
        yaws += [np.full(held, facing), facing + (to - facing) * STEP(u)]
        at_s += (held + len(u)) / RATE_HZ
        # It slaps down, and rolls on while it carries.
        is_last = index == len(gaits) - 1
        stood_s = stand_s if is_last else gait.contact_s * random.normal(1.0, 0.05)
        slap = np.arange(round(SLAP_S * RATE_HZ)) / (SLAP_S * RATE_HZ)
        stood = np.arange(round(stood_s * RATE_HZ)) / RATE_HZ
        roll = 0.0 if is_last else gait.roll_rad_s * random.uniform(0.5, 1.5)
        pitches += [gait.toe_rad * (1.0 - slap), -roll * stood]
        lean = float(pitches[-1][-1])
        here, facing = there, to
        toes.append(np.broadcast_to(here, (len(slap) + len(stood), 3)))
        yaws.append(np.full(len(slap) + len(stood), facing))
        contacts.append((at_s + SLAP_S, at_s + SLAP_S + stood_s))
        at_s += (len(slap) + len(stood)) / RATE_HZ
    joined = np.concatenate(toes), np.concatenate(pitches), np.concatenate(yaws)
    return *joined, contacts


def _meeting(u: FloatArray, speed: float) -> FloatArray:
    """From 0 to 1, at rest first, at that speed at the end."""
    return np.asarray(STEP(u) + speed * (u**4 * (u - 1.0)))


def _shaken(
    contacts: list[tuple[float, float]], count: int, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """The decaying shake after each contact with the ground: m, and rad."""
    shaken, twisted = np.zeros((count, 3)), np.zeros((count, 3))
    for begin_s, _ in contacts[1:]:
        first = round((begin_s - 0.01) * RATE_HZ)
        t = np.arange(min(round(0.2 * RATE_HZ), count - first)) / RATE_HZ
        for into, size, pace, tau in (
            (shaken, SHAKE_M, SHAKE_HZ, SHAKE_S),
            (twisted, TWIST_RAD, TWIST_HZ, TWIST_S),
        ):
            wave = np.sin(2.0 * math.pi * pace * t) * np.exp(-t / tau)
            into[first : first + len(t)] += np.outer(
                size * wave, random.normal(0.0, 1.0, 3)
            )
    return shaken, twisted


def _soft(values: FloatArray) -> FloatArray:
    """Stopped within SOLE_S, not at once."""
    reach = round(4 * SOLE_S * RATE_HZ)
    t = np.arange(-reach, reach + 1) / RATE_HZ
    kernel = np.exp(-0.5 * (t / SOLE_S) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(each, kernel, "valid") for each in padded.T], axis=1)
