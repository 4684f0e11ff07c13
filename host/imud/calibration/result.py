# SPDX-License-Identifier: MIT
"""The result of a calibration: new params, and figures for the report."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from imud.calibration.affine import Affine
from imud.calibration.magnetometer import MagFit
from imud.calibration.mount import MountTold
from imud.calibration.recording import Scale
from imud.calibration.tip_found import TipFound
from imud.params.value import Params
from imud.rotation import FloatArray

# The wire's largest residuals, m/s2 and rad.
ACC_RESIDUAL_MAX, GYR_RESIDUAL_MAX = 6.5, 0.65


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """New params, and the figures behind them."""

    params: Params
    sensors: tuple[str, ...]  # the recalibrated ones
    poses: int = 0
    seconds: float = 0.0
    temperature_c: float | None = None
    tilt_deg: float | None = None  # one-sigma errors to expect
    heading_deg: float | None = None
    level_ut: float | None = None  # of the field; the heading's error scales with it
    housing_deg: float | None = None  # by how much the sensor is turned in its housing
    note: str | None = None  # peculiarities of the room
    tip: TipFound | None = None
    mount: MountTold | None = None  # how the module is mounted
    missing: tuple[str, ...] = ()  # what it may not be used for, and what would help


def with_mag(
    params: Params,
    mag: MagFit,
    field_deg: float,
    into: FloatArray,
    scale: Scale,
    made: dict[str, Any],
) -> Params:
    """The params with the record of the magnetometer, turned `into` the housing."""
    own = {
        "sigma_uT": math.radians(field_deg) * mag.level_ut,
        "residual_uT": mag.residual_ut,
        "norm_uT": mag.norm_ut,
        "dip_deg": mag.dip_deg,
        "lag_s": mag.lag_s,
    }
    affine = Affine(into @ mag.matrix, mag.bias)
    return with_sensor(params, "mag", affine, scale, made | own)


_LIMITS = {"residual_m_s2": ACC_RESIDUAL_MAX, "residual_rad": GYR_RESIDUAL_MAX}


def with_sensor(
    params: Params, name: str, affine: Affine, scale: Scale, values: dict[str, Any]
) -> Params:
    """The params with the record of a sensor, with `values` by their keys; residuals
    are limited to the wire's maximum. The drift of an accelerometer is kept.
    """
    unit = {"acc": scale.acc_m_s2, "gyr": scale.gyr_rad_s, "mag": scale.mag_ut}[name]
    shown = {
        key: min(value, _LIMITS[key]) if key in _LIMITS else value
        for key, value in values.items()
    }
    before = params.acc if name == "acc" else None
    kept = {} if before is None else {"drift_m_s2_k": before.drift_m_s2_k}
    return params.replaced(
        name,
        {
            **kept,
            **shown,
            "bias_counts": (affine.bias / unit).tolist(),
            "matrix": affine.matrix.tolist(),
        },
    )
