# SPDX-License-Identifier: MIT
"""The driver of a joined sensor with the models of its chips, and their faults."""

from __future__ import annotations

import math

import pytest

from core.joined_chip import ffi, lib
from core.joined_desk import Bench, running
from core.joined_model import G, Models
from core.sensor_desk import axes
from length import IS_SAMPLE

INERTIAL, MAGNETIC = 0, 1  # on the wire
INERTIAL_PASSED = lib.SELF_TEST_ACC_PASSED | lib.SELF_TEST_GYR_PASSED
ALL_PASSED = INERTIAL_PASSED | lib.SELF_TEST_MAG_PASSED
REST_Z = pytest.approx(1 / 0.488e-3, abs=0.51)
FIELD = [pytest.approx(v * 68.42, abs=1) for v in (0, 20, -40)]


def settled(bench: Bench) -> Bench:
    """Samples until all filters have forgotten the past."""
    bench.samples(40)
    return bench


@pytest.mark.parametrize("who", [0x6C, 0x6B])
@pytest.mark.parametrize("high", [False, True])
def test_the_models_pass_set_up_and_have_nothing_against_it(who, high):
    bench = running(Models({"who_am_i": who, "sa0": high}, {"sa1": high}))
    assert bench.identity.self_test == ALL_PASSED
    assert list(bench.identity.who_am_i) == [who, 0x3D]
    sample = settled(bench).sample()
    assert axes(sample.acc) == (0, 0, REST_Z)
    assert axes(sample.gyr) == (0, 0, 0)
    assert sample.temperature_cdeg == pytest.approx(2500, abs=1)
    assert list(bench.field()) == FIELD
    for _ in range(6):
        bench.samples(3)
        assert bench.check() == lib.SENSOR_OK
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.chips.complaints == []


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
def test_physical_values_arrive_on_their_axes(axis, sign):
    bench = running(Models())
    gyr, acc, mag = [0.0] * 3, [0.0] * 3, [0.0] * 3
    gyr[axis] = sign * math.radians(1234)
    acc[axis] = sign * 12 * G
    mag[axis] = sign * 350.0
    bench.chips.hold(tuple(gyr), tuple(acc), tuple(mag))
    sample = settled(bench).sample()
    field = bench.field()
    for i in range(3):
        own = sign * (i == axis)
        assert sample.gyr.axis[i] == pytest.approx(own * 1234 / 0.07, abs=1)
        assert sample.acc.axis[i] == pytest.approx(own * 12 / 0.488e-3, abs=1)
        assert field[i] == pytest.approx(own * 350 * 68.42, abs=1.5)
    assert not (sample.gyr_clipped or sample.acc_clipped)
    assert bench.chips.complaints == []


def test_samples_come_208_times_a_second_and_fields_80():
    bench = settled(running(Models()))
    before_us = bench.chips.now_us
    samples = bench.samples(416)
    assert bench.chips.now_us - before_us == pytest.approx(2e6, abs=10_000)
    assert 158 <= sum(sample.has_mag for sample in samples) <= 162


@pytest.mark.parametrize("part", range(4))
def test_a_wire_pulled_at_any_transaction_is_survived(part):
    count = running(Models()).transactions
    assert count > 100
    for pulled_at in range(1 + part, count + 1, 16 if IS_SAMPLE else 4):
        bench = Bench(Models())
        bench.pulled_at = pulled_at
        assert bench.set_up() in (lib.SENSOR_OK, lib.SENSOR_BUS_NACK)
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert bench.identity.self_test == ALL_PASSED
        assert list(bench.identity.who_am_i) == [0x6C, 0x3D]
        assert bench.chips.complaints == []


@pytest.mark.parametrize("at_byte", [0, 1, 2])
def test_a_refused_byte_of_the_inertial_chip_is_told_as_such(at_byte):
    bench = Bench(Models())
    bench.chips.fault(
        INERTIAL, lib.CHIP_FAULT_NACK, first=30, transactions=1_000_000, at_byte=at_byte
    )
    assert bench.set_up() == lib.SENSOR_BUS_NACK


@pytest.mark.parametrize("wire", [INERTIAL, MAGNETIC])
def test_a_held_data_line_is_a_stuck_bus(wire):
    bench = Bench(Models())
    bench.chips.fault(wire, lib.CHIP_FAULT_STUCK_SDA, from_ns=200_000_000)
    assert bench.set_up() == lib.SENSOR_BUS_STUCK
    bench.chips.mend()
    assert bench.set_up() == lib.SENSOR_OK


@pytest.mark.parametrize("from_ms", [0, 300, 600])
def test_an_inertial_chip_that_never_gets_ready_is_stuck_in_bounded_time(from_ms):
    bench = Bench(Models())
    bench.chips.fault(
        INERTIAL, lib.CHIP_FAULT_NO_DATA_READY, from_ns=from_ms * 1_000_000
    )
    assert bench.set_up() == lib.SENSOR_STUCK
    bench.chips.mend()
    assert bench.set_up() == lib.SENSOR_OK


