# SPDX-License-Identifier: MIT
"""The simulated world and sensors: the readings of a probe in a moving hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody, held
from imud.virtual.curves import BUMP, STEP, Curve, Turning, Waves, about, blend, shape
from imud.virtual.hand import Hand, HandMove
from imud.virtual.motion import Motion, join

# Five records a sample of the chip at 200 Hz: its averaging sees a smooth motion.
HAND_RATE_HZ = 1000.0

# The simulated MPU-9250 averages over 0.443/f seconds, as its low-pass does. The input
# noise is stronger by as much, so the output has the data sheet's noise.
NOISE_WINDOW_S = 0.443 / 92.0


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Noise (rms) and offsets that a sensor adds. Each offset is drawn evenly between
    minus and plus its value.

    The defaults are from the MPU-9250's product specification, revision 1.1, tables 1
    and 2 (total noise at 92 Hz, zero-rate and zero-g output), and from real rests.
    """

    gyr_noise_dps: float = 0.1
    acc_noise_mg: float = 8.0
    mag_noise_ut: float = 0.6
    gyr_offset_dps: float = 3.0
    acc_offset_mg: float = 60.0
    mag_offset_ut: float = 0.0  # of a calibrated magnetometer
    # Over which each averages. The AK8963 measures one instant.
    windows_s: tuple[float, float, float] = (NOISE_WINDOW_S, NOISE_WINDOW_S, 0.0)

    def noise(self, rate_hz: float) -> FloatArray:
        """Of records at this rate, SI units (uT): a row for each sensor."""
        noise = np.array([self.gyr_noise_dps, self.acc_noise_mg, self.mag_noise_ut])
        averaged = np.sqrt(np.maximum(1.0, rate_hz * np.array(self.windows_s)))
        return np.asarray((noise * averaged)[:, None] * SI)


# One deg/s, mg and uT, as rows.
SI = np.array([[math.radians(1.0)], [GRAVITY_M_S2 / 1000.0], [1.0]])

NO_ERRORS = SensorErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Magnet:
    """A magnetic dipole at a fixed place in the world."""

    position_m: tuple[float, float, float]
    moment_a_m2: tuple[float, float, float]

    def field_ut(self, position: FloatArray) -> FloatArray:
        """Its field at points of the world: shape (n, 3), m in and uT out."""
        moment = np.array(self.moment_a_m2)
        away = position - np.array(self.position_m)
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        along = away / distance
        # mu0/4pi = 1e-7 T m/A
        parts = 3.0 * along * (along @ moment)[..., None] - moment
        return np.asarray(0.1 * parts / distance**3)


@dataclass(frozen=True, slots=True)
class World:
    """Where the hand works: Earth's field, nearby magnets, and the probe's length."""

    field_ut: float = 49.0
    dip_deg: float = 66.0  # the field points down by this, as in central Europe
    magnets: tuple[Magnet, ...] = ()
    tip_m: tuple[float, float, float] = (0.12, 0.0, 0.0)  # from the sensor, body frame
    # How the field changes from the origin on, a row for each axis of the world, uT/m.
    gradient_ut_m: tuple[tuple[float, float, float], ...] = ()

    def field_at(self, position: FloatArray) -> FloatArray:
        """The magnetic field at points of the world: shape (n, 3), m in and uT out."""
        dip = math.radians(self.dip_deg)
        earth = self.field_ut * np.array([0.0, math.cos(dip), -math.sin(dip)])
        total = np.broadcast_to(earth, position.shape)
        for magnet in self.magnets:
            total = total + magnet.field_ut(position)
        if self.gradient_ut_m:
            total = total + position @ np.array(self.gradient_ut_m).T
        return total


# Lowest and highest Hz, and rms, of a part of a sway.
Band = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Sway:
    """How a hand sways and trembles: a slow sway, and the physiological tremor of 8 to
    12 Hz. The grain of the surface under the tip: micrometres at tens of Hz.
    """

    turn: tuple[Band, ...] = ((0.3, 2.0, 0.02), (8.0, 12.0, 0.001))  # rad
    tip: tuple[Band, ...] = ((0.3, 2.0, 0.003), (8.0, 12.0, 5e-5))  # m
    grain_m: float = 4e-6


class Legs(Protocol):
    """A hand, as a series of moves."""

    def moves(self) -> Iterator[HandMove]:
        """Its next move; each begins where the previous one ended."""


# Makes a hand from its random numbers and the rate of the records, Hz.
MakeHand = Callable[[np.random.Generator, float], Legs]


