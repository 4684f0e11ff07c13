# SPDX-License-Identifier: MIT
"""The scorer against angles known by hand, and against published results."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import vqf

from benchmarks.common import scoring
from benchmarks.common.engines import Estimate
from imud import rotation
from imud.virtual import motion, sensors


def turned(*degrees: float) -> rotation.FloatArray:
    return rotation.from_rotation_vector(np.radians(np.array([degrees])))


@pytest.mark.parametrize("heading_deg", [0.0, 3.0, -90.0, 179.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 1.0, -60.0])
def test_heading_and_inclination_come_apart(
    heading_deg: float, tilt_deg: float
) -> None:
    truth = turned(20.0, -130.0, 70.0)
    error = rotation.multiply(turned(0.0, 0.0, heading_deg), turned(0.0, tilt_deg, 0.0))
    found = scoring.errors(rotation.multiply(error, truth), truth)
    half = math.cos(math.radians(heading_deg) / 2) * math.cos(
        math.radians(tilt_deg) / 2
    )
    assert found.heading[0] == pytest.approx(abs(heading_deg), abs=1e-6)
    assert found.inclination[0] == pytest.approx(abs(tilt_deg), abs=1e-6)
    assert found.total[0] == pytest.approx(2 * math.degrees(math.acos(half)), abs=1e-6)


def test_a_pose_is_compared_with_the_truth_of_its_own_moment() -> None:
    made = sensors.generate(12.0, seed=5, rate_hz=250.0, errors=sensors.NO_ERRORS)
    assert made.quat is not None
    known = np.arange(len(made)) / made.rate_hz
    times = np.arange(0.001, 11.9, 0.0037)
    truth = rotation.interpolate(times, known, made.quat)
    assert scoring.score_at(times, truth, made).total < 1e-6
    late = scoring.score_at(times + 0.02, truth, made)
    assert late.total > 0.3
    north = rotation.multiply(turned(0.0, 0.0, 170.0), truth)
    found = scoring.score_at(times, north, made)
    assert (found.heading, found.varying) == pytest.approx((170.0, 0.0), abs=1e-6)
    swings = np.where(np.arange(len(times)) % 2, 182.0, 176.0)
    turns = rotation.from_rotation_vector(np.outer(np.radians(swings), [0.0, 0.0, 1.0]))
    swung = scoring.score_at(times, rotation.multiply(turns, truth), made)
    assert swung.varying == pytest.approx(3.0, abs=0.01)


def test_only_movement_with_truth_counts() -> None:
    count = 100
    quat = np.tile(turned(0.0, 0.0, 0.0), (count, 1))
    quat[80:90] = np.nan
    zeros = np.zeros((count, 3))
    moving = np.arange(count) >= 50
    truth = motion.Motion(100.0, zeros, zeros, zeros, quat=quat, movement=moving)
    estimate = np.tile(turned(0.0, 0.0, 0.0), (count, 1))
    estimate[:50] = turned(0.0, 90.0, 0.0)
    estimate[80:90] = turned(0.0, 90.0, 0.0)
    times = np.arange(count) / 100.0
    assert scoring.score_at(times, estimate, truth).total == pytest.approx(0.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("every", "expected"),
    [(1, (2.46, 2.31, 0.72)), (3, (2.62, 2.39, 0.88))],
    ids=["full_rate", "95_hz"],
)
def test_vqf_scores_on_broad_as_published(
    shared_data: Path, every: int, expected: tuple[float, float, float]
) -> None:
    # Trials 13, 19 and 37 come from another source than the published figures.
    paths = scoring.find_trials([shared_data / "broad"])
    assert len(paths) == scoring.TRIALS
    trials = [
        scoring.load_trial(path)
        for path in paths
        if path.name[:2] not in {"13", "19", "37"}
    ]
    assert len(trials) == 18
    scores = [score_reduced(trial.motion, every) for trial in trials]
    mean = scoring.Score.mean(scores)
    assert (mean.total, mean.heading, mean.inclination) == pytest.approx(
        expected, abs=0.006
    )


def score_reduced(recording: motion.Motion, every: int) -> scoring.Score:
    """VQF at defaults on means of `every` samples, stamped with their last."""
    count = len(recording) // every
    gyr, acc, mag = (
        np.ascontiguousarray(
            values[: count * every].reshape(count, every, 3).mean(axis=1)
        )
        for values in (recording.gyr, recording.acc, recording.mag)
    )
    estimate = vqf.VQF(every / recording.rate_hz).updateBatch(gyr, acc, mag)["quat9D"]
    times = (np.arange(count) * every + every - 1) / recording.rate_hz
    return scoring.score_at(times, estimate, recording)


def still(count: int) -> motion.Motion:
    """A body that lies as the world does, 100 times a second."""
    zeros = np.zeros((count, 3))
    level = np.tile(turned(0.0, 0.0, 0.0), (count, 1))
    return motion.Motion(100.0, zeros, zeros, zeros, quat=level)


def test_coverage_counts_errors_inside_1_96_sigma_and_nulls_apart() -> None:
    truth = still(100)
    times = np.arange(100) / 100.0
    # Tilted by 1 degree throughout, turned by 2.
    estimate = rotation.multiply(turned(0.0, 0.0, 2.0), turned(0.0, 1.0, 0.0))
    tilt_sigma = np.full(100, 1.001 / scoring.SIGMAS)
    tilt_sigma[:30] = 0.999 / scoring.SIGMAS
    heading_sigma = np.full(100, 5.0)
    heading_sigma[:40] = np.nan
    heading_sigma[40:55] = 0.5
    quats = np.repeat(estimate, 100, axis=0)
    stated = Estimate(times, quats, tilt_sigma, heading_sigma)
    found = scoring.coverage_at(stated, truth)
    assert found.tilt == pytest.approx(0.70)
    assert found.tilt_null == 0.0
    assert found.heading == pytest.approx(45 / 60)
    assert found.heading_null == pytest.approx(0.40)


def test_coverage_leaves_out_what_the_optics_did_not_see_or_does_not_move() -> None:
    truth = still(100)
    truth.quat[80:] = np.nan
    moving = dataclasses.replace(truth, movement=np.arange(100) >= 60)
    estimate = np.repeat(turned(0.0, 5.0, 0.0), 100, axis=0)
    sigma = np.where(np.arange(100) < 70, 0.1, 10.0)
    times = np.arange(100) / 100.0
    found = scoring.coverage_at(Estimate(times, estimate, sigma, sigma), moving)
    assert found.tilt == pytest.approx(0.5)


def test_coverage_where_no_sigma_is_stated_is_unknown_and_spoils_no_mean() -> None:
    truth = still(10)
    assert truth.quat is not None
    nothing = np.full(10, np.nan)
    times = np.arange(10) / 100.0
    ones = np.ones(10)
    unknown = scoring.coverage_at(Estimate(times, truth.quat, nothing, ones), truth)
    assert math.isnan(unknown.tilt)
    assert unknown.tilt_null == 1.0
    known = scoring.coverage_at(Estimate(times, truth.quat, ones, ones), truth)
    mean = scoring.Coverage.mean([unknown, known])
    assert mean == scoring.Coverage(1.0, 1.0, 0.5, 0.0, 1.0, 1.0)
