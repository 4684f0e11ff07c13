# SPDX-License-Identifier: MIT
"""Ways of a probe in a hand, on a desk and on foot, at any rate: tests of the filter
and benchmarks share them.

Each takes the times, s, and the random numbers that it draws. A way rests first, unless
it says otherwise.
"""

from __future__ import annotations

import math

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody, held
from imud.virtual.curves import Curve, Turning, about, shape
from imud.virtual.motions.ride import X, Y, Z, phase, scaled, sine

Random = np.random.Generator

DEGREE = math.pi / 180.0
RISE_S = 2.0  # from rest to the full motion
SMOOTH = np.polynomial.Polynomial([0.0, 0.0, 3.0, -2.0])


def begun(t: FloatArray, rest_s: float) -> Curve:
    """0 at rest, 1 two seconds later."""
    u = np.clip((t - rest_s) / RISE_S, 0.0, 1.0)
    found = shape(SMOOTH, u, RISE_S)
    is_rising = (u > 0.0) & (u < 1.0)
    second = np.where(is_rising, found.second, 0.0)
    return Curve(found.value[:, None], found.first[:, None], second[:, None])


def ended(t: FloatArray, end_s: float) -> Curve:
    """1 before, 0 two seconds later."""
    return scaled(begun(t, end_s), -1.0, 1.0)


def wandering(t: FloatArray, random: Random, hz: float) -> Curve:
    """Four slow sines about this frequency, 1 rms."""
    found = Curve(*np.zeros((3, len(t), 1)))
    for share in random.uniform(0.5, 1.5, 4):
        start = random.uniform(0.0, 2.0 * np.pi)
        found = found + sine(scaled(phase(t, hz * share), 1.0, start))
    return scaled(found, 1.0 / math.sqrt(2.0))


def turned(yaw: Curve, pitch: Curve, roll: Curve) -> Turning:
    """Turns about z, then y, then x, rad."""
    turning = held(rotation.IDENTITY, len(yaw.value))
    for axis, angle in ((Z, yaw), (Y, pitch), (X, roll)):
        turning = turning.then(about(axis, angle))
    return turning


def here(turning: Turning) -> RigidBody:
    """A body that turns in its place."""
    return RigidBody(
        turning, RigidBody.still(rotation.IDENTITY, len(turning.quat)).place
    )


def stacked(x: Curve, y: Curve, z: Curve) -> Curve:
    """Three scalar curves as one of vectors."""
    return x.along(X) + y.along(Y) + z.along(Z)


def steady(t: FloatArray, value: float = 0.0) -> Curve:
    """A scalar that does not change."""
    return Curve(np.full((len(t), 1), value), *np.zeros((2, len(t), 1)))


def _angles(
    t: FloatArray, random: Random, way: Curve, *each: tuple[float, float]
) -> list[Curve]:
    """Angles that wander by some degrees rms at some Hz."""
    return [
        scaled(way * wandering(t, random, hz), degrees * DEGREE) for degrees, hz in each
    ]


def in_hand(random: Random, t: FloatArray, rest_s: float = 8.0) -> RigidBody:
    """A hand that turns a probe by up to 150 deg/s."""
    way = begun(t, rest_s)
    yaw, pitch, roll = _angles(t, random, way, (60, 0.25), (35, 0.3), (35, 0.3))
    return here(turned(scaled(yaw, 1.0, random.uniform(-3, 3)), pitch, roll))


def about_all_axes(random: Random, t: FloatArray, rest_s: float = 20.0) -> RigidBody:
    """Turned slowly, by about 40 deg/s."""
    way = begun(t, rest_s)
    yaw, pitch, roll = _angles(t, random, way, (60, 0.08), (25, 0.08), (25, 0.08))
    return here(turned(scaled(yaw, 1.0, random.uniform(-3, 3)), pitch, roll))


def about_one_axis(random: Random, t: FloatArray, rest_s: float = 20.0) -> RigidBody:
    """Turned slowly about x, which is level: 35 degrees rms at 0.1 Hz."""
    way = begun(t, rest_s)
    pitch, yaw = _angles(t, random, way, (2, 0.2), (2, 0.2))
    (roll,) = _angles(t, random, way, (35, 0.1))
    return here(turned(scaled(yaw, 1.0, random.uniform(-3, 3)), pitch, roll))


def carried(random: Random, t: FloatArray, rest_s: float = 8.0) -> RigidBody:
    """Carried back and forth by 0.25 m rms at 0.8 Hz, hardly turned."""
    way = begun(t, rest_s)
    wander = [way * wandering(t, random, 0.8) for _ in range(6)]
    place = scaled(stacked(*wander[:3]), 0.25)
    yaw, pitch, roll = (scaled(each, 3.0 * DEGREE) for each in wander[3:])
    yaw = scaled(yaw, 1.0, random.uniform(-3, 3))
    return RigidBody(turned(yaw, pitch, roll), place)


STEP_HZ = 0.9
LEG_M = 0.35  # from the hip to the pocket


def walking(random: Random, t: FloatArray, rest_s: float = 6.0) -> RigidBody:
    """In a pocket: a leg's swing at 0.9 Hz, about a room of some metres."""
    way = begun(t, rest_s)
    amplitude = random.uniform(15, 30) * DEGREE
    swing = scaled(way * sine(phase(t, STEP_HZ)), amplitude)
    bounce = sine(phase(t, 2.0 * STEP_HZ))
    (yaw,) = _angles(t, random, way, (120, 0.05))
    roll = scaled(way * bounce, 4.0 * DEGREE, 70.0 * DEGREE)
    x, y = (scaled(way * wandering(t, random, 0.06), 1.2) for _ in range(2))
    rise = scaled(way * sine(phase(t, 2.0 * STEP_HZ, cycles=0.25)), 0.03)
    x = x + scaled(sine(swing), LEG_M)
    up = rise + scaled(
        swing.through(np.cos, lambda a: -np.sin(a), lambda a: -np.cos(a)), -LEG_M, LEG_M
    )
    return RigidBody(turned(yaw, swing, roll), stacked(x, y, up))


def turned_slowly(random: Random, t: FloatArray, rate_deg_s: float) -> RigidBody:
    """A turntable or a ship: turns about the vertical from power-on for 30 s, lies for
    20 s, then is in a hand.
    """
    way = begun(t, 50.0)
    yaw, pitch, roll = _angles(t, random, way, (60, 0.3), (35, 0.3), (35, 0.3))
    rate = np.where(t < 30.0, rate_deg_s * DEGREE, 0.0)[:, None]
    angle = rate_deg_s * DEGREE * np.minimum(t, 30.0)[:, None]
    turn = Curve(angle, rate, np.zeros_like(rate))
    return here(turned(turn + yaw, pitch, roll))


def laid_down(random: Random, t: FloatArray, rest_s: float = 8.0) -> RigidBody:
    """17 s in a hand, then at rest."""
    way = begun(t, rest_s) * ended(t, rest_s + 17.0)
    yaw, pitch, roll = _angles(t, random, way, (60, 0.25), (35, 0.25), (35, 0.25))
    yaw = scaled(yaw, 1.0, random.uniform(-3, 3))
    return here(turned(yaw, scaled(pitch, 1.0, 0.3), roll))