def random_of_hand(seed: int) -> np.random.Generator:
    """The numbers by which the hand of a motion with this seed decides."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[0])


class _Probe:
    """Turns moves into records: exact motion first, then the sensor's errors."""

    def __init__(
        self,
        seed: int,
        rate_hz: float,
        world: World,
        errors: SensorErrors,
        make_hand: MakeHand,
        manner: Sway,
    ) -> None:
        _, sway_seed, noise_seed = np.random.SeedSequence(seed).spawn(3)
        self.hand = make_hand(random_of_hand(seed), rate_hz)
        sway = np.random.default_rng(sway_seed)
        self.turn_sway = Waves.draw(sway, manner.turn)
        self.tip_sway = Waves.draw(sway, manner.tip)
        self.grain = Waves.draw(sway, [(20.0, 60.0, manner.grain_m)])
        self.noise = np.random.default_rng(noise_seed)
        self.rate_hz = rate_hz
        self.world = world
        self.errors = errors
        spread = np.array(
            [[errors.gyr_offset_dps], [errors.acc_offset_mg], [errors.mag_offset_ut]]
        )
        self.offset = self.noise.uniform(-1.0, 1.0, (3, 3)) * spread * SI
        self.sigma = errors.noise(rate_hz)

    def motions(self) -> Iterator[Motion]:
        """Endless motions, one a move."""
        begun = 0
        for move in self.hand.moves():
            yield self._feel(move, begun)
            begun += move.records

    def _feel(self, move: HandMove, begun: int) -> Motion:
        count = move.records
        t = (begun + np.arange(count)) / self.rate_hz
        u = np.arange(count) / count
        span = count / self.rate_hz
        step = shape(STEP, u[:, None], span)
        bump = shape(BUMP, u[:, None], span)

        turning = self._attitude(move, t, step, bump)
        tip = self._tip_path(move, t, step, bump)
        place = RigidBody(turning, tip).at(-np.array(self.world.tip_m))
        field = self.world.field_at(place.value)
        felt = np.stack(
            [
                turning.rate,
                RigidBody(turning, place).specific_force(),
                rotation.rotate(rotation.inverse(turning.quat), field),
            ],
            axis=1,
        )
        felt += self.offset + self.sigma * self.noise.standard_normal(felt.shape)
        return Motion(
            rate_hz=self.rate_hz,
            gyr=felt[:, 0],
            acc=felt[:, 1],
            mag=felt[:, 2],
            quat=turning.quat,
            position=place.value,
            velocity=place.first,
            tip=tip.value,
            movement=np.full(count, begun > 0),
            is_rest=np.full(count, move.is_rest),
            is_stroke=np.full(count, move.is_stroke),
            is_recorded=False,
        )

    def _attitude(
        self, move: HandMove, t: FloatArray, step: Curve, bump: Curve
    ) -> Turning:
        change = rotation.to_rotation_vector(
            rotation.multiply(rotation.inverse(move.start.quat), move.end.quat)
        )
        turning = held(move.start.quat, len(t)).then(about(change, step))
        if move.swerve.any():
            turning = turning.then(about(move.swerve, bump))
        if move.start.held == move.end.held == 0.0:
            return turning
        sway = blend(move.start.held, move.end.held, step) * self.turn_sway.at(t)
        for index, axis in enumerate(np.eye(3)):
            pick = slice(index, index + 1)
            angle = Curve(
                sway.value[:, pick], sway.first[:, pick], sway.second[:, pick]
            )
            turning = turning.then(about(axis, angle))
        return turning

    def _tip_path(
        self, move: HandMove, t: FloatArray, step: Curve, bump: Curve
    ) -> Curve:
        still = np.zeros((len(t), 3))
        start = Curve(np.broadcast_to(move.start.tip, (len(t), 3)), still, still)
        path = start + step.along(move.end.tip - move.start.tip) + bump.along(move.bend)
        if move.start.free != 0.0 or move.end.free != 0.0:
            sway = blend(move.start.free, move.end.free, step) * self.tip_sway.at(t)
            path = path + sway
        if move.is_stroke:
            path = path + bump * self.grain.at(t)
        return path


def stream(
    seed: int,
    rate_hz: float = HAND_RATE_HZ,
    world: World | None = None,
    errors: SensorErrors | None = None,
    make_hand: MakeHand = Hand,
    sway: Sway = Sway(),
) -> Iterator[Motion]:
    """A motion of a hand-held probe, in pieces. The usual hand never ends: rests,
    strokes, turns, grips; it starts with 3 to 5 s of rest.

    The same seed gives the same motion.
    """
    return _Probe(
        seed, rate_hz, world or World(), errors or SensorErrors(), make_hand, sway
    ).motions()


def generate(
    seconds: float,
    seed: int,
    rate_hz: float = HAND_RATE_HZ,
    world: World | None = None,
    errors: SensorErrors | None = None,
) -> Motion:
    """The first `seconds` of `stream` as one motion."""
    records = max(1, round(seconds * rate_hz))
    pieces: list[Motion] = []
    gathered = 0
    for piece in stream(seed, rate_hz, world, errors):
        pieces.append(piece)
        gathered += len(piece)
        if gathered >= records:
            break
    return join(pieces)[:records]
