# SPDX-License-Identifier: MIT
"""A hand that finds the tip: it stands the tip in a dimple, holds it still and wobbles
the probe about it, over and over.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.calibration.algebra import onto, units
from imud.calibration.path import UP
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody, held
from imud.virtual.curves import STEP, Curve, Turning, Waves, about, shape
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module
from imud.virtual.sensors import World
from imud.virtual.stroking import SWAYS

PIECE_S = 1.0
RAMP_S = 0.8  # in which a wobble grows and ends
TIP_M = (0.118, 0.006, -0.014)  # of the virtual probe, from its sensor

NO_TREMOR = ((1.0, 2.0, 0.0),)

# A slipping tip wanders about in the dimple, at these rates in Hz.
SLIP_HZ = (0.3, 3.0)


@dataclass(frozen=True, slots=True)
class Wobble:
    """How a hand wobbles a probe, and the base under the tip.

    A soft base lets the tip move along by a share of the sensor's way aside, later by
    the loss angle: 2 to 20 degrees for plastics and rubber.
    """

    hz: float = 0.8
    swing_deg: float = 25.0  # from the middle to each side
    twist_deg: float = 20.0  # about the probe's axis
    directions: int = 2  # 1: back and forth in one plane
    still_s: float = 5.0  # it leans on something, at the beginning
    pause_s: float = 3.0  # in the hand, before each wobble
    wobble_s: float = 30.0
    slip_m: float = 0.0  # rms of an axis aside
    give: float = 0.0  # of the base, a share of the way
    loss_deg: float = 8.0
    support: str | None = "paper"  # the hand's tremor, of SWAYS; None: it has none


# As `imud sim --hand` has them.
WOBBLES = {
    "dimple": Wobble(),
    "slip": Wobble(slip_m=0.001),
    "soft": Wobble(give=0.04),
}


class DimplingHand:
    """Makes the exact motion of a probe whose tip, at `tip_m` from the sensor, stands
    in a dimple at the origin.
    """

    def __init__(
        self,
        random: np.random.Generator,
        rate_hz: float,
        wobble: Wobble,
        tip_m: FloatArray,
    ) -> None:
        self._rate_hz, self._wobble, self._tip = rate_hz, wobble, tip_m
        bands = SWAYS[wobble.support].turn if wobble.support else NO_TREMOR
        self._tremor = Waves.draw(random, bands)
        self._slip = Waves.draw(random, [(*SLIP_HZ, wobble.slip_m)])
        upright = rotation.from_matrix(onto(units(tip_m), -UP))
        heading = rotation.from_rotation_vector(UP * random.uniform(-np.pi, np.pi))
        self._upright = rotation.multiply(heading, upright)
        # No hand keeps time: each of the three swings at a pace of its own.
        self._hz = wobble.hz * random.uniform(0.9, 1.1, 3)
        self._phase = random.uniform(0.0, 2.0 * np.pi, 3)
        self._wander = random.uniform(0.0, 2.0 * np.pi, 3)
        self._plane = random.uniform(0.0, np.pi)

    def pieces(self, world: World, seconds: float = PIECE_S) -> Iterator[Motion]:
        """The motion in pieces of `seconds`, without end."""
        count = round(seconds * self._rate_hz)
        for number in itertools.count():
            yield self._felt((number * count + np.arange(count)) / self._rate_hz, world)

    def _felt(self, t: FloatArray, world: World) -> Motion:
        body = RigidBody(self._turning(t), self._tip_path(t))
        place = body.at(-self._tip)
        turning = body.turning
        is_still = t < self._wobble.still_s
        return Motion(
            rate_hz=self._rate_hz,
            gyr=turning.rate,
            acc=RigidBody(turning, place).specific_force(),
            mag=rotation.rotate(
                rotation.inverse(turning.quat), world.field_at(place.value)
            ),
            quat=turning.quat,
            position=place.value,
            velocity=place.first,
            tip=body.place.value,
            movement=~is_still,
            is_rest=is_still,
            is_stroke=np.zeros(len(t), bool),
            is_recorded=False,
        )

    def _turning(self, t: FloatArray) -> Turning:
        wobble, taken = self._wobble, self._taken(t)
        sway = self._tremor.at(t)
        tilt = self._tilt(t, 0.0)
        turning = held(np.array([1.0, 0.0, 0.0, 0.0]), len(t))
        for axis in range(2):
            turning = turning.then(about(np.eye(3)[axis], _column(tilt, axis)))
        swing = self._swing(t, 2, math.radians(wobble.twist_deg), 0.0)
        turning = turning.then(about(UP, self._wobbling(t) * swing))
        for axis in range(3):
            shaken = taken * _column(sway, axis)
            turning = turning.then(about(np.eye(3)[axis], shaken))
        return turning.then(held(self._upright, len(t)))

    def _tilt(self, t: FloatArray, behind_rad: float) -> Curve:
        """About the two level axes of the world, rad, shape (n, 3)."""
        wobble, on = self._wobble, self._wobbling(t)
        swing = math.radians(wobble.swing_deg)
        first = on * self._swing(t, 0, swing, behind_rad)
        if wobble.directions == 1:
            x, y = math.cos(self._plane), math.sin(self._plane)
            return first.along(np.array([x, y, 0.0]))
        second = on * self._swing(t, 1, swing, behind_rad)
        x_axis, y_axis, _ = np.eye(3)
        return first.along(x_axis) + second.along(y_axis)

    def _swing(
        self, t: FloatArray, index: int, size: float, behind_rad: float
    ) -> Curve:
        """A sine whose pace wanders, shape (n, 1)."""
        beat = 2.0 * np.pi * self._hz[index] * t[:, None] + self._phase[index]
        slow = 0.7  # rad/s
        angle = slow * t[:, None] + self._wander[index]
        course = Curve(
            beat + 0.8 * np.sin(angle) - behind_rad,
            2.0 * np.pi * self._hz[index] + 0.8 * slow * np.cos(angle),
            -0.8 * slow**2 * np.sin(angle),
        )
        wave = course.through(np.sin, np.cos, lambda x: -np.sin(x))
        return Curve(size * wave.value, size * wave.first, size * wave.second)

    def _tip_path(self, t: FloatArray) -> Curve:
        """Where the tip is: at the origin, unless it slips or its base yields."""
        wobble = self._wobble
        on, none = self._wobbling(t), np.zeros((len(t), 3))
        path = Curve(none, none, none)
        if wobble.slip_m > 0.0:
            slip = on * self._slip.at(t)
            level = np.array([1.0, 1.0, 0.0])
            path = path + slip.along(level)
        if wobble.give > 0.0:
            # The sensor goes aside by the tilt's sine: about +y it goes along +x.
            tilt = self._tilt(t, math.radians(wobble.loss_deg))
            aside = tilt.through(np.sin, np.cos, lambda x: -np.sin(x))
            size = wobble.give * float(np.linalg.norm(self._tip))
            x, y = _column(aside, 0), _column(aside, 1)
            path = path + y.along(size * np.array([1.0, 0.0, 0.0]))
            path = path + x.along(size * np.array([0.0, -1.0, 0.0]))
        return path

    def _wobbling(self, t: FloatArray) -> Curve:
        """0 while it is held still, 1 in a wobble, shape (n, 1)."""
        wobble = self._wobble
        since = t - wobble.still_s
        whole = wobble.pause_s + wobble.wobble_s
        within = np.where(since < 0.0, 0.0, np.mod(since, whole)) - wobble.pause_s
        start = np.clip(within / RAMP_S, 0.0, 1.0)
        end = np.clip((wobble.wobble_s - within) / RAMP_S, 0.0, 1.0)
        rising = shape(STEP, start[:, None], RAMP_S)
        falling = shape(STEP, end[:, None], RAMP_S)
        return rising * Curve(falling.value, -falling.first, falling.second)

    def _taken(self, t: FloatArray) -> Curve:
        """0 while it leans on something, 1 in the hand, shape (n, 1)."""
        u = np.clip((t - self._wobble.still_s) / RAMP_S, 0.0, 1.0)
        return shape(STEP, u[:, None], RAMP_S)


def _column(curve: Curve, axis: int) -> Curve:
    pick = slice(axis, axis + 1)
    return Curve(curve.value[:, pick], curve.first[:, pick], curve.second[:, pick])


def pieces(name: str, module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion of a hand as a module measures it; `name`: one of WOBBLES."""
    random = np.random.default_rng([seed, 1])
    hand = DimplingHand(random, rate_hz, WOBBLES[name], np.array(TIP_M))
    sensor = module.sensor(rate_hz, np.random.default_rng([seed, 2]))
    return map(sensor.feel, hand.pieces(World(tip_m=TIP_M)))
