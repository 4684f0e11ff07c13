# SPDX-License-Identifier: MIT
"""How good a tip from a dimple is, and why it is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.faults import CalibrationFault
from imud.calibration.tip.dimple import DimpleFit, Trust
from imud.calibration.tip.swing import Swing
from imud.params.value import Calibration, Params

# Chosen on simulated wobbles of even seeds; benchmarks/tip judges on odd ones.
LIMIT_M = 0.002  # of the score: worse ones are refused
RESIDUAL_MAX = 1.5  # in units of the noise
GIVE_MAX = 10.0  # a firm base is above it seven times in 1,000
# Limit of the uncertainty of a base's motion, as an error of the tip.
GIVE_SIGMA_M = 0.0005
INSIDE = 2.8  # of three axes' sigma: 95 % of vectors are shorter

WEAK_DEG, WEAK_HZ, WEAK_ROUND = 16.0, 0.55, 0.35
ACC_KNOWN_M_S2, GYR_KNOWN = 0.05, 0.003  # sigmas of a calibrated sensor
ACC_LEAST_M_S2, GYR_LEAST = 0.01, 0.0005


@dataclass(frozen=True, slots=True)
class TipScore:
    """The error to expect."""

    sigma_m: float  # of an axis
    score_m: float  # 95 % of errors are shorter

    @property
    def is_good(self) -> bool:
        return self.score_m <= LIMIT_M


def trust_of(params: Params) -> Trust:
    """The errors of a probe's calibrated readings."""
    acc, gyr = _sigma(params.acc), _sigma(params.gyr)
    is_acc, is_gyr = acc <= ACC_KNOWN_M_S2, gyr <= GYR_KNOWN
    usual = Trust()
    share = (0.0015 if is_gyr else 0.003) if is_acc else usual.share
    return Trust(
        max(1.5 * acc, ACC_LEAST_M_S2) if is_acc else usual.acc_m_s2,
        max(gyr, GYR_LEAST) if is_gyr else usual.gyr,
        share,
    )


def _sigma(of: Calibration | None) -> float:
    return math.inf if of is None or of.sigma is None else of.sigma


def score_of(fit: DimpleFit, trust: Trust) -> TipScore:
    """The score of a wobble."""
    own = float(np.sqrt(np.mean(fit.sigma_m**2)))
    sigma = math.hypot(own, trust.share * float(np.linalg.norm(fit.offset_m)))
    return TipScore(sigma, INSIDE * sigma)


def weakness(fit: DimpleFit, swing: Swing, trust: Trust) -> CalibrationFault | None:
    """Why a wobble is not good enough; None if it is."""
    is_rough = fit.residual_m_s2 > RESIDUAL_MAX * fit.noise_m_s2
    if is_rough and trust.share == Trust().share:
        return _weak("this wobble does not show the tip's position", swing, trust)
    if is_rough:
        return CalibrationFault(
            "slips",
            f"the tip slips or is knocked: the residual is {fit.residual_m_s2:.3f} "
            f"m/s2, the noise {fit.noise_m_s2:.3f}",
            "press it into a dimple that holds it, and wobble it smoothly",
        )
    if fit.give > GIVE_MAX:
        return CalibrationFault(
            "base_gives",
            "the base is soft: it moves with the tip",
            "stand the tip on metal, stone or hard wood, in a punch mark",
        )
    score = score_of(fit, trust)
    if not score.is_good:
        return _weak(
            f"the tip's error would be +-{1000.0 * score.score_m:.1f} mm", swing, trust
        )
    if fit.give_sigma * float(np.linalg.norm(fit.offset_m)) > GIVE_SIGMA_M:
        return _weak("it is not clear yet whether the base moves", swing, trust)
    return None


def _weak(found: str, swing: Swing, trust: Trust) -> CalibrationFault:
    """The fault that limits the wobble most."""
    if trust.share == Trust().share:
        return CalibrationFault(
            "uncalibrated",
            f"{found}: this probe's sensors are not calibrated",
            "calibrate them first: imud calibrate",
        )
    if swing.roundness < WEAK_ROUND:
        return CalibrationFault(
            "one_direction",
            f"{found}: it was wobbled in one plane",
            "wobble it in two directions, back and forth and sideways",
        )
    if swing.hz < WEAK_HZ:
        return CalibrationFault(
            "slow",
            f"{found}: {swing.hz:.1f} wobbles a second are too slow",
            "wobble it faster, about once a second",
        )
    if swing.degrees < WEAK_DEG:
        return CalibrationFault(
            "small",
            f"{found}: {swing.degrees:.0f} degrees to each side are too little",
            "lean it further, 20 to 30 degrees to each side",
        )
    return CalibrationFault("short", found, "wobble it longer, faster and further")
