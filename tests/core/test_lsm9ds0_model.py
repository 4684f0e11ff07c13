# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver and the model that the virtual boards have."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from core.lsm9ds0_chip import (
    ACC_FAILED,
    ACC_PASSED,
    BOTH_PASSED,
    GYR_FAILED,
    GYR_PASSED,
    Triple,
    ffi,
    lib,
)
from core.lsm9ds0_desk import Bench, Model, block, running
from core.sensor_desk import axes
from length import IS_SAMPLE

pytestmark = pytest.mark.sampled(2)


def modelled(*, is_fast: bool = False, **config: Any) -> Bench:
    return running(Model(**config), is_fast=is_fast)


def settled(bench: Bench) -> Any:
    """Return a sample with a field, all filters' past behind it."""
    return [sample for sample in bench.samples(40) if sample.has_mag][-1]


def approx(values: Triple, lsb: float) -> list[Any]:
    return [pytest.approx(value / lsb, abs=0.51) for value in values]


@pytest.mark.parametrize("is_fast", [False, True])
def test_the_model_agrees_and_does_not_complain(is_fast):
    bench = modelled(is_fast=is_fast)
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]
    assert bench.identity.self_test == BOTH_PASSED
    assert not any(sample.has_gap for sample in bench.samples(20))
    assert bench.chip.complaint is None


@pytest.mark.parametrize("turn", range(3))
def test_the_models_motion_arrives_in_its_frame(turn):
    bench = modelled()

    def turned(values: Triple) -> Triple:
        x, y, z = values[turn:] + values[:turn]
        return x, y, z

    gyr, acc, mag = (
        turned((1.0, -2.0, 30.0)),
        turned((-9.0, 70.0, 3.0)),
        turned((20.0, -45.0, 150.0)),
    )
    bench.chip.hold(gyr, acc, mag)
    sample = settled(bench)
    identity = bench.identity
    assert list(axes(sample.gyr)) == approx(gyr, identity.gyr_lsb_nrad_s * 1e-9)
    assert list(axes(sample.acc)) == approx(acc, identity.acc_lsb_nm_s2 * 1e-9)
    assert list(axes(sample.mag)) == approx(mag, identity.mag_lsb_pt * 1e-6)


@pytest.mark.parametrize("celsius", [-40.0, 0.0, 25.0, 36.6, 85.0])
def test_the_models_temperature_arrives(celsius):
    bench = modelled()
    lib.lsm9ds0_chip_set_temperature(bench.chip.c, celsius)
    # An eighth of a degree, rounded twice.
    assert settled(bench).temperature_cdeg == pytest.approx(celsius * 100, abs=7)


@pytest.mark.parametrize("is_fast", [False, True])
@pytest.mark.parametrize("g_ppm", [-20_000, 0, 20_000])
@pytest.mark.parametrize("xm_ppm", [-20_000, -1000, 0, 20_000])
def test_clocks_that_differ_double_nothing_and_lose_little(is_fast, g_ppm, xm_ppm):
    bench = modelled(is_fast=is_fast, g_rate_error_ppm=g_ppm, xm_rate_error_ppm=xm_ppm)
    fields = []
    for turn in range(bench.identity.rate_hz * 2):
        # No two measurements are equal; more than the field that was held before.
        bench.chip.hold(mag=(0, 21 + 0.05 * turn, 0))
        sample = bench.sample()
        assert bench.driver.held == 0
        assert not sample.has_gap
        if sample.has_mag:
            fields.append(sample.mag.y)
    assert all(one < two for one, two in itertools.pairwise(fields))
    measured = 200 * (1 + (xm_ppm - g_ppm) * 1e-6)
    assert 0.75 * measured <= len(fields) <= measured + 2


@pytest.mark.long
def test_a_models_wire_pulled_anywhere_is_reported_and_the_next_set_up_works():
    count = modelled().transactions
    assert count > 100
    for pulled_at in range(1, count + 1, 3 if IS_SAMPLE else 1):
        bench = Bench(Model())
        bench.pulled_at = pulled_at
        assert bench.set_up() == lib.SENSOR_BUS_NACK
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert bench.identity.self_test == BOTH_PASSED
        assert bench.sample().acc.z == pytest.approx(1 / 0.732e-3, abs=0.51)
        assert bench.chip.complaint is None


@pytest.mark.parametrize("at_byte", [0, 1, 2])
def test_a_refused_byte_is_told_as_such(at_byte):
    bench = Bench(Model())
    bench.chip.fault(
        lib.CHIP_FAULT_NACK, first=3, transactions=1_000_000, at_byte=at_byte
    )
    assert bench.set_up() == lib.SENSOR_BUS_NACK


