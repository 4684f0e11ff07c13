# SPDX-License-Identifier: MIT
"""A stated error of poses, beside the true error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.common.scoring import SIGMAS
from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class Stated:
    """The stated error of tilt or heading, over the poses of one or of several runs."""

    true_deg: float  # rms
    stated_deg: float  # median of the sigmas; NaN without any
    withheld: float  # share of the poses
    honest: float  # share inside the stated 95 %, or withheld

    @staticmethod
    def of(error_deg: FloatArray, sigma_deg: FloatArray) -> Stated:
        """From the poses of a run; NaN: no sigma."""
        is_null = np.isnan(sigma_deg)
        inside = error_deg <= SIGMAS * sigma_deg
        return Stated(
            float(np.sqrt(np.mean(error_deg**2))),
            math.nan if is_null.all() else float(np.nanmedian(sigma_deg)),
            float(is_null.mean()),
            float((is_null | inside).mean()),
        )

    @staticmethod
    def mean(each: Sequence[Stated]) -> Stated:
        """Over runs; of their rms the root mean square."""
        stated = [one.stated_deg for one in each if math.isfinite(one.stated_deg)]
        return Stated(
            float(np.sqrt(np.mean([one.true_deg**2 for one in each]))),
            float(np.mean(stated)) if stated else math.nan,
            float(np.mean([one.withheld for one in each])),
            float(np.mean([one.honest for one in each])),
        )
