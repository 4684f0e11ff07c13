# SPDX-License-Identifier: MIT
"""The params that result from a search for the tip."""

from __future__ import annotations

import datetime

from imud.calibration.result import CalibrationResult
from imud.calibration.tip_found import TipFound
from imud.params.value import Params, Tip

TIP_SIGMA_MAX_M = 0.65  # the wire's largest


def result_of_tip(
    found: TipFound, before: Params, day: datetime.date | None = None
) -> CalibrationResult:
    """The params before with this tip; values that it does not find are kept."""
    old = before.tip or Tip()
    values: dict[str, object] = {
        "offset_m": old.offset_m,
        "sigma_m": old.sigma_m,
        "axis": old.axis if found.axis is None else found.axis.tolist(),
        "day": day,
        "method": found.method,
    }
    if found.offset_m is not None:
        sigma_m = found.sigma_m
        values["offset_m"] = found.offset_m.tolist()
        values["sigma_m"] = sigma_m and min(sigma_m, TIP_SIGMA_MAX_M)
    params = before.replaced("tip", values)
    params.check()
    return CalibrationResult(params, (), seconds=found.seconds, tip=found)