@pytest.mark.parametrize(
    ("kind", "failed"),
    [
        (lib.CHIP_FAULT_ACC_SELF_TEST, lib.SELF_TEST_ACC_FAILED),
        (lib.CHIP_FAULT_GYR_SELF_TEST, lib.SELF_TEST_GYR_FAILED),
    ],
)
def test_a_weak_sensor_fails_its_self_test(kind, failed):
    bench = Bench(Models())
    bench.chips.fault(INERTIAL, kind)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED & ~(failed >> 4) | failed


def test_a_wrong_identity_is_refused_and_named():
    bench = Bench(Models())
    bench.chips.fault(INERTIAL, lib.CHIP_FAULT_WRONG_WHO_AM_I, value=0x69)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert bench.identity.who_am_i[0] == 0x69


def test_a_magnetometer_that_dies_is_left_out_and_comes_back():
    bench = settled(running(Models()))
    bench.chips.fault(MAGNETIC, lib.CHIP_FAULT_NO_MAG)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0]
    assert bench.identity.self_test == INERTIAL_PASSED
    assert set(bench.checks(8)) == {lib.SENSOR_OK}
    bench.chips.mend()
    assert lib.SENSOR_MAG_CHANGED in bench.checks(2)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.field()) == FIELD


def test_a_magnetometer_that_stops_measuring_is_noticed():
    bench = settled(running(Models()))
    bench.chips.fault(MAGNETIC, lib.CHIP_FAULT_NO_DATA_READY)
    results = bench.checks(12)
    assert results[-1] == lib.SENSOR_MAG_CHANGED
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test & lib.SELF_TEST_MAG_FAILED


FLIPS = [
    *((INERTIAL, reg) for reg in (0x0D, *range(0x10, 0x1A))),
    *((MAGNETIC, reg) for reg in range(0x20, 0x25)),
]


@pytest.mark.parametrize(("wire", "reg"), FLIPS)
def test_a_register_that_changes_by_itself_is_noticed_by_the_second_check(wire, reg):
    bench = settled(running(Models()))
    value = 0x20 if wire == MAGNETIC else 0x04 if reg == 0x12 else 0x41
    now_ns = round(bench.chips.now_us * 1000)
    bench.chips.fault(
        wire, lib.CHIP_FAULT_REGISTER_FLIP, from_ns=now_ns, reg=reg, value=value
    )
    bench.let_pass(10)
    assert lib.SENSOR_UNSET in (bench.check(), bench.check())
    assert bench.identity.wrong_register == reg
    assert bench.set_up() == lib.SENSOR_OK
    assert axes(settled(bench).sample().acc) == (0, 0, REST_Z)


@pytest.mark.parametrize("wire", [INERTIAL, MAGNETIC])
def test_a_chip_that_lost_its_power_alone_is_noticed_by_the_second_check(wire):
    bench = settled(running(Models()))
    now_ns = round(bench.chips.now_us * 1000)
    bench.chips.fault(wire, lib.CHIP_FAULT_BROWN_OUT, from_ns=now_ns)
    bench.let_pass(50_000)
    assert lib.SENSOR_UNSET in (bench.check(), bench.check())
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.field()) == FIELD


def test_chips_whose_power_went_are_set_up_again():
    bench = settled(running(Models()))
    now_ns = round(bench.chips.now_us * 1000)
    lib.lsm6dsox_chip_power_cycle(bench.chips.inertial, now_ns)
    lib.lis3mdl_chip_power_cycle(bench.chips.magnetic, now_ns)
    assert bench.set_up() == lib.SENSOR_OK
    assert axes(settled(bench).sample().acc) == (0, 0, REST_Z)
    assert bench.chips.complaints == []


def test_a_processor_reset_while_data_wait_finds_its_sensor_again():
    # INT1 is high then, and a chip reset with that knows I3C alone.
    bench = settled(running(Models()))
    bench.let_pass(20_000)
    assert bench.chips.is_ready
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.chips.complaints == []


def test_two_reads_of_one_field_are_one_field():
    bench = settled(running(Models()))
    bench.field()
    address, reg, length = bench.bursts[1]
    data = ffi.new("uint8_t[]", length)
    assert bench.chips.read(None, address, reg, data, length) == lib.BUS_OK
    assert data[0] & 0x08 == 0


def test_an_overwritten_sample_is_whole_and_the_newest():
    bench = settled(running(Models()))
    bench.let_pass(30_000)
    bench.chips.hold(acc=(G, 0, 0))
    bench.let_pass(100_000)
    taken = b""
    for address, reg, length in bench.bursts:
        data = ffi.new("uint8_t[]", length)
        assert bench.chips.read(None, address, reg, data, length) == lib.BUS_OK
        taken += bytes(data)
    bench.parse(taken)
    assert axes(bench.sample().acc) == (REST_Z, 0, 0)
