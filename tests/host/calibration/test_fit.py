# SPDX-License-Identifier: MIT
"""The fits on simulated modules: how near they come to the truth, and what they say of
themselves."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.calibration.simulated import EARTH, UPS, fit_errors, recorded, samples
from imud.calibration import accelerometer, poses
from imud.calibration.algebra import closest_turn, integrated, onto, skew, turn, units
from imud.calibration.guided import whole
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.recording import Gatherer, Sample, Scale
from imud.calibration.stops import find_stops
from imud.gravity import GRAVITY_M_S2
from imud.virtual.calibrating import SCALE, Manners
from imud.virtual.modules import calibrated, shop
from imud.virtual.motions.module import MG, Module
from imud.virtual.sensors import World

MODULES = 3


@cache
def module(seed: int) -> Module:
    return shop(np.random.default_rng([seed, 77]), warm_degc=0.0)


@cache
def fitted(seed: int) -> ModuleFit:
    found = whole.fit(recorded(samples(module(seed), seed)))
    assert found is not None
    return found


def test_integrated_turns_are_products_of_all_turns_before() -> None:
    rate = np.random.default_rng(1).normal(0.0, 2.0, (37, 3))
    expected = [np.eye(3)]
    for each in rate:
        expected.append(expected[-1] @ turn(each * 0.01))
    assert np.allclose(integrated(rate, 0.01), expected)


def test_small_pieces_of_algebra() -> None:
    random = np.random.default_rng(2)
    one, two = random.normal(size=(2, 3))
    assert np.allclose(skew(one) @ two, np.cross(one, two))
    for start, end in ((one, two), (one, one), (one, -one)):
        found = onto(units(start), units(end))
        assert np.allclose(found @ units(start), units(end))
        assert np.allclose(found @ found.T, np.eye(3))
    rotated = turn(one)
    assert np.allclose(closest_turn(rotated @ np.diag([1.1, 1.0, 0.9])), rotated)


def test_twelve_poses_in_less_than_a_minute_calibrate_a_shop_module() -> None:
    """Median and worst of a few; benchmarks/calibration/modules.py has 40."""
    found = [fit_errors(module(seed), fitted(seed)) for seed in range(MODULES)]
    for key, middle, worst in (
        ("tilt", 0.05, 0.08),
        ("heading", 0.2, 0.3),
        ("scale", 0.06, 0.12),
        ("own", 0.06, 0.12),
    ):
        values = [each[key] for each in found]
        assert np.median(values) < middle, key
        assert max(values) < worst, key
    assert len(fitted(0).stops) == 12


def test_the_score_is_careful_and_near() -> None:
    found = [fit_errors(module(seed), fitted(seed)) for seed in range(MODULES)]
    scores = [fitted(seed).score for seed in range(MODULES)]
    tilt = np.array([each["tilt"] for each in found])
    heading = np.array([each["heading"] for each in found])
    stated = np.array([score.tilt_deg for score in scores])
    shown = np.array([score.heading_deg for score in scores])
    assert 0.3 < math.sqrt(float(((tilt / stated) ** 2).mean())) < 1.1
    assert 0.2 < math.sqrt(float(((heading / shown) ** 2).mean())) < 1.1
    assert all(score.is_good for score in scores)


def test_lag_and_field_are_found() -> None:
    for seed in range(MODULES):
        mag = fitted(seed).mag
        assert mag.lag_s == pytest.approx(module(seed).mag_lag_s, abs=0.002)
        assert mag.dip_deg == pytest.approx(EARTH.dip_deg, abs=0.5)
        assert np.trace(np.linalg.inv(mag.matrix)) == pytest.approx(3.0, abs=1e-3)


def test_lazy_poses_get_a_bad_score() -> None:
    """All within 20 degrees of base down: the score says what the truth is like."""
    random = np.random.default_rng(3)
    ups = units(np.append(random.normal(0.0, 0.35, (12, 2)), np.ones((12, 1)), axis=1))
    found = whole.fit(recorded(samples(module(0), 5, list(ups))))
    assert found.score.tilt_deg > 0.3
    assert not found.score.is_good


def test_an_uneven_field_shows_in_the_heading_alone() -> None:
    room = replace(
        EARTH, gradient_ut_m=((40.0, 8.0, 0.0), (8.0, -20.0, 0.0), (0, 0, -20.0))
    )
    found = whole.fit(recorded(samples(module(1), 1, world=room)))
    assert found.score.tilt_deg == pytest.approx(fitted(1).score.tilt_deg, abs=1e-6)
    assert found.mag.residual_ut > 1.0
    heading = found.score.heading_deg
    assert heading > fit_errors(module(1), found)["heading"]
    assert heading > 3.0 * (fitted(1).score.heading_deg or 0.0)


def test_a_chip_with_half_a_g_of_bias_is_calibrated() -> None:
    bad = replace(module(2), acc_bias=np.array([10.0, 418.0, 499.0]) * MG)
    found = whole.fit(recorded(samples(bad, 2)))
    assert found.acc.is_bad
    assert fit_errors(bad, found)["tilt"] < 0.1
    assert not fitted(2).acc.is_bad


def test_a_calibrated_module_stays_as_it_is() -> None:
    found = whole.fit(recorded(samples(calibrated(), 3)))
    for each in (found.acc.matrix, found.gyr.matrix, found.mag.matrix):
        assert np.allclose(each, np.eye(3), atol=2e-3)
    assert np.abs(found.acc.bias).max() < 1.0 * MG
    assert np.abs(found.mag.bias).max() < 0.2


def test_missing_samples_between_two_stops_cost_little() -> None:
    all_of_them = samples(module(0), 0)
    gap = [each for each in all_of_them if not 10.5e6 < each.t_us < 11.2e6]
    recording = recorded(gap)
    assert len(recording.breaks) == 1
    found = whole.fit(recording)
    assert len(found.gyr.angle) == len(fitted(0).gyr.angle) - 1
    assert fit_errors(module(0), found)["heading"] < 0.4


def test_few_stops_are_no_fit() -> None:
    assert whole.fit(recorded(samples(module(0), 0, UPS[:3]))) is None


def test_no_magnetometer_leaves_the_other_two() -> None:
    blind = [Sample(s.t_us, s.acc, s.gyr) for s in samples(module(0), 0)]
    found = whole.fit(recorded(blind))
    assert found.mag is None
    assert found.score.heading_deg is None
    assert found.score.tilt_deg == fitted(0).score.tilt_deg


def test_the_pose_that_is_wanted_is_the_one_least_known() -> None:
    ups = np.array([UPS[0], UPS[2], UPS[3], UPS[4], UPS[5]])  # never upside down
    readings = ups * GRAVITY_M_S2
    fit = accelerometer.fit(readings, np.full(5, 0.006))
    assert poses.wanted(fit).words == "upside down"
    assert poses.wanted(None) is poses.BASE_DOWN


def test_poses_have_words() -> None:
    assert len(poses.ALL) == 26
    words = {pose.name: pose.words for pose in poses.ALL}
    assert words["-z"] == "upside down"
    assert words["+x+y"] == "with its left front edge up"
    assert words["+x-y+z"] == "with its top right front corner up"
    assert len(set(poses.TWELVE)) == 12


def still(count: int, step_us: int, scale: Scale) -> list[Sample]:
    g = round(GRAVITY_M_S2 / scale.acc_m_s2)
    return [
        Sample(
            step_us * index,
            (0, 0, g),
            (index % 3, 0, 0),
            (1, 2, 3) if index % 2 == 0 else None,
            20.0,
        )
        for index in range(count)
    ]


def test_samples_are_averaged_to_about_a_hundred_a_second() -> None:
    for rate_hz, each in ((100.0, 1), (200.0, 2), (380.0, 3), (60.0, 1)):
        scale = Scale(SCALE.acc_m_s2, SCALE.gyr_rad_s, SCALE.mag_ut, rate_hz)
        step_us = round(1e6 / rate_hz)
        recording = Gatherer.of(scale, still(600, step_us, scale)).recording()
        assert len(recording) == 600 // each
        assert recording.step_s == pytest.approx(each * step_us / 1e6)
        assert recording.acc[:, 2] == pytest.approx(GRAVITY_M_S2, abs=scale.acc_m_s2)
        assert recording.temperature_c == pytest.approx(20.0)


def test_short_gaps_are_filled_and_long_ones_noted() -> None:
    every = still(400, 10_000, SCALE)
    holed = [each for each in every if each.t_us not in (500_000, 510_000)]
    recording = Gatherer.of(SCALE, holed).recording()
    assert len(recording) == 400
    assert recording.breaks == ()
    assert math.isnan(recording.mag[50, 0])
    broken = [each for each in every if not 1_000_000 <= each.t_us < 1_500_000]
    recording = Gatherer.of(SCALE, broken).recording()
    assert len(recording) == 350
    assert recording.breaks == (100,)
    assert recording.is_whole(0, 99)
    assert not recording.is_whole(90, 110)


def test_repeated_and_older_samples_are_left_out() -> None:
    every = still(50, 10_000, SCALE)
    twice = list(itertools.chain(*zip(every, every, strict=True)))
    assert len(Gatherer.of(SCALE, [*twice, every[3]])) == 50


def test_stops_are_where_the_hand_let_go() -> None:
    recording = recorded(samples(module(3), 3, UPS[:5]))
    stops = find_stops(recording)
    assert len(stops) == 5
    for index, stop in enumerate(stops):
        assert stop.start * recording.step_s == pytest.approx(4.0 * index, abs=0.3)
        assert stop.end * recording.step_s == pytest.approx(4.0 * index + 2.0, abs=0.3)
    held = recorded(samples(module(3), 3, UPS[:5], Manners(is_held=True)))
    assert len(find_stops(held)) < 3


def test_the_world_of_the_study_is_the_one_simulated() -> None:
    assert isinstance(EARTH, World)
    assert EARTH.field_at(np.zeros((1, 3)))[0] == pytest.approx([0.0, 20.0, -43.6])
