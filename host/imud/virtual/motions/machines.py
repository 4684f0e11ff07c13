# SPDX-License-Identifier: MIT
"""Rides on machines: turntable, centrifuge, robot arm and vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.curves import Curve, Piece, Turning, Waves, about, joined
from imud.virtual.motions.ride import (
    ORIGIN,
    RATE_HZ,
    REST_S,
    Ride,
    X,
    Y,
    Z,
    anyhow,
    facing,
    scaled,
    times,
)

SECONDS = (80.0, 120.0)


def turntable(random: np.random.Generator) -> Ride:
    """A turntable, up to 3 degrees from level: 20 to 300 deg/s, either way, with stops;
    the sensor is 5 to 30 cm off its axis and feels up to 8 m/s2.
    """
    radius_m = random.uniform(0.05, 0.3)
    fastest = min(math.radians(300.0), math.sqrt(8.0 / radius_m))

    def rate() -> float:
        return float(random.uniform(math.radians(20.0), fastest))

    return _spun(random, radius_m, rate, hold_s=(6.0, 25.0), ramp_s=(0.8, 3.0))


def centrifuge(random: np.random.Generator) -> Ride:
    """A centrifuge of 0.3 to 1 m: 3 to 20 m/s2 for 15 to 40 s at a time."""
    radius_m = random.uniform(0.3, 1.0)

    def rate() -> float:
        return math.sqrt(random.uniform(3.0, 20.0) / radius_m)

    return _spun(random, radius_m, rate, hold_s=(15.0, 40.0), ramp_s=(3.0, 8.0))


def _spun(
    random: np.random.Generator,
    radius_m: float,
    rate: Callable[[], float],
    hold_s: tuple[float, float],
    ramp_s: tuple[float, float],
) -> Ride:
    seconds, rest_s = random.uniform(*SECONDS), random.uniform(*REST_S)
    pieces, passed, speed = [Piece(rest_s)], rest_s, 0.0
    while passed < seconds:
        is_stop = speed != 0.0 and random.random() < 0.4
        following = 0.0 if is_stop else rate() * random.choice([-1.0, 1.0])
        held_s = random.uniform(1.0, 6.0) if is_stop else random.uniform(*hold_s)
        ramp = random.uniform(*ramp_s)
        pieces.append(Piece(ramp, start_rate=speed, end_rate=following))
        pieces.append(Piece(held_s, start_rate=following, end_rate=following))
        passed, speed = passed + ramp + held_s, following
    t = times(seconds)
    tilt = math.radians(random.uniform(0.0, 3.0))
    lean = rotation.from_rotation_vector(tilt * X)
    body = RigidBody.still(rotation.multiply(facing(random), lean), len(t))
    body = body.hinged(ORIGIN, about(Z, joined(pieces, t)))
    body = RigidBody(body.turning, body.at(radius_m * X))
    return Ride(body, rest_s).mounted(anyhow(random))


ARM_FASTEST = math.radians(450.0)  # all joints together
# Each joint: its axis, the length after it in m, and how far it goes in radians.
ARM_JOINTS = ((Z, 0.0, np.pi), (Y, 0.35, 1.0), (Y, 0.3, 1.5), (X, 0.1, np.pi))


def robot_arm(random: np.random.Generator) -> Ride:
    """An arm of four joints and 75 cm: moves between poses at up to 450 deg/s, stops of
    up to 3 s, and arcs of its base at 40 to 180 deg/s for 4 to 12 s.
    """
    seconds, rest_s = random.uniform(*SECONDS), random.uniform(*REST_S)
    reach = np.array([limit for _, _, limit in ARM_JOINTS])
    pose = random.uniform(-0.5, 0.5, len(reach)) * reach
    start, passed = pose, rest_s
    joints: list[list[Piece]] = [[Piece(rest_s)] for _ in ARM_JOINTS]
    while passed < seconds:
        if random.random() < 0.25:
            added = _arc(random)
        else:
            target = random.uniform(-1.0, 1.0, len(reach)) * reach
            added = _move(random, target - pose)
            pose = target
        for pieces, own in zip(joints, added, strict=True):
            pieces += own
        passed += sum(piece.seconds for piece in added[0])
    t = times(seconds)
    body = RigidBody.still(facing(random), len(t))
    arm = ORIGIN
    for (axis, length_m, _), begun, pieces in zip(
        ARM_JOINTS, start, joints, strict=True
    ):
        angle = scaled(joined(pieces, t), 1.0, begun)
        body = body.hinged(arm, about(axis, angle))
        arm = length_m * X
    body = RigidBody(body.turning, body.at(arm))
    return Ride(body, rest_s).mounted(anyhow(random))


def _move(random: np.random.Generator, change: FloatArray) -> list[list[Piece]]:
    fastest = random.uniform(0.15, 1.0) * ARM_FASTEST
    seconds = max(0.3, 1.875 * float(np.abs(change).sum()) / fastest)
    stop_s = random.choice([0.02, random.uniform(0.1, 3.0)])
    return [[Piece(seconds, step=step), Piece(stop_s)] for step in change]


def _arc(random: np.random.Generator) -> list[list[Piece]]:
    rate = math.radians(random.uniform(40.0, 180.0)) * random.choice([-1.0, 1.0])
    seconds = random.uniform(4.0, 12.0)
    base = [
        Piece(1.0, end_rate=rate),
        Piece(seconds, start_rate=rate, end_rate=rate),
        Piece(1.0, start_rate=rate),
    ]
    return [base, *([Piece(seconds + 2.0)] for _ in ARM_JOINTS[1:])]


LATERAL_M_S2 = 2.5  # at most, in a turn
FASTEST_M_S = 25.0


def vehicle(random: np.random.Generator) -> Ride:
    """A vehicle: up to 25 m/s, turns of 5 to 40 s with up to 2.5 m/s2 sideways, stops,
    slopes, sway of its springs and vibration.
    """
    seconds, rest_s = random.uniform(*SECONDS), random.uniform(*REST_S)
    speeds, turns, passed = [Piece(rest_s)], [Piece(rest_s)], rest_s
    speed, turn = 0.0, 0.0
    while passed < seconds:
        faster = random.choice([0.0, *random.uniform(3.0, FASTEST_M_S, 4)])
        sideways = random.uniform(0.3, LATERAL_M_S2) * random.choice([-1.0, 0.0, 1.0])
        following = sideways / faster if faster else 0.0
        following = float(np.clip(following, -0.7, 0.7))
        ramp = max(1.5, abs(faster - speed) / random.uniform(0.5, 1.5))
        hold = random.uniform(5.0, 40.0) if faster else random.uniform(2.0, 6.0)
        speeds += [Piece(ramp, step=faster - speed), Piece(hold)]
        turns.append(Piece(ramp, start_rate=turn, end_rate=following))
        turns.append(Piece(hold, start_rate=following, end_rate=following))
        passed, speed, turn = passed + ramp + hold, faster, following
    t = times(seconds)
    course = about(Z, joined(turns, t))
    velocity = joined(speeds, t)
    busy = scaled(velocity, 1.0 / FASTEST_M_S)
    road = driven(
        RigidBody.still(facing(random), len(t)).turning.then(course), velocity
    )
    sway = busy * Waves.draw(random, [(0.02, 0.1, 0.03), (0.3, 2.0, 0.01)]).at(t)
    turning = road.turning
    for index, axis in enumerate((X, Y)):
        turning = turning.then(about(axis, component(sway, index)))
    shaking = Waves.draw(random, [(0.5, 2.0, 0.01), (10.0, 25.0, 4e-5)]).at(t)
    body = RigidBody(turning, road.place + busy * shaking)
    body = RigidBody(turning, body.at(random.uniform(-1.0, 1.0, 3)))
    return Ride(body, rest_s).mounted(anyhow(random))


def driven(turning: Turning, speed: Curve) -> RigidBody:
    """A body that moves along its x axis, at a speed in m/s, and turns as given.

    Its place is integrated from the exact velocity and acceleration.
    """
    ahead = RigidBody(turning, speed.along(np.zeros(3))).at(X)
    velocity = speed * ahead
    step_s = 1.0 / RATE_HZ
    mean = 0.5 * (velocity.value[1:] + velocity.value[:-1])
    bend = step_s / 12.0 * (velocity.first[:-1] - velocity.first[1:])
    place = np.cumsum(step_s * (mean + bend), axis=0)
    place = np.concatenate([np.zeros((1, 3)), place])
    return RigidBody(turning, Curve(place, velocity.value, velocity.first))


def component(curve: Curve, index: int) -> Curve:
    """One component of a curve of vectors."""
    pick = slice(index, index + 1)
    return Curve(curve.value[:, pick], curve.first[:, pick], curve.second[:, pick])
