# SPDX-License-Identifier: MIT
"""Counts to units against doubles, up to the limits of calibrate.h."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import desk
from core.desk import DEGREE, FIELD, FORCE, INT32_MIN, RATE, ffi, lib

MPU9250 = desk.identity_of()
# 70 mdps, 0.732 mg and 0.08 mgauss a count: the LSM9DS0's widest useful ranges.
LSM9DS0 = desk.identity_of(
    kind=lib.SENSOR_LSM9DS0,
    rate_hz=760,
    gyr_lsb_nrad_s=1221730,
    acc_lsb_nm_s2=7178466,
    mag_lsb_pt=8000,
)
both_sensors = pytest.mark.parametrize(
    "identity", [MPU9250, LSM9DS0], ids=["mpu9250", "lsm9ds0"]
)

SAMPLE = desk.dtype_of("struct sample")
MEASUREMENT = desk.dtype_of("struct measurement")
# Sensor, field of the measurement, its steps a unit, its limit in that unit.
SENSORS = (
    ("gyr", "gyr_rad_s_q25", RATE, 38.0),
    ("acc", "acc_m_s2_q21", FORCE, 270.0),
    ("mag", "mag_ut_q18", FIELD, 2048.0),
)
ROW_MAX = 27852  # 1.7 as q2_14
BIAS_MAX = 2**28  # 16384 counts as q18_14


def lsb(identity: Any, sensor: str) -> float:
    """One count in SI units, uT for the field."""
    return {
        "gyr": identity.gyr_lsb_nrad_s * 1e-9,
        "acc": identity.acc_lsb_nm_s2 * 1e-9,
        "mag": identity.mag_lsb_pt * 1e-6,
    }[sensor]


def calibration_of(matrix: desk.Array, bias: desk.Array) -> Any:
    """One matrix and bias for all three sensors, elements as they are stored."""
    sensor = {"bias": bias.tolist(), "matrix": matrix.tolist()}
    return ffi.new("struct calibration *", {name: sensor for name, *_ in SENSORS})


def samples_of(counts: desk.Array) -> desk.Array:
    samples = np.zeros(len(counts), SAMPLE)
    for name in ("gyr", "acc", "mag"):
        samples[name] = counts
    samples["has_mag"] = True
    return samples


def calibrated(calibration: Any, identity: Any, samples: desk.Array) -> desk.Array:
    out = np.zeros(len(samples), MEASUREMENT)
    scale = ffi.new("struct calibration_scale *")
    lib.calibration_scale_of(identity, scale)
    desk.call(lib.loop_calibrate, calibration, scale, len(samples), samples, out)
    return out


def assert_units(
    matrix: desk.Array, bias: desk.Array, identity: Any, counts: desk.Array
) -> None:
    out = calibrated(calibration_of(matrix, bias), identity, samples_of(counts))
    exact = (counts - bias / 2**14) @ (matrix / 2**14).T
    for sensor, field, steps, limit in SENSORS:
        wanted = np.clip(exact * lsb(identity, sensor), -limit, limit)
        # The scale is floored to one part in 1e6 of the gyroscope's; three products
        # and the doubling are rounded.
        bound = 1e-6 * np.abs(wanted) + 8 / steps
        assert (np.abs(out[field] / steps - wanted) <= bound).all(), sensor


@both_sensors
def test_counts_become_units(identity):
    random = np.random.default_rng(1)
    counts = random.integers(-(2**15), 2**15, (1000, 3))
    identity_matrix = 2**14 * np.eye(3, dtype=int)
    assert_units(identity_matrix, np.zeros(3, int), identity, counts)


def test_one_g_and_a_turn_a_second_are_what_the_data_sheet_says():
    counts = np.array([[2048, 5898, -333]])  # 1 g; 359.98 deg/s; -49.95 uT
    out = calibrated(desk.EXACT, MPU9250, samples_of(counts))[0]
    assert out["acc_m_s2_q21"][0] / FORCE == pytest.approx(9.80665, abs=1e-4)
    turn = out["gyr_rad_s_q25"][1] / RATE
    assert turn == pytest.approx(5898 / 32768 * 2000 * DEGREE, abs=1e-5)
    assert out["mag_ut_q18"][2] / FIELD == pytest.approx(-49.95, abs=1e-4)


@both_sensors
@pytest.mark.parametrize("seed", range(10))
def test_bias_goes_before_the_matrix_and_rows_give_the_axes(identity, seed):
    random = np.random.default_rng(seed)
    matrix = 2**14 * np.eye(3) + random.uniform(-1500, 1500, (3, 3))
    bias = random.uniform(-BIAS_MAX, BIAS_MAX, 3)
    counts = random.integers(-(2**15), 2**15, (300, 3))
    assert_units(matrix.round().astype(int), bias.round().astype(int), identity, counts)


@both_sensors
def test_the_worst_valid_calibration_overflows_nowhere_and_is_held_at_the_limits(
    identity,
):
    edges = (-(2**15), 2**15 - 1)
    counts = np.array(list(product(edges, repeat=3)))
    third = ROW_MAX // 3
    rows = [(ROW_MAX, 0, 0), (0, 0, -ROW_MAX), (third, -third, third)]
    for bias, row in product(product((-BIAS_MAX, BIAS_MAX), repeat=3), rows):
        matrix = np.array([row, row[::-1], np.roll(row, 1)])
        calibration = calibration_of(matrix, np.array(bias))
        assert lib.calibration_is_valid(calibration)
        assert_units(matrix, np.array(bias), identity, counts)


def test_a_value_beyond_its_limit_is_held_there():
    matrix = ROW_MAX * np.eye(3, dtype=int)
    bias = np.full(3, BIAS_MAX)
    out = calibrated(
        calibration_of(matrix, bias), MPU9250, samples_of(np.full((1, 3), -(2**15)))
    )[0]
    for _, field, steps, limit in SENSORS:
        assert out[field].tolist() == [-limit * steps] * 3


def test_a_field_that_is_not_there_is_left_alone():
    samples = samples_of(np.array([[1, 2, 3]]))
    samples["has_mag"] = False
    out = calibrated(desk.EXACT, MPU9250, samples)[0]
    assert not out["has_mag"]
    assert out["mag_ut_q18"].tolist() == [0, 0, 0]


@given(
    st.tuples(*[st.integers(-(2**15), 2**15 - 1)] * 3),
    st.tuples(*[st.integers(-BIAS_MAX, BIAS_MAX)] * 3),
    st.tuples(*[st.tuples(*[st.integers(-ROW_MAX // 3, ROW_MAX // 3)] * 3)] * 3),
)
def test_any_counts_and_any_valid_calibration_give_the_units(counts, bias, matrix):
    rows = np.clip(np.array(matrix), -(ROW_MAX // 3), ROW_MAX // 3)
    assert_units(rows, np.array(bias), LSM9DS0, np.array([counts]))


def test_a_mean_of_counts_becomes_a_rate_as_single_counts_do():
    matrix = np.array([[16000, 100, -200], [50, 16500, 20], [0, -70, 16384]])
    bias = np.array([3 * 2**14, -(2**13), 2**12])
    mean = np.array([17.25, -300.5, 0.125])
    scale = ffi.new("struct calibration_scale *")
    lib.calibration_scale_of(MPU9250, scale)
    out = ffi.new("struct vector *", (mean * 2**14).astype(int).tolist())
    lib.calibrate_rate(
        calibration_of(matrix, bias),
        scale,
        out,
    )
    wanted = (matrix / 2**14) @ (mean - bias / 2**14) * lsb(MPU9250, "gyr")
    found = np.array([out.x, out.y, out.z]) / RATE
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max() + 8 / RATE


def changed(sensor: str, **fields: Any) -> Any:
    calibration = ffi.new("struct calibration *", desk.EXACT[0])
    part = getattr(calibration, sensor)
    for name, (place, value) in fields.items():
        target = getattr(part, name)
        for index in place[:-1]:
            target = target[index]
        target[place[-1]] = value
    return calibration


def test_no_calibration_is_a_valid_one():
    assert lib.calibration_is_valid(desk.EXACT)


@pytest.mark.parametrize("sensor", ["acc", "gyr", "mag"])
@pytest.mark.parametrize("row", range(3))
def test_a_calibration_is_valid_up_to_its_bounds_and_not_beyond(sensor, row):
    def is_valid(**fields: Any) -> bool:
        return bool(lib.calibration_is_valid(changed(sensor, **fields)))

    side = (row + 1) % 3
    rest = ROW_MAX - 2**14
    for sign in (1, -1):
        assert is_valid(bias=((row,), sign * BIAS_MAX))
        assert not is_valid(bias=((row,), sign * (BIAS_MAX + 1)))
        assert is_valid(matrix=((row, row), sign * ROW_MAX))
        assert not is_valid(matrix=((row, row), sign * (ROW_MAX + 1)))
        assert is_valid(matrix=((row, side), sign * rest))
        assert not is_valid(matrix=((row, side), sign * (rest + 1)))
    assert not is_valid(bias=((row,), INT32_MIN))
    assert not is_valid(matrix=((row, row), -(2**15)))


@pytest.mark.parametrize(
    ("then_c", "now_c", "warmth"),
    [
        (25, 25, 0),
        (25, 26.2, 0),
        (25, 26.3, 1),
        (25, -5, 23),
        (-40, 85, 97),
        (-42, 85, 99),
        (-44, 85, 0),  # no chip's
        (327, -327, 0),
        (None, 9, 0),
        (None, -40, 0),
        (None, -327, 0),
    ],
)
def test_a_measurement_tells_how_far_the_temperature_has_gone(then_c, now_c, warmth):
    calibration = ffi.new("struct calibration *", desk.EXACT[0])
    calibration.temperature = -(2**15) if then_c is None else 100 * then_c
    samples = samples_of(np.zeros((2, 3)))
    samples["temperature_cdeg"] = (round(100 * now_c), -(2**15))
    found = calibrated(calibration, MPU9250, samples)["warmth"]
    assert found.tolist() == [warmth, 0]
