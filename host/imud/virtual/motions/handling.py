# SPDX-License-Identifier: MIT
"""Rides of a probe in use, at the rate of simulated motions: on a desk, waved like a
wand, on an arm, and those of ways.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.curves import Curve, Piece, Waves, joined
from imud.virtual.motions import ways
from imud.virtual.motions.machines import component
from imud.virtual.motions.ride import Ride, phase, scaled, sine, times

Random = np.random.Generator
REST_S = 8.0


def of(
    way: Callable[..., RigidBody], seconds: float, rest_s: float
) -> Callable[[Random], Ride]:
    """A ride on a way of ways.py."""
    return lambda random: Ride(way(random, times(seconds), rest_s), rest_s)


def turned_slowly(random: Random) -> Ride:
    """A ship or a turntable: 0.3 to 25 deg/s from power-on; counted from 5 s on."""
    rate = math.exp(random.uniform(math.log(0.3), math.log(25.0)))
    rate *= random.choice([-1.0, 1.0])
    return Ride(ways.turned_slowly(random, times(80.0), rate), 5.0)


def _courses(angles: list[list[Piece]], t: FloatArray) -> list[Curve]:
    return [joined(pieces, t) for pieces in angles]


ARM_M = np.array([0.6, 0.0, 0.1])
ARM_REACH = np.radians([80.0, 45.0, 70.0])


def arm(random: Random) -> Ride:
    """A tool on an arm of 0.6 m: yaw, pitch or roll in turn between poses, 30 s."""
    t, passed = times(38.0), REST_S
    angles = [[Piece(REST_S)] for _ in range(3)]
    pose = np.zeros(3)
    while passed < 36.0:
        joint = int(random.choice(3, p=[0.4, 0.3, 0.3]))
        target = ARM_REACH[joint] * random.uniform(-1.0, 1.0)
        step = target - pose[joint]
        move_s = max(0.8, abs(step) / math.radians(70.0))
        stop_s = max(1.0 / 50.0, random.choice([0.0, 0.5, 1.5]))
        for index, pieces in enumerate(angles):
            own = step if index == joint else 0.0
            pieces += [Piece(move_s, step=own), Piece(stop_s)]
        pose[joint] = target
        passed += move_s + stop_s
    yaw, pitch, roll = _courses(angles, t)
    yaw = scaled(yaw, 1.0, random.uniform(-3.0, 3.0))
    body = ways.here(ways.turned(yaw, pitch, roll))
    return Ride(RigidBody(body.turning, body.at(ARM_M)), REST_S)


DESK_M = np.array([0.4, 0.25])  # to each side of the middle
LYING_M, HIGHEST_M = 0.05, 0.30  # above the steel
DESK_REACH = np.radians([90.0, 30.0, 30.0])


def on_desk(random: Random) -> Ride:
    """Laid on a desk and moved about it, 5 to 30 cm above the steel: 90 s."""
    t, passed = times(98.0), REST_S
    courses = [[Piece(REST_S)] for _ in range(6)]  # place, then yaw, pitch, roll
    now = np.array([*random.uniform(-DESK_M, DESK_M), LYING_M, 0.0, 0.0, 0.0])
    start = now.copy()
    while passed < 98.0:
        angles = DESK_REACH * random.uniform(-1.0, 1.0, 3)
        up = random.uniform(LYING_M, HIGHEST_M)
        is_laid = random.random() < 0.4
        if is_laid:
            up, angles[1:] = LYING_M, 0.0
        target = np.array([*random.uniform(-DESK_M, DESK_M), up, *angles])
        move_s = random.uniform(0.7, 2.5)
        stop_s = random.uniform(1.0, 5.0) if is_laid else random.uniform(0.1, 1.5)
        for pieces, step in zip(courses, target - now, strict=True):
            pieces += [Piece(move_s, step=step), Piece(stop_s)]
        now, passed = target, passed + move_s + stop_s
    x, y, z, yaw, pitch, roll = (
        scaled(course, 1.0, at)
        for course, at in zip(_courses(courses, t), start, strict=True)
    )
    # A hand sways the more the higher it holds the probe.
    grip = scaled(z, 1.0 / (HIGHEST_M - LYING_M), -LYING_M / (HIGHEST_M - LYING_M))
    sway = grip * Waves.draw(random, [(0.3, 2.0, 0.02), (8.0, 12.0, 0.001)]).at(t)
    drift = grip * Waves.draw(random, [(0.3, 2.0, 0.005), (8.0, 12.0, 5e-5)]).at(t)
    yaw = scaled(yaw, 1.0, random.uniform(-3.0, 3.0))
    turning = ways.turned(
        *(angle + component(sway, at) for at, angle in enumerate((yaw, pitch, roll)))
    )
    return Ride(RigidBody(turning, ways.stacked(x, y, z) + drift), REST_S)


FASTEST = math.radians(600.0)
PEAK = 1.875  # of a least-jerk step's speed over its mean speed
WAND_REACH = np.radians([90.0, 60.0, 80.0])


def waved(random: Random) -> Ride:
    """A wand: swings of up to 600 deg/s that end in a ring, and holds; 80 s."""
    t, passed = times(88.0), REST_S
    angles = [[Piece(REST_S)] for _ in range(3)]
    rings = [ways.steady(t) for _ in range(3)]
    pose = np.zeros(3)
    while passed < 88.0:
        target = WAND_REACH * random.uniform(-1.0, 1.0, 3)
        step = target - pose
        largest = float(np.abs(step).sum())
        fastest = random.uniform(0.2, 1.0) * FASTEST
        swing_s = max(0.2, PEAK * largest / fastest)
        stop_s = random.choice([0.02, random.uniform(0.1, 2.0)])
        speed = PEAK * step / swing_s
        for pieces, own in zip(angles, step, strict=True):
            pieces += [Piece(swing_s, step=own), Piece(stop_s)]
        hz, decay_s = random.uniform(4.0, 8.0), random.uniform(0.1, 0.25)
        for index, own in enumerate(0.004 * speed):  # 2.4 degrees of 600 deg/s
            tail = ring(t, passed + swing_s, hz, decay_s)
            rings[index] = rings[index] + scaled(tail, own)
        pose, passed = target, passed + swing_s + stop_s
    yaw, pitch, roll = (
        own + tail for own, tail in zip(_courses(angles, t), rings, strict=True)
    )
    yaw = scaled(yaw, 1.0, random.uniform(-3.0, 3.0))
    way = ways.begun(t, REST_S)
    elbow = (scaled(way * ways.wandering(t, random, 0.4), 0.05) for _ in range(3))
    body = RigidBody(ways.turned(yaw, pitch, roll), ways.stacked(*elbow))
    lever = np.array([random.uniform(0.2, 0.5), 0.0, 0.0])
    return Ride(RigidBody(body.turning, body.at(lever)), REST_S)


def ring(t: FloatArray, at_s: float, hz: float, decay_s: float) -> Curve:
    """An oscillation that rises to an amplitude of 1 at `decay_s` and dies away."""
    since = np.maximum(t - at_s, 0.0)[:, None] / decay_s
    is_on = since > 0.0
    fall = np.exp(1.0 - since) ** 2
    envelope = Curve(
        since**2 * fall,
        2.0 * (since - since**2) * fall / decay_s,
        is_on * (2.0 - 8.0 * since + 4.0 * since**2) * fall / decay_s**2,
    )
    return envelope * sine(phase(t, hz, at_s))


def laid_about(random: Random) -> Ride:
    """Lying at five attitudes, for 10 s each."""
    rest_s, steps = 15.0, random.uniform(-1.0, 1.0, (5, 3)) * [3.0, 0.8, 0.8]
    angles = [[Piece(rest_s)] for _ in range(3)]
    for change in np.diff(steps, axis=0, prepend=0.0):
        for pieces, step in zip(angles, change, strict=True):
            pieces += [Piece(2.0, step=step), Piece(10.0)]
    return Ride(ways.here(ways.turned(*_courses(angles, times(75.0)))), rest_s)
