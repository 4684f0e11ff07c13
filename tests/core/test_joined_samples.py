# SPDX-License-Identifier: MIT
"""Samples of a joined sensor, LSM6DSOX and LIS3MDL: physical values in, counts out; how
it looks after its chips."""

from __future__ import annotations

import itertools

import pytest

from core.joined_desk import ALL_PASSED, Bench, block, dsv, every_family, running
from core.sensor_desk import axes, ffi, lib

AXES = [(1, 2, 3), (2, 1, -3), (-3, 1, -2)]


@pytest.mark.parametrize("inertial", AXES)
@pytest.mark.parametrize("magnetic", AXES)
def test_each_chip_is_turned_into_the_axes_of_its_module(inertial, magnetic):
    known = lib.adafruit_4517
    config = ffi.new(
        "struct joined_config *",
        {
            "inertial": known.inertial,
            "magnetic": known.magnetic,
            "inertial_axes": inertial,
            "mag_axes": magnetic,
        },
    )
    bench = running(config=config)
    bench.hold((10, 20, 30), (1, 2, 3), (0.1, 0.2, 0.3))

    def turned(values, to):
        return [values[abs(axis) - 1] * (1 if axis > 0 else -1) for axis in to]

    sample = bench.samples(12)[-1]
    field = bench.field()
    for found, values, to, lsb in (
        (axes(sample.acc), (1, 2, 3), inertial, 0.488e-3),
        (axes(sample.gyr), (10, 20, 30), inertial, 0.07),
        (field, (0.1, 0.2, 0.3), magnetic, 1 / 6842),
    ):
        expected = [pytest.approx(v / lsb, abs=0.51) for v in turned(values, to)]
        assert list(found) == expected


def test_the_end_of_a_range_turned_round_stays_in_it():
    known = lib.adafruit_4517
    config = ffi.new(
        "struct joined_config *",
        {
            "inertial": known.inertial,
            "magnetic": known.magnetic,
            "inertial_axes": (-1, -2, -3),
            "mag_axes": (1, 2, 3),
        },
    )
    bench = running(config=config)
    bench.hold(g=(-20, 0, 1))
    sample = bench.sample()
    assert sample.acc.x == 32767
    assert sample.acc_clipped


@pytest.fixture(scope="module")
def still() -> Bench:
    return running()


@pytest.mark.parametrize(
    ("raw", "cdeg"),
    [
        (0, 2500),
        (256, 2600),
        (-256, 2400),
        (1, 2500),
        (2, 2501),
        (32767, 15300),
        (-32768, -10300),
    ],
)
def test_temperature_is_right_to_the_ends_of_its_register(still, raw, cdeg):
    assert still.parse(block(temperature=raw)).temperature_cdeg == cdeg


def test_a_sample_carries_the_time_of_its_edge(still):
    assert still.parse(block(), 0xFFFFFFFE).time_us == 0xFFFFFFFE


@pytest.mark.parametrize("status", [0x00, 0x01, 0x07, 0xF7, 0x70])
def test_a_field_that_is_not_new_is_none(still, status):
    sample = still.parse(block(mag=(32767, 1, 1), status=status))
    assert not sample.has_mag
    assert not sample.mag_overflow
    assert axes(sample.mag) == (0, 0, 0)


def test_a_field_that_overwrote_another_is_one(still):
    assert axes(still.parse(block(status=0xFF)).mag) == (10, 20, 30)


@pytest.mark.parametrize("byte", [0x00, 0xFF])
def test_a_bus_that_nobody_drives_is_no_reading(still, byte):
    assert still.is_refused(bytes([byte]) * 21)
    assert still.is_refused(bytes([byte]) * 14 + block()[14:])
    # The magnetometer alone: it has no field.
    sample = still.parse(block()[:14] + bytes([byte]) * 7)
    assert not sample.has_mag


def test_each_measurement_of_the_field_arrives_once():
    bench = running()
    bench.field()
    samples = bench.samples(416)  # 2 s
    assert 159 <= sum(sample.has_mag for sample in samples) <= 161


KEPT = (0x0D, 0x0E, *range(0x10, 0x1A))
FLIPS = [
    *((Bench, "inertial", reg) for reg in KEPT),
    *((Bench, "magnetic", reg) for reg in range(0x20, 0x25)),
    *((dsv, "inertial", reg) for reg in (*KEPT, 0x62)),
]


