# SPDX-License-Identifier: MIT
"""Modules for virtual probes: straight from the shop or the data sheet, calibrated, or
from a file.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import FileError
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.text_file import read_text
from imud.virtual.motions.module import MG, Module
from imud.virtual.sensors import SensorErrors

SHOP, PAIR, CALIBRATED = "shop", "lsm6dsox", "calibrated"

# Noise of a good MPU-9250 at 92 Hz, and its errors before calibration.
NOISE = SensorErrors(0.08, 0.05 / MG, 0.5)
# Of an LSM6DSOX at 208 Hz and the driver's 16 g: 3.8 mdps and 110 ug in the root of a
# Hz (by memory of DS12814: 70, 75, 80 at 2, 4, 8 g; no copy was at hand), times its
# bandwidths of 67 and 104 Hz; of a LIS3MDL: 3.5 mgauss in ultra-high performance, which
# measures for 6.5 ms.
NOISE_OF_PAIR = SensorErrors(
    *(3.8e-3 * math.sqrt(66.8), 110e-3 * math.sqrt(104.2), 0.35),
    windows_s=(0.443 / 66.8, 0.443 / 104.2, 1.0 / 155.0),
)
WARM_S = 120.0  # time constant of warming up
WARM_DEGC = 5.0  # by how much


def warming(t: FloatArray) -> FloatArray:
    """How far a module has warmed up after `t` seconds: 0 to 1."""
    return np.asarray(-np.expm1(-t / WARM_S))


def calibrated() -> Module:
    """A module with noise and no other error."""
    same, none = np.eye(3), np.zeros(3)
    return Module(same, none, none, warming, same, none, same, none, noise=NOISE)


def shop(random: np.random.Generator, warm_degc: float = WARM_DEGC) -> Module:
    """An MPU-9250 module as shops sell it; `warm_degc`: how much it warms up.

    Accelerometer 25 mg and 1 %, gyroscope 1 %, 0.5 % cross and 2 deg/s, magnetometer
    15 to 45 uT of its own, 4 % of soft iron, a die turned by 1 degree, 12.5 ms late.
    """
    direction = random.standard_normal(3)
    mag = _magnetic(random)
    return Module(
        gyr=_crossed(random),
        gyr_bias=np.radians(random.uniform(-2.0, 2.0, 3)),
        drift=np.radians(random.normal(0.0, 0.08, 3)) * warm_degc,
        warming=warming,
        acc=_crossed(random),
        acc_bias=np.clip(random.normal(0.0, 25.0, 3), -60.0, 60.0) * MG,
        mag=mag,
        mag_bias=direction / np.linalg.norm(direction) * random.uniform(15.0, 45.0),
        noise=NOISE,
        acc_drift=random.normal(0.0, 0.5, 3) * MG * warm_degc,
        gyr_from_acc=np.radians(random.normal(0.0, 0.05, (3, 3))) / GRAVITY_M_S2,
        acc_floor=0.3 * MG,
        mag_lag_s=max(0.0, random.normal(0.0125, 0.002)),
    )


def pair(random: np.random.Generator, warm_degc: float = WARM_DEGC) -> Module:
    """An LSM6DSOX with a LIS3MDL (Adafruit 4517), as their documents have them: DS12814
    rev 3, as quoted, and AN4602 rev 1.

    Accelerometer 20 mg and 1 %, 0.1 mg a degree; gyroscope 1 deg/s and 1 %, 0.01 deg/s
    a degree; magnetometer up to 1 gauss of its own. Errors without a document are as in
    shop(): cross-axis terms, soft iron, a die turned by 1 degree.
    """
    mag = _magnetic(random)
    return Module(
        gyr=_crossed(random),
        gyr_bias=np.radians(random.uniform(-1.0, 1.0, 3)),
        drift=np.radians(random.normal(0.0, 0.01, 3)) * warm_degc,
        warming=warming,
        acc=_crossed(random),
        acc_bias=np.clip(random.normal(0.0, 20.0, 3), -60.0, 60.0) * MG,
        mag=mag,
        mag_bias=random.uniform(-100.0, 100.0, 3),
        noise=NOISE_OF_PAIR,
        acc_drift=random.normal(0.0, 0.1, 3) * MG * warm_degc,
    )


def _crossed(random: np.random.Generator) -> FloatArray:
    """Scale of 1 % and cross-axis terms of 0.5 %."""
    cross = random.normal(0.0, 0.005, (3, 3)) * (1.0 - np.eye(3))
    return np.diag(1.0 + random.normal(0.0, 0.01, 3)) + cross


def _magnetic(random: np.random.Generator) -> FloatArray:
    """Soft iron of 4 %, and a die turned by 1 degree."""
    iron = random.normal(0.0, 0.04, (3, 3))
    die = np.radians(random.normal(0.0, 1.0, 3))
    return np.asarray((np.eye(3) + (iron + iron.T) / 2.0) @ _turned(die))


def _turned(angle_rad: FloatArray) -> FloatArray:
    from imud import rotation

    return rotation.to_matrix(rotation.from_rotation_vector(angle_rad))


def named(name: str, seed: int) -> Module:
    """The module of that name: `shop` or `lsm6dsox` (drawn by the seed), `calibrated`,
    or a file. FileError if it can't be read.
    """
    if name == CALIBRATED:
        return calibrated()
    if name == SHOP:
        return shop(np.random.default_rng([seed, 0x5804]))
    if name == PAIR:
        return pair(np.random.default_rng([seed, 0x4517]))
    return of_file(Path(name))


# Keys of a file by table: the field of Module, what one of its unit is, and its shape.
KEYS: dict[str, dict[str, tuple[str, float, tuple[int, ...]]]] = {
    "acc": {
        "matrix": ("acc", 1.0, (3, 3)),
        "bias_mg": ("acc_bias", MG, (3,)),
        "drift_mg": ("acc_drift", MG, (3,)),
        "floor_mg": ("acc_floor", MG, ()),
    },
    "gyr": {
        "matrix": ("gyr", 1.0, (3, 3)),
        "bias_dps": ("gyr_bias", math.radians(1.0), (3,)),
        "drift_dps": ("drift", math.radians(1.0), (3,)),
        "from_acc_dps_g": ("gyr_from_acc", math.radians(1.0) / GRAVITY_M_S2, (3, 3)),
    },
    "mag": {
        "matrix": ("mag", 1.0, (3, 3)),
        "bias_uT": ("mag_bias", 1.0, (3,)),
        "lag_s": ("mag_lag_s", 1.0, ()),
    },
}


def of_file(path: Path) -> Module:
    """The module of a TOML file with tables acc, gyr and mag: docs/calibration.md."""
    if not path.exists():
        raise FileError(
            f"no module {path}: use {SHOP}, {PAIR}, {CALIBRATED}, or a file"
        )
    try:
        tables = tomllib.loads(read_text(path))
    except ValueError as error:
        raise FileError(f"{path} is not TOML: {error}") from error
    found: dict[str, Any] = {}
    for table, values in tables.items():
        if table not in KEYS or not isinstance(values, dict):
            raise FileError(f"{path}: there is no [{table}]; there are {_list(KEYS)}")
        for key, value in values.items():
            if key not in KEYS[table]:
                known = _list(KEYS[table])
                raise FileError(f"{path}: [{table}] has no {key}; it has {known}")
            name, unit, shape = KEYS[table][key]
            found[name] = _value(path, f"[{table}] {key}", value, shape) * unit
    return replace(calibrated(), **found)


def _value(path: Path, key: str, value: Any, shape: tuple[int, ...]) -> Any:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.array(math.nan)
    if array.shape != shape or not np.isfinite(array).all():
        what = {(3, 3): "3 rows of 3 numbers", (3,): "3 numbers", (): "a number"}[shape]
        raise FileError(f"{path}: {key} needs {what}")
    return array if shape else float(array)


def _list(names: dict[str, Any]) -> str:
    return ", ".join(names)
