# SPDX-License-Identifier: MIT
"""Rides about a fixed point: pendulums, and rests, rates and swings about one axis."""

from __future__ import annotations

import math

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.curves import Curve, Piece, about, joined
from imud.virtual.motions.ride import (
    ORIGIN,
    REST_S,
    Ride,
    X,
    Y,
    Z,
    anyhow,
    envelope,
    facing,
    phase,
    scaled,
    sine,
    times,
)

SECONDS = (80.0, 120.0)
RISE_S = 3.0  # from the rest to the full swing
SWELL, SWELL_HZ = 0.25, 0.02  # share by which the amplitude comes and goes


def swing(
    t: FloatArray, rest_s: float, rate_hz: float, degrees: float, mean_deg: float
) -> Curve:
    """A swing's angle in radians: it starts from 0 and swings about its mean."""
    since = phase(t, rate_hz, rest_s)
    swell = scaled(sine(phase(t, SWELL_HZ, rest_s)), SWELL, 1.0)
    angle = scaled(sine(since) * swell, math.radians(degrees), math.radians(mean_deg))
    return envelope(t, rest_s, RISE_S) * angle


def pendulum(random: np.random.Generator) -> Ride:
    """A rod of 0.3 to 1 m that swings about a level axis."""
    return _pendulum(random, axes=1)


def two_axis_pendulum(random: np.random.Generator) -> Ride:
    """A rod of 0.3 to 1 m on a joint with two axes, at nearly the same rate."""
    return _pendulum(random, axes=2)


def _pendulum(random: np.random.Generator, axes: int) -> Ride:
    t, rest_s = times(random.uniform(*SECONDS)), random.uniform(*REST_S)
    length_m = random.uniform(0.3, 1.0)
    own_hz = math.sqrt(GRAVITY_M_S2 / length_m) / (2.0 * np.pi)
    body = RigidBody.still(facing(random), len(t))
    for axis in (X, Y)[:axes]:
        angle = swing(
            t,
            rest_s,
            rate_hz=own_hz * random.uniform(0.85, 1.1),
            degrees=random.uniform(5.0, 60.0),
            mean_deg=random.uniform(-20.0, 20.0),
        )
        body = body.hinged(ORIGIN, about(axis, angle))
    arm = np.array([0.0, 0.0, -length_m * random.uniform(0.5, 1.0)])
    return Ride(RigidBody(body.turning, body.at(arm)), rest_s).mounted(anyhow(random))


def east_pendulum(random: np.random.Generator) -> Ride:
    """A pendulum whose axis is the sensor's z and points east: what turning about this
    axis cannot tell from a heading error is the sensor's own field along it.
    """
    t, rest_s = times(168.0), 8.0
    axes = np.stack([Y, Z, X], axis=-1)  # body x north, y up, z east
    body = RigidBody.still(rotation.from_matrix(axes), len(t))
    angle = swing(
        t,
        rest_s,
        rate_hz=0.67 * random.uniform(0.9, 1.1),
        degrees=random.uniform(40.0, 60.0),
        mean_deg=random.uniform(10.0, 30.0),
    )
    body = body.hinged(ORIGIN, about(Z, angle))
    return Ride(RigidBody(body.turning, body.at(-0.5 * Y)), rest_s)


def one_axis(random: np.random.Generator) -> Ride:
    """Ten minutes about one axis that keeps its direction: level, upright or slanted.

    It rests, turns at constant rates, turns by some angle, and swings back and forth.
    """
    t, rest_s = times(600.0), random.uniform(*REST_S)
    pieces, passed = [Piece(rest_s)], rest_s
    while passed < 600.0:
        added = ONE_AXIS_ACTS[random.integers(len(ONE_AXIS_ACTS))](random)
        pieces += added
        passed += sum(piece.seconds for piece in added)
    slant = random.choice([0.0, 0.5 * np.pi, random.uniform(0.2, 1.4)])
    axis = np.array([math.cos(slant), 0.0, math.sin(slant)])
    body = RigidBody.still(facing(random), len(t))
    body = body.hinged(ORIGIN, about(axis, joined(pieces, t)))
    arm = random.uniform(-0.06, 0.06, 3)
    return Ride(RigidBody(body.turning, body.at(arm)), rest_s).mounted(anyhow(random))


def _rest(random: np.random.Generator) -> list[Piece]:
    return [Piece(random.uniform(1.0, 8.0))]


def _round(random: np.random.Generator) -> list[Piece]:
    rate = math.radians(random.uniform(20.0, 300.0)) * random.choice([-1.0, 1.0])
    ramp_s = random.uniform(0.5, 2.0)
    return [
        Piece(ramp_s, end_rate=rate),
        Piece(random.uniform(3.0, 20.0), start_rate=rate, end_rate=rate),
        Piece(ramp_s, start_rate=rate),
    ]


def _step(random: np.random.Generator) -> list[Piece]:
    angle = math.radians(random.uniform(-180.0, 180.0))
    return [Piece(random.uniform(0.8, 3.0), step=angle)]


def _to_and_fro(random: np.random.Generator) -> list[Piece]:
    angle = math.radians(random.uniform(20.0, 120.0))
    seconds = random.uniform(0.6, 2.0)
    forth = [Piece(seconds, step=angle), Piece(seconds, step=-angle)]
    return forth * int(random.integers(3, 12))


ONE_AXIS_ACTS = (_rest, _round, _step, _to_and_fro, _to_and_fro)
