# SPDX-License-Identifier: MIT
"""Params of sensors that are taken for calibrated."""

from __future__ import annotations

import numpy as np

from imud.params.trusted import CALIBRATED
from imud.params.value import Params
from imud.virtual.memory import orders_us


def test_trusted_params_change_no_reading_and_say_how_good_they_are() -> None:
    params = Params.decode(CALIBRATED)
    for name in ("acc", "gyr", "mag"):
        found = params.calibration(name)
        assert np.array_equal(found.matrix, np.eye(3))
        assert not np.any(found.bias_counts)
        assert (found.sigma is None) == (name == "gyr")


def test_orders_bring_every_word_before_they_are_applied() -> None:
    times_us = [at_us for at_us, _ in orders_us(CALIBRATED)]
    assert len(times_us) == -(-len(CALIBRATED) // 4) + 2
    assert (np.diff(times_us) > 0).all()
