# SPDX-License-Identifier: MIT
"""The drift of an accelerometer's bias with temperature, learned from two calibrations
at different temperatures.
"""

from __future__ import annotations

import numpy as np

from imud.gravity import GRAVITY_M_S2
from imud.params.condition import DRIFT_M_S2_K
from imud.params.value import Calibration, Params

MG = 1e-3 * GRAVITY_M_S2
DRIFT_MAX_M_S2_K = 255 / 12800  # the wire's largest
# Change of a bias between two calibrations without a cause, sigma of an axis; assumed.
REPEATS_M_S2 = 2.0 * MG
# Temperature never moves a bias so much a kelvin: it was knocked, or replaced.
IMPOSSIBLE_M_S2_K = 5.0 * MG
DOUBT = 2.0  # sigmas of a contradiction that discards the earlier drift


def drift_of(
    before: Calibration | None, after: Calibration, count_m_s2: float
) -> float | None:
    """The one-sigma error of an axis that each kelvin from the temperature of the
    calibration `after` adds, m/s2; None: unknown. `count_m_s2`: of one count.

    The slopes of the axes between both calibrations and their uncertainty, weighed
    against the earlier drift or the data sheet's. The less two calibrations show, the
    more of the earlier drift is kept; where they contradict it, the data sheet's is
    used again.
    """
    if before is None:
        return None
    known = before.drift_m_s2_k
    if before.temperature_c is None or after.temperature_c is None:
        return known
    if before.sigma is None or after.sigma is None:
        return known
    apart_k = after.temperature_c - before.temperature_c
    moved = count_m_s2 * np.subtract(after.bias_counts, before.bias_counts)
    moved_square = float(np.mean(moved**2))
    if moved_square > (IMPOSSIBLE_M_S2_K * apart_k) ** 2:
        return known
    noise_square = before.sigma**2 + after.sigma**2 + REPEATS_M_S2**2
    prior = (known or DRIFT_M_S2_K) ** 2
    if moved_square > DOUBT**2 * (prior * apart_k**2 + noise_square):
        prior = max(prior, DRIFT_M_S2_K**2)
    # The weight of the slopes against `moved * apart_k`; the same share of the noise is
    # the remaining variance.
    trust = prior / (prior * apart_k**2 + noise_square)
    square = trust * (trust * apart_k**2 * moved_square + noise_square)
    return min(float(np.sqrt(square)), DRIFT_MAX_M_S2_K)


def with_drift(params: Params, before: Calibration | None, count_m_s2: float) -> Params:
    """The params with that of their accelerometer, which was calibrated as `before`."""
    if params.acc is None:
        return params
    drift = drift_of(before, params.acc, count_m_s2)
    values = params.plain("acc") or {}
    return params.replaced("acc", {**values, "drift_m_s2_k": drift})
