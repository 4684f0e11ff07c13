# SPDX-License-Identifier: MIT
"""Raw samples of a calibrated probe that is wobbled about its tip."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np

from imud.calibration.recording import Sample
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import RECORDS_HZ, Sampler
from imud.virtual.dimpling import PIECE_S, TIP_M, DimplingHand, Wobble
from imud.virtual.modules import calibrated
from imud.virtual.motion import Motion, join
from imud.virtual.sensors import World

TIP = np.array(TIP_M)
ONE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NONE = {"bias_counts": (0.0, 0.0, 0.0), "matrix": ONE, "method": "guided"}
# As a guided calibration leaves them.
CALIBRATED = (
    Params()
    .replaced("acc", {**NONE, "sigma_m_s2": 0.0075})
    .replaced("gyr", {**NONE, "sigma": 0.0005})
)


@cache
def exact(wobble: Wobble, seconds: float, seed: int = 1) -> Motion:
    """The motion itself."""
    hand = DimplingHand(np.random.default_rng(seed), RECORDS_HZ, wobble, TIP)
    pieces = hand.pieces(World(tip_m=TIP_M))
    return join(list(itertools.islice(pieces, round(seconds / PIECE_S))))


@cache
def wobbled(wobble: Wobble, seconds: float, seed: int = 1) -> tuple[Sample, ...]:
    """The samples of a module without errors, but with noise."""
    felt = calibrated().measures(
        exact(wobble, seconds, seed), np.random.default_rng([seed, 2])
    )
    return tuple(Sampler().samples(felt))


def readings(motion: Motion) -> tuple[FloatArray, FloatArray, float]:
    """Means of force and rate over the steps of a recording at 250 Hz, and a step."""
    each = 2
    count = len(motion) // each

    def means(values: FloatArray) -> FloatArray:
        return values[: count * each].reshape(count, each, 3).mean(axis=1)

    return means(motion.acc), means(motion.gyr), each / RECORDS_HZ
