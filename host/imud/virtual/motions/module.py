# SPDX-License-Identifier: MIT
"""Errors of a sensor module: what it adds to exact motion, before it rounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.sensors import SensorErrors

MG = GRAVITY_M_S2 / 1000.0
NOISE = SensorErrors()  # as in the MPU-9250's product specification

NO_VECTOR = np.zeros(3)
NO_MATRIX = np.zeros((3, 3))


@dataclass(frozen=True, slots=True)
class Module:
    """The errors of a module. A matrix maps true vectors to measured ones."""

    gyr: FloatArray  # 3 x 3
    gyr_bias: FloatArray  # rad/s
    drift: FloatArray  # rad/s, by which the bias moves while the module warms up
    warming: Callable[[FloatArray], FloatArray]  # its course: 0 to 1 over time in s
    acc: FloatArray
    acc_bias: FloatArray  # m/s2
    mag: FloatArray
    mag_bias: FloatArray  # uT
    noise: SensorErrors = NOISE
    acc_drift: FloatArray = field(default_factory=NO_VECTOR.copy)  # as drift, m/s2
    gyr_from_acc: FloatArray = field(default_factory=NO_MATRIX.copy)  # rad/s a m/s2
    acc_floor: float = 0.0  # m/s2 rms of an axis, another one in each rest
    mag_lag_s: float = 0.0  # its readings are of so long ago

    def measures(self, exact: Motion, random: np.random.Generator) -> Motion:
        """An exact motion as this module measures it."""
        return self.sensor(exact.rate_hz, random).feel(exact)

    def sensor(self, rate_hz: float, random: np.random.Generator) -> SensorSimulator:
        """This module at work, on a motion of `rate_hz`."""
        return SensorSimulator(self, rate_hz, random)


class SensorSimulator:
    """A module at work: feels a motion piece by piece."""

    def __init__(
        self, module: Module, rate_hz: float, random: np.random.Generator
    ) -> None:
        self._module = module
        self._rate_hz = rate_hz
        self._random = random
        self._felt = 0  # records so far
        self._floor = NO_VECTOR
        self._is_rest = False
        self._field = np.zeros((0, 3))  # the latest of what the magnetometer is behind

    def feel(self, exact: Motion) -> Motion:
        """The next piece of an exact motion as the module measures it."""
        module, rate_hz = self._module, self._rate_hz
        t = (self._felt + np.arange(len(exact))) / rate_hz
        self._felt += len(exact)
        true = np.stack([exact.gyr, exact.acc, self._late(exact.mag)])
        matrices = np.stack([module.gyr, module.acc, module.mag])
        biases = np.stack([module.gyr_bias, module.acc_bias, module.mag_bias])
        felt = true @ matrices.swapaxes(1, 2) + biases[:, None]
        warmth = module.warming(t)
        felt[0] += np.outer(warmth, module.drift) + exact.acc @ module.gyr_from_acc.T
        felt[1] += np.outer(warmth, module.acc_drift) + self._floors(exact)
        sigma = module.noise.noise(rate_hz)[:, None]
        felt += sigma * self._random.standard_normal(felt.shape)
        return replace(exact, gyr=felt[0], acc=felt[1], mag=felt[2])

    def _late(self, mag: FloatArray) -> FloatArray:
        """The field as it was `mag_lag_s` ago; before the start as at the start."""
        behind = self._module.mag_lag_s * self._rate_hz
        if behind == 0.0:
            return mag
        keep = math.ceil(behind) + 1
        if len(self._field) == 0:
            self._field = np.repeat(mag[:1], keep, axis=0)
        known = np.concatenate([self._field, mag])
        self._field = known[-keep:]
        at = np.arange(len(mag)) + keep - behind
        places = np.arange(len(known))
        courses = [np.interp(at, places, known[:, axis]) for axis in range(3)]
        return np.stack(courses, axis=1)

    def _floors(self, exact: Motion) -> FloatArray:
        """The error that a rest does not average out; kept until the next one."""
        found = np.zeros((len(exact), 3))
        if self._module.acc_floor == 0.0 or exact.is_rest is None:
            return found
        is_rest = np.concatenate([[self._is_rest], exact.is_rest])
        self._is_rest = bool(is_rest[-1])
        begins = np.flatnonzero(~is_rest[:-1] & is_rest[1:])
        found[:] = self._floor
        for begin in begins:
            self._floor = self._random.normal(0.0, self._module.acc_floor, 3)
            found[begin:] = self._floor
        return found


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large errors are: from and to for shares, at most for the others."""

    gyr_share: tuple[float, float]  # of scale and of cross-axis
    gyr_bias_dps: float
    drift_dps: float
    acc_share: float
    acc_bias_mg: float
    mag_share: float
    mag_bias_ut: float

    def drawn(self, random: np.random.Generator) -> Module:
        """A module with errors of these sizes."""
        signs = random.choice([-1.0, 1.0], (3, 3))
        gyr = signs * random.uniform(*self.gyr_share, (3, 3))
        acc, mag = random.uniform(-1.0, 1.0, (2, 3, 3))
        gyr_bias, drift, acc_bias, mag_bias = random.uniform(-1.0, 1.0, (4, 3))
        constant_s = random.uniform(20.0, 120.0)
        return Module(
            gyr=np.eye(3) + gyr,
            gyr_bias=math.radians(self.gyr_bias_dps) * gyr_bias,
            drift=math.radians(self.drift_dps) * drift,
            warming=lambda t: -np.expm1(-t / constant_s),
            acc=np.eye(3) + self.acc_share * acc,
            acc_bias=MG * self.acc_bias_mg * acc_bias,
            # Soft iron: a symmetric matrix.
            mag=np.eye(3) + self.mag_share * 0.5 * (mag + mag.T),
            mag_bias=self.mag_bias_ut * mag_bias,
        )


# As a guided calibration leaves a module, and as those in phones are.
GOOD = Sizes((0.001, 0.003), 0.5, 0.1, 0.001, 1.0, 0.003, 0.3)
SMALL = Sizes((0.0, 0.01), 0.5, 0.1, 0.003, 3.0, 0.01, 0.5)
LARGE = Sizes((0.01, 0.04), 3.0, 0.5, 0.01, 10.0, 0.03, 3.0)


def crossed(_random: np.random.Generator) -> Module:
    """The module of the pendulum whose axis points east: its gyroscope sees a tenth of
    the rate about z in x, and drifts after the rest.
    """
    gyr = np.eye(3)
    gyr[:, 2] += 0.1, -0.07, 0.0
    gyr[2, :2] = 0.05
    return Module(
        gyr=gyr,
        gyr_bias=np.zeros(3),
        drift=math.radians(0.5) * np.array([0.3, 1.0, 0.3]),
        warming=lambda t: np.clip((t - 8.0) / 30.0, 0.0, 1.0),
        acc=np.eye(3),
        acc_bias=np.zeros(3),
        mag=np.eye(3),
        mag_bias=np.zeros(3),
        noise=SensorErrors(0.05, 0.05 / MG, 0.4),
    )


MODULES: dict[str, Callable[[np.random.Generator], Module]] = {
    "good": GOOD.drawn,
    "small": SMALL.drawn,
    "large": LARGE.drawn,
    "crossed": crossed,
}
