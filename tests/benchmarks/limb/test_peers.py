# SPDX-License-Identifier: MIT
"""Other methods, on samples whose answer is known."""

from __future__ import annotations

import numpy as np

from benchmarks.limb import peers
from imud.body.tracks import Track
from imud.gravity import GRAVITY_M_S2


def test_fixed_thresholds_find_rests_that_are_calm_for_long_enough():
    times_s = np.arange(400) / 200.0
    turning = np.full(400, 5.0)
    for first, end in ((0, 60), (100, 120), (200, 230), (240, 280)):
        turning[first:end] = 0.1
    zeros = np.zeros(400)
    gyr = np.stack([turning, zeros, zeros], axis=1)
    quat, acc = (
        np.tile([1.0, 0, 0, 0], (400, 1)),
        np.tile([0, 0, GRAVITY_M_S2], (400, 1)),
    )
    # The second is too short; the pause between the last two is.
    found = peers.rests_by_thresholds(Track(times_s, quat, gyr, zeros, zeros, acc))
    assert found == [(0.0, 0.295), (1.0, 1.395)]
    shaken = acc + np.array([0, 0, 2.0])
    assert not peers.rests_by_thresholds(
        Track(times_s, quat, gyr, zeros, zeros, shaken)
    )