@pytest.mark.parametrize(("make", "chip", "reg"), FLIPS)
def test_a_register_that_changes_by_itself_is_noticed_by_a_check(make, chip, reg):
    bench = running(make)
    bench.samples(5)
    chip = getattr(bench, chip)
    bench.flip(chip, reg, chip.peek(reg) ^ 0x80)
    # The second one, or the fourth where a register is kept apart.
    assert lib.SENSOR_UNSET in [bench.check() for _ in range(2 if make is Bench else 4)]
    assert bench.identity.wrong_register == reg
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.wrong_register == 0
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.488e-3))


@every_family
def test_healthy_chips_pass_every_check_by_one_short_read_each(make):
    bench = running(make)
    for _ in range(20):
        bench.samples(4)
        before, before_ns = bench.transactions, bench.now_ns
        assert bench.check() == lib.SENSOR_OK
        assert bench.transactions == before + 1
        assert bench.now_ns - before_ns <= 400_000


@every_family
@pytest.mark.parametrize("chip", ["inertial", "magnetic"])
def test_a_chip_that_lost_its_power_alone_is_noticed_by_the_second_check(make, chip):
    bench = running(make)
    bench.samples(5)
    getattr(bench, chip).call("power_cycle", bench.now_ns)
    bench.let_pass(10_000)
    assert lib.SENSOR_UNSET in (bench.check(), bench.check())
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED


@every_family
def test_a_pulled_wire_is_reported_by_a_check(make):
    bench = running(make)
    for _ in range(4):
        bench.pulled_at = bench.transactions + 1
        assert bench.check() == lib.SENSOR_BUS_NACK


def test_a_magnetometer_that_goes_and_comes_back_is_found_again():
    bench = running()
    bench.magnetic.fault("NACK")
    assert bench.set_up() == lib.SENSOR_OK
    assert set(bench.checks(20)) == {lib.SENSOR_OK}
    bench.magnetic.clear_faults()
    results = bench.checks(2)
    assert results.count(lib.SENSOR_MAG_CHANGED) == 1
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0x3D]
    assert bench.field() == (0, round(0.2 * 6842), round(-0.4 * 6842))


def test_one_that_is_there_and_does_not_work_is_looked_for_ever_later():
    bench = Bench()
    bench.magnetic.fault("NO_DATA_READY")
    waits = []
    for _ in range(4):
        assert bench.set_up() == lib.SENSOR_OK
        waits.append(0)
        while bench.check() == lib.SENSOR_OK:
            waits[-1] += 1
    assert all(later >= 2 * before for before, later in itertools.pairwise(waits))
    for _ in range(10):  # and not beyond some minutes
        assert bench.set_up() == lib.SENSOR_OK
    waited = 0
    while bench.check() == lib.SENSOR_OK:
        waited += 1
    assert waited <= 2 * 256
    bench.magnetic.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0x3D]


def test_one_that_works_in_set_up_alone_is_left_out_after_three():
    bench = Bench()
    parts = []
    for _ in range(5):
        bench.magnetic.clear_faults()
        assert bench.set_up() == lib.SENSOR_OK
        parts.append((bench.identity.who_am_i[1], bench.identity.self_test >> 6))
        bench.magnetic.fault("NO_DATA_READY")
        bench.magnetic.get(bench.magnetic_at, 0xA8, 6)  # nothing waits to be read
        looks = 1
        while bench.samples(4) and bench.check() == lib.SENSOR_OK:
            looks += 1
        assert looks == 12 or parts[-1][0] == 0
    assert parts == [(0x3D, 0)] * 3 + [(0, 1), (0x3D, 0)]


def test_one_that_holds_the_bus_is_addressed_in_three_set_ups():
    bench = Bench()
    bench.magnetic.fault("STUCK_SDA")
    assert [bench.set_up() for _ in range(4)] == [*[lib.SENSOR_BUS_STUCK] * 3, 0]
    assert bench.identity.self_test & lib.SELF_TEST_MAG_FAILED
    assert bench.samples(4)


def test_looking_for_a_magnetometer_meets_a_bus_that_is_held():
    bench = Bench()
    bench.magnetic.fault("NACK")
    assert bench.set_up() == lib.SENSOR_OK
    bench.magnetic.clear_faults()
    bench.magnetic.fault("STUCK_SDA")
    assert lib.SENSOR_BUS_STUCK in (bench.check(), bench.check())


def test_another_chip_at_its_address_is_not_taken_for_it():
    bench = Bench(magnetic={"who_am_i": 0x40})
    assert bench.set_up() == lib.SENSOR_OK
    assert set(bench.checks(10)) == {lib.SENSOR_OK}


def test_an_ism330dhcx_has_the_same_counts():
    bench = running(inertial={"sa0": True, "who_am_i": 0x6B})
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.488e-3))
