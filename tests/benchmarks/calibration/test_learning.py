# SPDX-License-Identifier: MIT
"""The counts of public recordings with shop modules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibration import learning
from benchmarks.common import engines, scoring
from benchmarks.common.engines import Estimate
from benchmarks.common.feed import sampled
from benchmarks.common.scoring import Trial
from imud import rotation
from imud.virtual import sensors

RATE_HZ = 200


def estimate(wrong_deg: float, sigma_deg: float) -> tuple[Estimate, Trial]:
    """A still probe whose heading is wrong, and states how much; null for 5 s."""
    true = sensors.generate(40.0, seed=3, rate_hz=RATE_HZ)
    angle = np.array([0.0, 0.0, np.radians(wrong_deg)])
    assert true.quat is not None
    quats = rotation.multiply(rotation.from_rotation_vector(angle), true.quat)
    sigmas = np.full(len(true), sigma_deg)
    times = np.arange(len(true)) / RATE_HZ
    null = np.where(times < 5.0, np.nan, sigmas)
    return Estimate(times, quats, sigmas, null), Trial(Path("07_made.npz"), true, ())


@pytest.mark.parametrize(("sigma_deg", "share"), [(4.0, 1.0), (2.0, 0.0)])
def test_errors_are_counted_against_what_is_stated(sigma_deg, share):
    found = learning.errors_of(*estimate(6.0, sigma_deg))
    for phase in ("under 10 s", "to 30 s"):
        assert found[phase]["heading"] == share
        assert found[phase]["tilt"] == 1.0
    assert 0.0 < found["under 10 s"]["null"] < 0.6
    assert found["to 30 s"]["null"] == 0.0
    assert found["at 30 s"] == pytest.approx(6.0, abs=0.01)
    assert "at 60 s" not in found


def test_poses_that_state_nothing_are_neither_inside_nor_outside():
    assert learning.inside(np.ones(3), np.full(3, np.nan)) is None
    sigmas = np.array([np.nan, 1.0, 1.0])
    assert learning.inside(np.array([9.0, 1.0, 3.0]), sigmas) == 0.5


def test_the_figures_judge_rotation_and_each_phase():
    errors = {"at 30 s": 3.0, "at 60 s": 9.0}
    phase = {"tilt": 1.0, "heading": 0.9, "null": 0.25}
    errors |= dict.fromkeys(learning.PHASES, phase)
    row = {"has_rotation": True, "learned": errors, "alone": errors}
    row |= {"own_total": 1.0, "guided_total": 1.1}
    still = row | {"has_rotation": False, "learned": errors | {"at 30 s": 50.0}}
    found = {each.name: each for each in learning.figures([row, still])}
    assert found["no procedure, heading at 30 s, median"].verdict == "must"
    assert found["no procedure, heading at 60 s, 95th"].verdict == "MISSED"
    assert found["no procedure, heading inside, later, %"].verdict == "MISSED"
    assert found["no procedure, no heading, later, %"].value == 25.0
    assert found["the probe alone, heading at 60 s, 95th"].verdict == "must"
    assert found["guided / own calibration"].value == pytest.approx(1.1)


def test_what_a_host_learns_is_put_in_force_while_the_filter_runs():
    true = sensors.generate(50.0, seed=5)
    trial = Trial(Path("07_made.npz"), true, ())
    module = learning.module_of(trial, 2)
    feed = sampled(module.measures(true, np.random.default_rng(2)), params=b"")
    found, applied_s = learning.with_learning(feed)
    alone = engines.ENGINES["host"](feed)
    assert 15.0 < applied_s[0] < 40.0
    changed = found.times_s > applied_s[0] - 0.02
    assert np.array_equal(found.quats[~changed], alone.quats[~changed])
    late = found.times_s > 40.0
    errors = [
        np.nanmean(scoring.errors_at(e.times_s, e.quats, true).inclination[late])
        for e in (found, alone)
    ]
    assert errors[0] < 0.7 * errors[1]
