# SPDX-License-Identifier: MIT
"""A hand that calibrates a probe: it lays it still, turns it, lays it still, as the
guided procedure asks, or as people do who ignore it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from imud import rotation
from imud.calibration.algebra import onto, units
from imud.calibration.guided.procedure import Procedure
from imud.calibration.path import UP
from imud.calibration.recording import COUNT_MAX, Sample, Scale
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.hand import HandMove, Stance
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module, SensorSimulator
from imud.virtual.sensors import NO_ERRORS, Magnet, MakeHand, Sway, World, stream

# Counts of a modelled MPU-9250 at 100 Hz, and the records of which each is the mean.
SCALE = Scale(
    16.0 * GRAVITY_M_S2 / 32768.0, math.radians(2000.0 / 32768.0), 0.15, 100.0
)
RECORDS_HZ = 500.0

# Sensors in a hand's middle: it turns about the probe. A probe is laid down anywhere.
PROBE = World(tip_m=(0.0, 0.0, 0.0))
IRON = Magnet((0.25, 0.1, -0.1), (2.4, -1.2, 0.8))  # a loudspeaker beside the table

SWAYING = 0.35  # rad of tilt rms of a lazy hand


@dataclass(slots=True)
class Manners:
    """How a hand lays a probe down."""

    stop_s: float = 2.0
    first_s: float = 0.0  # that the first stop lasts longer
    move_s: float = 2.0
    off_rad: float = math.radians(8.0)  # by which it misses a direction, rms of an axis
    is_held: bool = False  # it never lets go
    slope_rad: float = math.radians(0.5)  # of the table
    swerve_rad: float = 0.4  # rms of the detour of a turn
    place_m: float = 0.04  # rms of where it is laid
    lift_m: float = 0.12


class CalibratingHand:
    """Lays a probe with each direction of `ups` up: unit vectors in the body. Without a
    direction (None) it turns the probe by half a turn where it lies.
    """

    def __init__(
        self,
        random: np.random.Generator,
        rate_hz: float,
        ups: Iterable[FloatArray | None],
        manners: Manners,
    ) -> None:
        self._random = random
        self._rate_hz = rate_hz
        self._ups = iter(ups)
        self._manners = manners

    def moves(self) -> Iterator[HandMove]:
        """A rest in each direction, and the way there."""
        before: Stance | None = None
        for up in self._ups:
            stance = self._stance(up, before)
            if before is not None:
                yield self._move(before, stance, is_lifted=up is not None)
            rest_s = self._manners.stop_s
            rest_s += self._manners.first_s if before is None else 0.0
            before = stance
            records = round(rest_s * self._rate_hz)
            yield HandMove(stance, stance, records, is_rest=not self._manners.is_held)

    def _stance(self, up: FloatArray | None, before: Stance | None) -> Stance:
        random, manners = self._random, self._manners
        if up is None and before is not None:
            # The table's slope is that of the world: it turns under the probe.
            half = rotation.from_rotation_vector(
                UP * (math.pi + random.normal(0.0, math.radians(4.0)))
            )
            level = self._slope()
            flat = rotation.multiply(rotation.inverse(level), before.quat)
            quat = rotation.multiply(level, rotation.multiply(half, flat))
            return Stance(before.tip, quat, before.held, before.free)
        wanted = UP if up is None else up
        if wanted is not UP and not np.allclose(wanted, UP):
            missed = random.normal(0.0, manners.off_rad, 3)
            wanted = units(wanted + missed)
        heading = rotation.from_rotation_vector(UP * random.uniform(-math.pi, math.pi))
        quat = rotation.multiply(heading, rotation.from_matrix(onto(wanted, UP)))
        if np.allclose(wanted, UP):
            quat = rotation.multiply(self._slope(), quat)
        tip = random.normal(0.0, manners.place_m, 3)
        is_held = float(manners.is_held)
        return Stance(tip, quat, held=is_held, free=is_held)

    def _slope(self) -> FloatArray:
        """The table's."""
        return rotation.from_rotation_vector(
            np.array([self._manners.slope_rad, 0.0, 0.0])
        )

    def _move(self, start: Stance, end: Stance, *, is_lifted: bool) -> HandMove:
        random, manners = self._random, self._manners
        bend, swerve = np.zeros(3), np.zeros(3)
        if is_lifted:
            bend = random.normal(0.0, 0.06, 3) + UP * manners.lift_m
            swerve = random.normal(0.0, manners.swerve_rad, 3)
        records = round(manners.move_s * self._rate_hz)
        return HandMove(start, end, records, bend=bend, swerve=swerve)


