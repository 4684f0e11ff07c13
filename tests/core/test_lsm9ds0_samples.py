# SPDX-License-Identifier: MIT
"""Samples of the LSM9DS0: physical values in, counts out; readings that are none."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.lsm9ds0_desk import Bench, block, running
from core.sensor_desk import axes, ffi, lib

pytestmark = pytest.mark.sampled(3)


@pytest.mark.parametrize("raw", [-2048, -2047, -400, -1, 0, 1, 16, 400, 2047])
@pytest.mark.parametrize("above", [0x0000, 0xF000])  # four bits of no meaning
def test_temperature_is_right_to_the_ends_of_its_register(raw, above):
    sample = running_once().parse(block(temperature=raw & 0x0FFF | above))
    assert sample.temperature_cdeg == 2500 + math.floor(raw * 12.5)


def test_a_sample_carries_the_time_of_its_edge():
    bench = running()
    assert bench.parse(bench.take(), 0xFFFFFFFE).time_us == 0xFFFFFFFE


_SHARED: list[Bench] = []


def running_once() -> Bench:
    """Return one chip, set up, for tests that only parse."""
    if not _SHARED:
        _SHARED.append(running())
    bench = _SHARED[0]
    bench.parse(block())
    return bench


def test_an_old_field_has_not_overflowed():
    sample = running_once().parse(block(mag=(32767, 0, 0), mag_status=0))
    assert not sample.has_mag
    assert not sample.mag_overflow
    assert axes(sample.mag) == (0, 0, 0)


@pytest.mark.parametrize("byte", [0x00, 0xFF])
def test_a_bus_that_nobody_drives_is_no_reading(byte):
    bench = running_once()
    assert bench.is_refused(bytes([byte]) * 23)
    # The magnetometer's part alone does not tell.
    assert bench.is_refused(bytes([byte]) * 14 + block()[14:])


def test_of_a_sample_amid_which_power_fails_no_ones_are_readings():
    bench = running_once()
    assert bench.is_refused(block()[:7] + bytes([0xFF]) * 16)
    sample = bench.parse(block()[:16] + bytes([0xFF]) * 7)
    assert (sample.has_mag, sample.mag_overflow) == (False, False)


def test_a_sample_of_all_ones_in_one_sensor_alone_is_a_reading():
    bench = running_once()
    sample = bench.parse(block(gyr=(-1, -1, -1), gyr_status=0xFF))
    assert axes(sample.gyr) == (-1, -1, -1)
    sample = bench.parse(block(acc=(-1, -1, -1), acc_status=0xFF))
    assert axes(sample.acc) == (-1, -1, -1)


@pytest.mark.parametrize("status", [0x00, 0x01, 0x07, 0x08, 0x0B, 0xF0])
def test_rates_that_are_not_all_new_are_no_reading(status):
    assert running_once().is_refused(block(gyr_status=status))


@pytest.mark.parametrize("status", [0x00, 0x01, 0x07, 0x08, 0x0E, 0xF7])
def test_a_field_that_is_not_new_on_all_axes_is_none(status):
    sample = running_once().parse(block(mag_status=status))
    assert not sample.has_mag
    assert axes(sample.mag) == (0, 0, 0)


@pytest.mark.parametrize("status", [0x00, 0x07, 0x0B])
def test_an_acceleration_is_held_for_four_samples_at_most(status):
    bench = running_once()
    for _ in range(3):
        for _ in range(4):
            held = bench.parse(block(acc=(5, 6, 7), acc_status=status))
            assert axes(held.acc) == (5, 6, 7)
        assert bench.is_refused(block(acc=(5, 6, 7), acc_status=status))
        assert bench.is_refused(block(acc=(5, 6, 7), acc_status=status))
        bench.parse(block())


def test_an_accelerometer_that_stops_ends_the_samples():
    bench = running()
    bench.samples(10)
    bench.chip.fault("NO_DATA_READY", value=1 + lib.CHIP_ACC)
    bench.samples(4)
    assert bench.is_refused(bench.take())


@pytest.mark.parametrize(("is_fast", "rate_hz"), [(False, 380), (True, 760)])
@pytest.mark.parametrize("error", [0.9, 0.999, 1.0, 1.001, 1.1])
def test_each_measurement_of_the_field_arrives_once(is_fast, rate_hz, error):
    bench = running(is_fast=is_fast, xm_rate_error_ppm=(error - 1) * 1e6)
    fields = []
    for turn in range(rate_hz * 2):
        # No two measurements are equal.
        bench.hold(gauss=(turn * 0.08e-3, 0, 0))
        sample = bench.sample()
        if sample.has_mag:
            fields.append(sample.mag.x)
    assert all(one < two for one, two in itertools.pairwise(fields))
    # A read takes 0.22 of the 2.6 ms (1.3 at 760 Hz) between samples. Clocks that keep
    # step lose one phase of five, at 760 Hz two where the phases are at their worst.
    measured = 2 * 100 * error
    assert 0.58 * measured <= len(fields) <= measured + 1


@pytest.mark.parametrize("is_fast", [False, True])
@pytest.mark.parametrize("error", [0.96, 0.99, 1.0, 1.01, 1.1])
def test_each_sample_has_an_acceleration_of_its_own(is_fast, error):
    bench = running(is_fast=is_fast, xm_rate_error_ppm=(error - 1) * 1e6)
    bench.sample()
    for _ in range(1000):
        bench.sample()
        assert bench.driver.held == 0


def test_samples_that_were_overwritten_leave_a_gap_before_the_next():
    bench = running()
    assert not bench.sample().has_gap
    bench.let_pass(6000)  # two and more
    assert bench.sample().has_gap
    assert not bench.sample().has_gap


@pytest.mark.parametrize("before", [False, True])
def test_a_gap_that_the_caller_knows_of_stays(before):
    bench = running_once()
    out = ffi.new("struct sample *", {"has_gap": before})
    assert lib.lsm9ds0_parse(bench.driver, block(), 0, out)
    assert out.has_gap == before


@given(st.binary(min_size=23, max_size=23))
def test_whatever_the_bytes_nothing_impossible_comes_out(data):
    bench = running_once()
    sample = ffi.new("struct sample *")
    if not lib.lsm9ds0_parse(bench.driver, data, 0, sample):
        assert data[0] & 0x0F != 0x0F or b"\xff" * 14 in data
        return
    assert not (sample.has_mag and sample.mag_overflow)
    assert sample.has_mag <= (data[16] & 0x0F == 0x0F and data[16:] != b"\xff" * 7)
    assert max(map(abs, axes(sample.mag))) <= 25000 or sample.mag_overflow
    assert -23100 <= sample.temperature_cdeg <= 28088
