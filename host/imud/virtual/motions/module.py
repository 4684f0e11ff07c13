# SPDX-License-Identifier: MIT
"""Errors of a sensor module: what it adds to exact motion, before it rounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.motion import GRAVITY_M_S2, Motion
from imud.virtual.sensors import SensorErrors

MG = GRAVITY_M_S2 / 1000.0
NOISE = SensorErrors()  # as in the MPU-9250's product specification


@dataclass(frozen=True, slots=True)
class Module:
    """What is wrong with a module. A matrix takes true vectors to measured ones."""

    gyr: FloatArray  # 3 x 3
    gyr_bias: FloatArray  # rad/s
    drift: FloatArray  # rad/s, by which the bias moves while the module warms up
    warming: Callable[[FloatArray], FloatArray]  # its course: 0 to 1 over time in s
    acc: FloatArray
    acc_bias: FloatArray  # m/s2
    mag: FloatArray
    mag_bias: FloatArray  # uT
    noise: SensorErrors = NOISE

    def measures(self, exact: Motion, random: np.random.Generator) -> Motion:
        """An exact motion as this module measures it."""
        t = np.arange(len(exact)) / exact.rate_hz
        true = np.stack([exact.gyr, exact.acc, exact.mag])
        matrices = np.stack([self.gyr, self.acc, self.mag])
        biases = np.stack([self.gyr_bias, self.acc_bias, self.mag_bias])
        felt = true @ matrices.swapaxes(1, 2) + biases[:, None]
        felt[0] += np.outer(self.warming(t), self.drift)
        sigma = self.noise.noise(exact.rate_hz)[:, None]
        felt += sigma * random.standard_normal(felt.shape)
        return replace(exact, gyr=felt[0], acc=felt[1], mag=felt[2])


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
    "small": SMALL.drawn,
    "large": LARGE.drawn,
    "crossed": crossed,
}
