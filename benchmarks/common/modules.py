# SPDX-License-Identifier: MIT
"""Modules with random errors, as a calibration leaves them or as they are bought."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.motions.module import MG, Module
from imud.virtual.sensors import SensorErrors

# White noise of the rests of BROAD: 0.052 m/s2 and 0.084 deg/s of samples at 200 Hz.
NOISE = SensorErrors(0.0856, 5.4, 0.6, 0.0, 0.0, 0.0)
GYR_BIAS_DPS = 1.0

# Of chips: the accelerometer's density, ug, and the gyroscope's, mdps, in the root of a
# Hz. The rests of BROAD; PS-MPU-9250A-01 tables 1 and 2; DS12814 by memory, at the 16 g
# that the driver sets (70, 75 and 80 ug at 2, 4 and 8 g; no copy of the table could be
# read, but who measures an LSM6DSOX quotes 110, too); as Luxonis gives those of the
# LSM6DSV, without a range.
DENSITIES = {
    "BROAD": (530.0, 8.4),
    "MPU-9250": (300.0, 10.0),
    "LSM6DSOX": (110.0, 3.8),
    "LSM6DSV": (60.0, 2.8),
}


def noise_of(chip: str) -> SensorErrors:
    """White noise of one of these chips."""
    (acc, gyr), (acc_broad, gyr_broad) = DENSITIES[chip], DENSITIES["BROAD"]
    return replace(
        NOISE,
        gyr_noise_dps=NOISE.gyr_noise_dps * gyr / gyr_broad,
        acc_noise_mg=NOISE.acc_noise_mg * acc / acc_broad,
    )


ONE = np.eye(3)

# One sigma of scale of the accelerometer, of the gyroscope, of axes in deg, of the
# accelerometer's bias in mg.
MODULES: dict[str, tuple[float, float, float, float]] = {
    "calibrated": (0.0005, 0.0005, 0.05, 1.0),
    "gyroscope not": (0.0005, 0.01, 0.05, 1.0),
    "raw": (0.01, 0.01, 0.5, 20.0),
}


def module_of(
    kind: str,
    random: np.random.Generator,
    drift_dps_s: float = 0.0,
    chip: str = "BROAD",
) -> Module:
    """A module, whose gyroscope's bias drifts by so much each second (one sigma)."""
    acc, gyr, axes_deg, bias_mg = MODULES[kind]

    def matrix(scale: float) -> FloatArray:
        axes = random.normal(0.0, np.radians(axes_deg), (3, 3))
        return np.where(ONE > 0.0, 1.0 + random.normal(0.0, scale, (3, 3)), axes)

    def drift() -> FloatArray:
        if drift_dps_s == 0.0:
            return np.zeros(3)  # and nothing is drawn
        return np.radians(random.normal(0.0, drift_dps_s, 3))

    return Module(
        gyr=matrix(gyr),
        gyr_bias=np.radians(random.normal(0.0, GYR_BIAS_DPS, 3)),
        drift=drift(),
        warming=np.asarray,
        acc=matrix(acc),
        acc_bias=random.normal(0.0, bias_mg * MG, 3),
        mag=ONE,
        mag_bias=np.zeros(3),
        noise=noise_of(chip),
    )
