# SPDX-License-Identifier: MIT
"""The calibration that was found with the poses, as params that a person can take."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from imud.calibration.affine import Affine, affine_of
from imud.calibration.recording import Scale
from imud.calibration.result import with_sensor
from imud.params.learned import METHOD
from imud.params.value import Params
from imud.refine.model import ACC, ACC_BIAS, BIAS, GYR, LAG, MAG, NORTH, OWN
from imud.refine.window import Window
from imud.rotation import FloatArray

# Of the error that was known before: what is found less surely is left as it was.
BETTER = 0.7


def proposed(
    window: Window, before: Params, scale: Scale, made: dict[str, Any]
) -> Params:
    """The params with the sensors of which the window knows more than they do. `made`:
    day and temperature.
    """
    estimate, priors, solution = window.estimate, window.priors, window.solution
    made = made | {"method": METHOD}
    sigmas = np.sqrt(np.diag(solution.whole_covariance))
    params = before
    acc = _rms(sigmas[ACC_BIAS])
    if acc < BETTER * priors.acc_bias:
        own = Affine(estimate.matrix(ACC), estimate.whole[ACC_BIAS])
        whole = own.after(affine_of(before.acc, scale.acc_m_s2))
        params = with_sensor(params, "acc", whole, scale, made | {"sigma_m_s2": acc})
    gyr = _rms(sigmas[GYR])
    if gyr < BETTER * min(priors.gyr_scale, priors.gyr_cross):
        own = Affine(estimate.matrix(GYR), estimate.states[-1, BIAS])
        whole = own.after(affine_of(before.gyr, scale.gyr_rad_s))
        params = with_sensor(params, "gyr", whole, scale, made | {"sigma": gyr})
    variances = np.diagonal(solution.covariances()[-1])
    mag = _rms(np.sqrt(variances[OWN]))
    if mag < BETTER * priors.own:
        bent = estimate.matrix(MAG)
        own = Affine(np.asarray(np.linalg.inv(bent)), estimate.states[-1, OWN])
        whole = own.after(affine_of(before.mag, scale.mag_ut))
        north, up = estimate.whole[NORTH].tolist()
        field = {
            "sigma_uT": mag,
            "norm_uT": math.hypot(north, up),
            "dip_deg": math.degrees(math.atan2(-up, north)),
            "lag_s": float(estimate.whole[LAG][0]),
        }
        params = with_sensor(params, "mag", whole, scale, made | field)
    params.check()
    return params


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))