@dataclass(slots=True)
class Follower:
    """A hand that follows a guided procedure of its own, which gets the probe's
    samples.
    """

    procedure: Procedure = field(default_factory=lambda: Procedure(SCALE, mount=None))
    is_lazy: bool = False
    random: np.random.Generator = field(default_factory=np.random.default_rng)

    def ups(self) -> Iterator[FloatArray | None]:
        """Where the procedure wants up to be, pose by pose; from the beginning again
        once it is over.
        """
        while True:
            if self.procedure.is_over:
                self.procedure = Procedure(SCALE, mount=None)
            if self.procedure.phase == "half_turn":
                yield None
            elif self.is_lazy:
                yield units(np.append(self.random.normal(0.0, SWAYING, 2), 1.0))
            else:
                yield self.procedure.wanted.up

    def hear(self, samples: Iterable[Sample]) -> None:
        """Takes the probe's samples."""
        for sample in samples:
            self.procedure.feed(sample)


def pieces(name: str, module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion of a hand as a module measures it; `name`: calibrate, lazy,
    air or iron, as `imud sim --hand` has them.
    """
    follower = Follower(is_lazy=name == "lazy", random=np.random.default_rng([seed, 1]))
    # A person waits for the first instruction; a board needs a second until it
    # measures.
    manners = Manners(first_s=2.0, is_held=name == "air")
    world = beside((IRON,) if name == "iron" else ())
    sampler = Sampler()
    for piece in felt_of(
        *(module, seed, rate_hz, world),
        lambda random, hz: CalibratingHand(random, hz, follower.ups(), manners),
    ):
        yield piece
        follower.hear(sampler.samples(piece))


def felt_of(
    module: Module,
    seed: int,
    rate_hz: float,
    world: World,
    make_hand: MakeHand,
    sway: Sway | None = None,
) -> Iterator[Motion]:
    """The motion of a hand as a module measures it, piece by piece."""
    sensor = SensorSimulator(module, rate_hz, np.random.default_rng([seed, 2]))
    return map(
        sensor.feel, stream(seed, rate_hz, world, NO_ERRORS, make_hand, sway or Sway())
    )


def beside(magnets: tuple[Magnet, ...]) -> World:
    """The world in which a probe is laid down and turned, beside these magnets."""
    return replace(PROBE, magnets=magnets)


class Sampler:
    """Makes raw samples of a motion, as a chip does: means, rounded to counts."""

    def __init__(self, scale: Scale = SCALE) -> None:
        self._scale = scale
        self._rest: Motion | None = None
        self._count = 0

    def samples(self, felt: Motion) -> Iterator[Sample]:
        """The samples of the next piece; the remainder is kept for the next one."""
        each = round(felt.rate_hz / self._scale.rate_hz)
        scale = self._scale
        gyr, acc, mag = felt.gyr, felt.acc, felt.mag
        if self._rest is not None:
            gyr = np.concatenate([self._rest.gyr, gyr])
            acc = np.concatenate([self._rest.acc, acc])
            mag = np.concatenate([self._rest.mag, mag])
        count = len(gyr) // each
        whole = count * each
        self._rest = Motion(felt.rate_hz, gyr[whole:], acc[whole:], mag[whole:])
        rows = np.hstack(
            [
                acc[:whole].reshape(count, each, 3).mean(axis=1) / scale.acc_m_s2,
                gyr[:whole].reshape(count, each, 3).mean(axis=1) / scale.gyr_rad_s,
                mag[each - 1 : whole : each] / scale.mag_ut,
            ]
        )
        counts = np.clip(np.rint(rows), -COUNT_MAX - 1, COUNT_MAX).astype(int)
        step_us = 1e6 / scale.rate_hz
        for ax, ay, az, gx, gy, gz, mx, my, mz in counts.tolist():
            self._count += 1
            yield Sample(
                round(self._count * step_us), (ax, ay, az), (gx, gy, gz), (mx, my, mz)
            )
