# SPDX-License-Identifier: MIT
"""Rides on people: a leg that walks or runs, and a hand that points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.curves import Curve, Piece, Waves, about, joined
from imud.virtual.motions.machines import component, driven
from imud.virtual.motions.ride import (
    ORIGIN,
    RATE_HZ,
    REST_S,
    Ride,
    X,
    Y,
    Z,
    anyhow,
    envelope,
    facing,
    scaled,
    sine,
    times,
)

SECONDS = (80.0, 120.0)
THIGH_M = 0.42


@dataclass(frozen=True, slots=True)
class Gait:
    """How a person moves. Ranges are from and to; angles are amplitudes."""

    speed_m_s: tuple[float, float]
    stride_hz: tuple[float, float]
    thigh_deg: tuple[float, float]
    knee_deg: tuple[float, float]
    bounce_m: tuple[float, float]
    impact_m: tuple[float, float]  # how far the ground pushes the shin within 10 ms


WALK = Gait((0.8, 1.6), (0.75, 1.05), (18, 26), (22, 30), (0.015, 0.025), (1e-3, 3e-3))
RUN = Gait((2.4, 4.0), (1.3, 1.5), (28, 38), (30, 42), (0.03, 0.05), (2e-3, 5e-3))


def walking(random: np.random.Generator) -> Ride:
    """The shin of a person walking at 0.8 to 1.6 m/s: 6 to 20 s straight or in an arc,
    then a stop of 0.5 to 4 s with a turn of up to 180 degrees.
    """
    return _leg(random, WALK)


def running(random: np.random.Generator) -> Ride:
    """The shin of a person running at 2.4 to 4 m/s, as in walking()."""
    return _leg(random, RUN)


def _leg(random: np.random.Generator, gait: Gait) -> Ride:
    seconds, rest_s = random.uniform(*SECONDS), random.uniform(*REST_S)
    stride_hz = random.uniform(*gait.stride_hz)
    going, strides, turns = [Piece(rest_s)], [Piece(rest_s)], [Piece(rest_s)]
    passed = rest_s
    while passed < seconds:
        stretch_s, stop_s = random.uniform(6.0, 20.0), random.uniform(0.5, 4.0)
        arc = math.radians(random.choice([0.0, random.uniform(-12.0, 12.0)]))
        about_turn = math.radians(random.uniform(-180.0, 180.0))
        whole = 1.0 + stretch_s + 1.0
        going += [Piece(1.0, step=1.0), Piece(stretch_s), Piece(1.0, step=-1.0)]
        going.append(Piece(stop_s))
        # Each stretch has whole strides, so that the next one begins alike.
        rate = round(stride_hz * (whole - 1.0)) / (whole - 1.0)
        strides += [Piece(1.0, end_rate=rate), Piece(stretch_s, 0.0, rate, rate)]
        strides += [Piece(1.0, start_rate=rate), Piece(stop_s)]
        turns += [Piece(whole, step=arc * whole), Piece(stop_s, step=about_turn)]
        passed += whole + stop_s
    t = times(seconds)
    busy, stride = joined(going, t), scaled(joined(strides, t), 2.0 * np.pi)
    start = RigidBody.still(facing(random), len(t)).turning
    course = start.then(about(Z, joined(turns, t)))
    hip = driven(course, scaled(busy, random.uniform(*gait.speed_m_s)))
    bounce = scaled(sine(scaled(stride, 2.0)), random.uniform(*gait.bounce_m))
    hip = RigidBody(course, hip.place + (busy * bounce).along(Z))
    shin = _shin(random, gait, hip, busy, stride)
    mount_m = np.array([0.03, 0.03, -random.uniform(0.1, 0.35)])
    return Ride(RigidBody(shin.turning, shin.at(mount_m)), rest_s).mounted(
        anyhow(random)
    )


def _shin(
    random: np.random.Generator, gait: Gait, hip: RigidBody, busy: Curve, stride: Curve
) -> RigidBody:
    """The shin below a hip; y is the axis of hip and knee, x points ahead."""
    thigh = scaled(sine(stride), math.radians(random.uniform(*gait.thigh_deg)))
    bend = math.radians(random.uniform(*gait.knee_deg))
    # The knee bends most while the leg swings forward, and a little at each step.
    knee = scaled(sine(scaled(stride, 1.0, -0.9)), bend, bend)
    knee = knee + scaled(sine(scaled(stride, 2.0, 0.6)), 0.25 * bend)
    body = hip.hinged(ORIGIN, about(Y, busy * thigh))
    body = body.hinged(-THIGH_M * Z, about(Y, busy * knee))
    t = times(len(busy.value) / RATE_HZ)
    wobble = busy * Waves.draw(random, [(0.5, 3.0, 0.04)]).at(t)
    turning = body.turning
    for index, axis in enumerate((X, Z)):
        turning = turning.then(about(axis, component(wobble, index)))
    push = scaled(impact(stride), random.uniform(*gait.impact_m))
    return RigidBody(turning, body.place + (busy * push).along(Z))


SHARPNESS = 200.0  # of an impact: 1/14 of a radian of the stride


def impact(stride: Curve) -> Curve:
    """A push of 0 to 1 that comes once a stride, smooth like a normal density."""

    def push(angle: FloatArray) -> FloatArray:
        return np.exp(SHARPNESS * (np.cos(angle) - 1.0))

    def first(angle: FloatArray) -> FloatArray:
        return -SHARPNESS * np.sin(angle) * push(angle)

    def second(angle: FloatArray) -> FloatArray:
        sine_2 = np.sin(angle) ** 2
        return SHARPNESS * (SHARPNESS * sine_2 - np.cos(angle)) * push(angle)

    return scaled(stride, 1.0, -2.0).through(push, first, second)


FASTEST = math.radians(300.0)  # rad/s at the peak of a turn
PEAK = 1.875  # of a least-jerk step's speed over its mean speed


def pointing(random: np.random.Generator) -> Ride:
    """A hand that points at targets within 60 degrees to each side and 40 up or down.

    The forearm turns about its elbow at up to 300 deg/s, rests on each target for 0.2
    to 3 s, and trembles.
    """
    seconds, rest_s = random.uniform(*SECONDS), random.uniform(*REST_S)
    reach = np.radians([60.0, 40.0, 25.0])
    angles: list[list[Piece]] = [[Piece(rest_s)] for _ in reach]
    aim, passed = np.zeros(3), rest_s
    while passed < seconds:
        target = random.uniform(-1.0, 1.0, 3) * reach
        change = target - aim
        shortest = PEAK * float(np.abs(change).sum()) / FASTEST
        turn_s = max(random.uniform(0.35, 1.2), shortest)
        hold_s = random.uniform(0.2, 3.0)
        for pieces, step in zip(angles, change, strict=True):
            pieces += [Piece(turn_s, step=step), Piece(hold_s)]
        aim, passed = target, passed + turn_s + hold_s
    t = times(seconds)
    grip = envelope(t, rest_s, 1.0)
    turning = RigidBody.still(facing(random), len(t)).turning
    for axis, pieces in zip((Z, Y, X), angles, strict=True):
        turning = turning.then(about(axis, joined(pieces, t)))
    sway = grip * Waves.draw(random, [(0.3, 2.0, 0.02), (8.0, 12.0, 0.001)]).at(t)
    for index, axis in enumerate((X, Y, Z)):
        turning = turning.then(about(axis, component(sway, index)))
    elbow = Waves.draw(random, [(0.3, 2.0, 0.005), (8.0, 12.0, 5e-5)]).at(t)
    body = RigidBody(turning, grip * elbow)
    arm = random.uniform(0.25, 0.6) * X
    return Ride(RigidBody(turning, body.at(arm)), rest_s).mounted(anyhow(random))
