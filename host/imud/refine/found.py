# SPDX-License-Identifier: MIT
"""The calibration that a window finds with its poses, its errors, and the params that a
person can take.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from imud.calibration.affine import Affine, affine_of
from imud.calibration.algebra import closest_turn, row_slopes
from imud.calibration.recording import Scale
from imud.calibration.result import with_sensor
from imud.calibration.score import ATTITUDES, HIDDEN_TILT_DEG, TILT_TO_HEADING
from imud.gravity import GRAVITY_M_S2
from imud.params.learned import METHOD
from imud.params.value import SENSORS, Params
from imud.refine.model import (
    ACC,
    ACC_BIAS,
    BIAS,
    GYR,
    LAG,
    MAG,
    NORTH,
    OWN,
    STATE,
    WHOLE,
    Priors,
)
from imud.refine.window import Window
from imud.rotation import FloatArray

# Of the error that was known before: what is found less surely is left as it was.
BETTER = 0.7


@dataclass(frozen=True, slots=True)
class Found:
    """True vector = matrix @ (reading - bias) at the window's end, in axes in which the
    accelerometer's matrix is symmetric. Errors are one sigma, over all attitudes.
    """

    acc: Affine
    gyr: Affine
    mag: Affine
    tilt_deg: float
    field_deg: float  # of heading: the magnetometer's part
    gyr_sigma: float | None
    north_ut: float  # of the place's field
    up_ut: float
    lag_s: float

    @property
    def heading_deg(self) -> float:
        """With the tilt's part."""
        return math.hypot(TILT_TO_HEADING * self.tilt_deg, self.field_deg)

    @property
    def norm_ut(self) -> float:
        return math.hypot(self.north_ut, self.up_ut)

    @property
    def own_sigma_ut(self) -> float:
        """The error of the magnetometer that turns the heading as much."""
        return math.radians(self.field_deg) * self.north_ut

    def values(self, name: str) -> dict[str, Any]:
        """What the params keep of a sensor beside its matrix and bias."""
        if name == "acc":
            return {
                "sigma_m_s2": math.radians(self.tilt_deg) * GRAVITY_M_S2 / math.sqrt(2)
            }
        if name == "gyr":
            return {"sigma": self.gyr_sigma}
        return {
            "sigma_uT": self.own_sigma_ut,
            "norm_uT": self.norm_ut,
            "dip_deg": math.degrees(math.atan2(-self.up_ut, self.north_ut)),
            "lag_s": self.lag_s,
        }


def found_by(window: Window, mag_early_s: float = 0.0) -> Found:
    """What the window tells, once its search is over. `mag_early_s`: by which readings
    of the magnetometer are before the ends of their samples.
    """
    estimate, covariance = window.estimate, window.solution.last_covariance()
    acc = estimate.matrix(ACC)
    # Nothing shows how all three sensors are turned in common.
    back = closest_turn(acc).T
    north, up = estimate.whole[NORTH].tolist()
    tilt, field = (
        math.degrees(
            math.sqrt(float((slopes @ covariance * slopes).sum(axis=-1).mean()))
        )
        for slopes in (_tilts(acc), _headings(north, up))
    )
    sigmas = np.sqrt(np.diag(covariance))
    return Found(
        Affine(back @ acc, estimate.whole[ACC_BIAS]),
        Affine(back @ estimate.matrix(GYR), estimate.states[-1, BIAS]),
        Affine(back @ np.linalg.inv(estimate.matrix(MAG)), estimate.states[-1, OWN]),
        math.hypot(HIDDEN_TILT_DEG, math.sqrt(2.0) * tilt),
        field,
        float(np.sqrt((sigmas[_shared(GYR)] ** 2).mean())),
        north,
        up,
        max(0.0, float(estimate.whole[LAG][0]) - mag_early_s),
    )


def _shared(columns: slice) -> slice:
    """What holds for all, behind the last node's state."""
    return slice(columns.start + STATE, columns.stop + STATE)


def _split(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives by a matrix's entries as those by its symmetric part, and by what is
    left: a turn.
    """
    entries = slopes.reshape(*slopes.shape[:-1], 3, 3)
    other = np.swapaxes(entries, -1, -2)
    parts = (entries + other) / 2.0, (entries - other) / 2.0
    one, turn = (part.reshape(slopes.shape) for part in parts)
    return one, turn


def _tilts(acc: FloatArray) -> FloatArray:
    """Derivatives of the level that a resting sensor shows, along two axes across up,
    (attitudes, 2, columns).
    """
    into_body = np.swapaxes(ATTITUDES, 1, 2)
    slopes = np.zeros((len(into_body), 3, STATE + WHOLE))
    slopes[..., _shared(ACC_BIAS)] = -acc / GRAVITY_M_S2
    slopes[..., _shared(ACC)], _ = _split(row_slopes(into_body[:, :, 2]))
    return np.asarray(np.swapaxes(into_body[:, :, :2], 1, 2) @ slopes)


def _headings(north: float, up: float) -> FloatArray:
    """Derivatives of the heading that the field shows, (attitudes, 1, columns)."""
    into_body = np.swapaxes(ATTITUDES, 1, 2)
    slopes = np.zeros((len(into_body), 3, STATE + WHOLE))
    of_field = row_slopes(into_body @ np.array([north, 0.0, up]))
    slopes[..., OWN] = np.eye(3)
    slopes[..., _shared(MAG)] = of_field
    _, slopes[..., _shared(ACC)] = _split(of_field)
    # The level field points along x: what is across turns the heading.
    return np.asarray(into_body[:, None, :, 1] @ slopes / north)


def taken(
    params: Params,
    names: Iterable[str],
    found: Found,
    base: Params,
    scale: Scale,
    made: dict[str, Any],
) -> Params:
    """The params with these sensors as found in readings that `base` has calibrated.
    `made`: day and temperature.
    """
    lsb = {"acc": scale.acc_m_s2, "gyr": scale.gyr_rad_s, "mag": scale.mag_ut}
    for name in names:
        own: Affine = getattr(found, name)
        whole = own.after(affine_of(base.calibration(name), lsb[name]))
        values = made | {"method": METHOD} | found.values(name)
        params = with_sensor(params, name, whole, scale, values)
    params.check()
    return params


def proposed(
    found: Found, priors: Priors, before: Params, scale: Scale, made: dict[str, Any]
) -> Params:
    """The params with the sensors of which more was found than was known."""
    known = {
        "acc": priors.acc_bias,
        "gyr": min(priors.gyr_scale, priors.gyr_cross),
        "mag": priors.own,
    }
    names = [name for name in SENSORS if _sigma(found, name) < BETTER * known[name]]
    return taken(before, names, found, before, scale, made)


def _sigma(found: Found, name: str) -> float:
    return float(next(iter(found.values(name).values())))
