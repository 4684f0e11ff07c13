# SPDX-License-Identifier: MIT
"""The papers' methods on simulated modules."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from benchmarks.calibration.simulated import (
    ATTITUDES,
    FIELD,
    errors,
    recorded,
    samples,
)
from imud.calibration.affine import Affine, MethodError
from imud.calibration.algebra import spread
from imud.calibration.papers import extremes, half_turns, six_positions
from imud.calibration.papers.extremes import Extremes
from imud.calibration.papers.methods import METHODS, by_method, of_method
from imud.calibration.poses import TWELVE
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import find_stops
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE, Manners
from imud.virtual.modules import shop
from imud.virtual.motions.module import Module

SAME = Affine(np.eye(3), np.zeros(3))


@cache
def module(seed: int = 1) -> Module:
    return shop(np.random.default_rng([seed, 79]), warm_degc=0.0)


@cache
def turned_over() -> SensorRecording:
    """Each of six faces, and again after half a turn where it lies; then edges."""
    ups: list[FloatArray | None] = []
    for pose in TWELVE[:6]:
        ups += [pose.up, None]
    ups += [pose.up for pose in TWELVE[6:]]
    manners = Manners(off_rad=math.radians(1.0))
    return recorded(samples(module(), 1, ups, manners))


def test_six_positions_leave_what_the_study_found() -> None:
    recording = turned_over()
    found = six_positions.fit(recording, find_stops(recording))
    assert found.acc is not None
    assert found.mag is not None
    left = errors(module(), found.acc, found.mag)
    assert 0.1 < left["tilt"] < 1.5  # as the faces are off
    assert 1.0 < left["heading"] < 6.0  # the dies' turn is not seen
    assert np.degrees(found.gyr.bias - module().gyr_bias) == pytest.approx(0.0, abs=0.1)


def test_an_exact_accelerometer_is_found_by_six_positions() -> None:
    """Equation 5 on readings without noise gives the twelve coefficients back."""
    matrix = np.eye(3) + np.array([[0.01, 0.02, 0], [0, -0.01, 0.01], [0.02, 0, 0.03]])
    bias = np.array([0.3, -0.2, 0.1])
    rows = []
    for pose in TWELVE[:6]:
        still = np.tile(matrix @ (pose.up * GRAVITY_M_S2) + bias, (200, 1))
        rows += [still, np.zeros((50, 3))]
    acc = np.concatenate(rows)
    is_moving = np.tile(np.repeat([0.0, 1.0], [200, 50]), 6)
    gyr = np.outer(is_moving * np.resize([1.0, -1.0], len(acc)), np.ones(3))
    recording = SensorRecording(
        0.01, acc, gyr, np.full_like(acc, np.nan), np.zeros(len(acc))
    )
    stops = find_stops(recording)
    assert len(stops) == 6
    found = six_positions.fit(recording, stops)
    assert found.mag is None
    assert np.allclose(found.acc.matrix @ matrix, np.eye(3))
    assert np.allclose(found.acc.bias, bias)


def test_an_ellipsoid_is_found_and_the_printed_form_lies_in_its_axes() -> None:
    shape = np.array([[1.2, 0.1, 0.0], [0.1, 0.9, 0.05], [0.0, 0.05, 1.0]])
    own = np.array([30.0, -10.0, 5.0])
    field = 48.0 * spread(np.random.default_rng(4), 300)[:, 0, :]
    readings = field @ shape.T + own
    found = six_positions.ellipsoid(readings)
    assert found.bias == pytest.approx(own, abs=1e-6)
    back = found.matrix @ shape
    assert np.allclose(back / np.cbrt(np.linalg.det(back)), np.eye(3), atol=1e-6)
    printed = six_positions.ellipsoid(readings, as_printed=True)
    lengths = np.linalg.norm(printed.apply(readings), axis=1)
    assert np.ptp(lengths) < 1e-6
    assert not np.allclose(printed.matrix @ shape, back, atol=0.1)
    u, v = np.linspace(-1.0, 1.0, 300), np.linspace(0.0, 50.0, 300)
    around = np.stack([np.cos(v), np.sin(v)], axis=1) * np.cosh(u)[:, None]
    saddle = np.column_stack([around, np.sinh(u)])  # x2 + y2 - z2 = 1
    with pytest.raises(MethodError, match="turn the probe further"):
        six_positions.ellipsoid(saddle)


def test_a_missing_face_is_named() -> None:
    recording = recorded(samples(module(), 4, [pose.up for pose in TWELVE[:5]]))
    with pytest.raises(MethodError, match="missing: on its left side, right up"):
        six_positions.fit(recording, find_stops(recording))
    with pytest.raises(MethodError, match="turn the probe by 180 degrees"):
        recording = recorded(samples(module(), 4, [pose.up for pose in TWELVE[:6]]))
        half_turns.fit(recording, find_stops(recording))


def test_extremes_find_the_middle_and_as_printed_only_of_two_axes() -> None:
    readings = 48.0 * ATTITUDES[:, 0, :] + np.array([10.0, 20.0, 30.0])
    mended, printed = extremes.fit(readings), extremes.fit(readings, as_printed=True)
    assert mended.bias == pytest.approx([10.0, 20.0, 30.0], abs=1.5)
    assert printed.bias[:2] == pytest.approx([10.0, 20.0], abs=1.5)
    assert printed.bias[2] == 0.0
    assert np.linalg.det(mended.matrix) == pytest.approx(1.0)


def test_the_bar_of_extremes_shows_a_magnet_until_it_is_reset() -> None:
    bar = Extremes()
    assert bar.found() is None
    assert bar.quality_percent is None
    field = 48.0 * ATTITUDES[:, 0, :]
    for reading in field:
        bar.add_reading(reading)
    good = bar.quality_percent
    assert good > 97.0
    bar.add_reading(np.array([500.0, 0.0, 0.0]))
    for reading in field:
        bar.add_reading(reading)
    spoilt = bar.quality_percent
    assert spoilt < 90.0
    bar.reset()
    for reading in field:
        bar.add_reading(reading)
    assert bar.quality_percent == pytest.approx(good)


def test_extremes_of_a_still_probe_are_refused() -> None:
    with pytest.raises(MethodError, match="did not change"):
        extremes.fit(np.ones((50, 3)))


def test_half_turns_find_the_own_field() -> None:
    recording = turned_over()
    found = half_turns.fit(recording, find_stops(recording))
    assert np.linalg.norm(found.mag.bias - module().mag_bias) < 4.0
    before = errors(module(), SAME, SAME)
    left = errors(module(), found.acc, found.mag)
    assert left["heading"] < 0.2 * before["heading"]
    assert np.array_equal(found.acc.matrix, np.eye(3))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_makes_params_with_its_residual(method: str) -> None:
    found = of_method(turned_over(), method, SCALE, Params())
    assert found.params.faults() == []
    assert "mag" in found.sensors
    mag = found.params.mag
    own = by_method(turned_over(), find_stops(turned_over()), method).mag
    there = turned_over().mag[np.isfinite(turned_over().mag[:, 0])]
    spread_ut = np.linalg.norm(own.apply(there), axis=1).std()
    assert mag.residual == pytest.approx(spread_ut, abs=0.01)
    assert mag.method == ("extremes" if "extremes" in method else "positions")
    assert found.tilt_deg is None


def test_the_field_that_errors_are_judged_in_is_that_of_the_world() -> None:
    assert np.linalg.norm(FIELD) == pytest.approx(48.0, abs=0.05)