def test_a_held_data_line_is_a_stuck_bus():
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_STUCK_SDA, from_ns=400_000_000)
    assert bench.set_up() == lib.SENSOR_BUS_STUCK


@pytest.mark.parametrize("die", [lib.LSM9DS0_CHIP_G, lib.LSM9DS0_CHIP_XM])
@pytest.mark.parametrize("from_ms", [0, 500, 1000])
def test_a_model_that_never_gets_ready_is_stuck_in_bounded_time(die, from_ms):
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_NO_DATA_READY, die=die, from_ns=from_ms * 1_000_000)
    assert bench.set_up() == lib.SENSOR_STUCK
    lib.i2c_slave_clear_faults(lib.lsm9ds0_chip_wire(bench.chip.c))
    assert bench.set_up() == lib.SENSOR_OK


def test_a_model_without_magnetometer_has_six_axes():
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_NO_MAG)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0]
    assert bench.identity.self_test == BOTH_PASSED | lib.SELF_TEST_MAG_FAILED
    assert not any(sample.has_mag for sample in bench.samples(40))


@pytest.mark.parametrize(
    ("kind", "verdict"),
    [
        (lib.CHIP_FAULT_GYR_SELF_TEST, ACC_PASSED | GYR_FAILED),
        (lib.CHIP_FAULT_ACC_SELF_TEST, ACC_FAILED | GYR_PASSED),
    ],
)
def test_a_weak_sensor_fails_its_self_test(kind, verdict):
    bench = Bench(Model())
    bench.chip.fault(kind)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == verdict


def test_an_accelerometer_whose_clock_stops_ends_the_models_samples():
    bench = modelled()
    bench.samples(5)
    bench.chip.fault(lib.CHIP_FAULT_NO_DATA_READY, die=lib.LSM9DS0_CHIP_XM)
    bench.samples(4)
    # One may have been measured before the clock stopped.
    assert bench.is_refused(bench.take()) or bench.is_refused(bench.take())


def test_a_chip_whose_power_went_is_set_up_again():
    bench = modelled()
    lib.lsm9ds0_chip_power_cycle(bench.chip.c, round(bench.chip.now_us * 1000))
    assert bench.set_up() == lib.SENSOR_OK
    assert settled(bench).acc.z == pytest.approx(1 / 0.732e-3, abs=0.51)
    assert bench.chip.complaint is None


def test_data_ready_stands_until_the_sample_is_read():
    bench = modelled()
    assert not bench.chip.is_ready
    bench.chip.now_us += 20_000
    assert bench.chip.is_ready
    address, reg, length = bench.bursts[0]
    data = ffi.new("uint8_t[]", 23)
    assert bench.chip.read(None, address, reg, data, length) == lib.BUS_OK
    assert not bench.chip.is_ready
    ffi.memmove(data + 7, block()[7:], 16)
    assert bench.parse(bytes(data)).has_gap, "the chip overwrote some"
    assert not bench.sample().has_gap


HALVES = {lib.LSM9DS0_CHIP_G: range(0x20, 0x25), lib.LSM9DS0_CHIP_XM: range(0x1F, 0x27)}


def check(bench: Bench) -> int:
    return int(bench.call("check", bench.bus))


@pytest.mark.parametrize("is_fast", [False, True])
def test_a_healthy_chip_passes_every_check(is_fast):
    bench = modelled(is_fast=is_fast)
    for _ in range(20):
        before_us = bench.chip.now_us
        assert check(bench) == lib.SENSOR_OK
        assert bench.chip.now_us - before_us < 350  # of 1316 between two edges
        bench.samples(3)
    assert bench.chip.complaint is None


@pytest.mark.parametrize(
    ("die", "reg"), [(die, reg) for die, regs in HALVES.items() for reg in regs]
)
def test_a_register_that_changes_by_itself_is_noticed_by_the_second_check(die, reg):
    bench = modelled()
    bench.chip.fault(lib.CHIP_FAULT_REGISTER_FLIP, die=die, reg=reg, value=0x41)
    bench.let_pass(1)
    assert lib.SENSOR_UNSET in (check(bench), check(bench))
    assert bench.identity.wrong_register == reg
    assert bench.set_up() == lib.SENSOR_OK
    assert settled(bench).acc.z == pytest.approx(1 / 0.732e-3, abs=0.51)


def test_a_chip_that_lost_its_power_alone_is_noticed_by_the_next_check():
    bench = modelled()
    bench.chip.fault(lib.CHIP_FAULT_BROWN_OUT)
    bench.let_pass(50_000)
    assert check(bench) == lib.SENSOR_UNSET
