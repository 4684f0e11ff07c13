# SPDX-License-Identifier: MIT
"""The slopes of the equations, beside differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imud import rotation
from imud.refine.model import (
    CALIBRATED,
    LAG,
    STATE,
    TURN,
    WHOLE,
    Estimate,
    Recording,
)
from imud.refine.rows import ALL, COLUMNS, NEXT, Intervals
from imud.refine.strapdown import course_of
from imud.rotation import FloatArray

KINDS = [
    *("attitude", "speed", "place", "room", "own", "bias", "field"),
    *("bounds", "rest", "still"),
]
EARTH = np.zeros(3)
# Slopes that are not there: m/s, m, and uT for a rad or a rad/s within an interval.
LEFT_OUT = {"speed": 0.1, "place": 0.05, "field": 4.0, "still": 0.002}
COUNT = 6


def recording() -> Recording:
    """A hand that turns: 6 intervals of 20 samples."""
    t = np.arange(COUNT * 20) / 200.0
    gyr = np.stack([np.sin(7.0 * t), np.cos(5.0 * t), 0.5 + 0.0 * t], axis=1)
    acc = np.stack([2.0 * np.cos(4.0 * t), 1.0 - t, 9.0 + 0.0 * t], axis=1)
    mag = np.stack([18.0 + t, 5.0 * np.cos(t), -40.0 + 0.0 * t], axis=1)
    mag[::2] = np.nan
    return Recording(200.0, gyr, acc, mag)


def estimate() -> Estimate:
    random = np.random.default_rng(3)
    found = Estimate.begun(COUNT)
    found.first = rotation.from_rotation_vector(np.array([0.3, -0.2, 1.0]))
    found.states += 0.05 * random.standard_normal(found.states.shape)
    found.states[:, TURN] = 0.0
    found.states[:, 9:12] += 0.0, 20.0, -40.0
    found.whole += 0.01 * random.standard_normal(WHOLE) * (np.arange(WHOLE) < 30)
    return found


def intervals(at: Estimate) -> Intervals:
    seen = recording()
    course = course_of(seen, at, EARTH)
    is_rest = np.array([False, True, False, False, True, False])
    some = slice(0, COUNT)
    return Intervals.of(seen, CALIBRATED, at, course, is_rest, 1, some)


def moved(at: Estimate, step: FloatArray, whole: FloatArray) -> Estimate:
    """An estimate after a step, as a window takes it: rows of attitude go into what the
    gyroscope did not see.
    """
    states = at.states + step
    states[:, TURN] = 0.0
    turn = rotation.from_rotation_vector(step[0, TURN])
    found = replace(at, first=rotation.multiply(turn, at.first), states=states)
    found.whole = at.whole + whole
    rows = intervals(at).attitude()
    dense = np.zeros((COUNT, 3, COLUMNS))
    rows.put(dense)
    pair = np.concatenate([step[:-1], step[1:], np.tile(whole, (COUNT, 1))], axis=1)
    found.unseen = rows.away + (dense @ pair[..., None])[..., 0]
    return found


@pytest.mark.parametrize("column", [*range(STATE), *range(ALL, COLUMNS)])
def test_a_slope_is_what_a_small_change_does(column: int) -> None:
    at, small = estimate(), 1e-5
    step, whole = np.zeros((COUNT + 1, STATE)), np.zeros(WHOLE)
    if column < NEXT:
        step[2, column] = small
    else:
        whole[column - ALL] = small
    before, after = ([*intervals(each).rows()] for each in (at, moved(at, step, whole)))
    pair = np.concatenate([step[:-1], step[1:], np.tile(whole, (COUNT, 1))], axis=1)
    for name, rows, later in zip(KINDS, before, after, strict=True):
        dense = np.zeros((COUNT, 3, COLUMNS))
        rows.put(dense)
        expected = (dense @ pair[..., None])[..., 0] / small
        found = (later.away - rows.away) / small
        # What bends within an interval is left out.
        most = max(0.05 * float(np.abs(expected).max()), LEFT_OUT.get(name, 1e-6))
        # Before the first sample nothing is known of what a lag needs.
        assert found[1:] == pytest.approx(expected[1:], abs=most), name


def test_a_lag_is_told_by_turning() -> None:
    rows = [*intervals(estimate()).rows()][KINDS.index("field")]
    dense = np.zeros((COUNT, 3, COLUMNS))
    rows.put(dense)
    assert np.abs(dense[..., ALL + LAG.start]).min(axis=0).max() > 1.0  # uT/s
