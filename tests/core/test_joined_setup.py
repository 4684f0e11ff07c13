# SPDX-License-Identifier: MIT
"""The set-up of a joined sensor: LSM6DSOX or LSM6DSV16X, LIS3MDL; and each failure."""

from __future__ import annotations

import math

import pytest

from core.joined_desk import Bench, every_family, running
from core.sensor_desk import axes, ffi, lib

INERTIAL_PASSED = lib.SELF_TEST_ACC_PASSED | lib.SELF_TEST_GYR_PASSED
ALL_PASSED = INERTIAL_PASSED | lib.SELF_TEST_MAG_PASSED


def test_set_up_leaves_the_chips_as_the_documents_want_them():
    bench = running()

    def registers(chip, first, end):
        return [chip.peek(reg) for reg in range(first, end)]

    # INT1_CTRL, INT2_CTRL: the gyroscope's data-ready on INT1.
    assert registers(bench.inertial, 0x0D, 0x0F) == [0x02, 0x00]
    # CTRL1_XL to CTRL10_C: 208 Hz, 16 g; 208 Hz, 2000 deg/s; whole blocks, addresses
    # that increase; high performance, no test; I3C off.
    control = registers(bench.inertial, 0x10, 0x1A)
    assert control == [0x54, 0x5C, 0x44, 0, 0, 0, 0, 0, 0xE2, 0]
    # CTRL_REG1 to 5: ultra-high performance, 80 Hz; 4 gauss; continuous; whole blocks.
    assert registers(bench.magnetic, 0x20, 0x25) == [0xFC, 0x00, 0x00, 0x0C, 0x40]
    assert bench.complaint is None


def test_identity_tells_chips_units_and_verdicts():
    identity = running().identity
    assert identity.kind == lib.SENSOR_LSM6DSOX
    assert list(identity.who_am_i) == [0x6C, 0x3D]
    assert list(identity.mag_adjust) == [0, 0, 0]
    assert identity.self_test == ALL_PASSED
    assert identity.rate_hz == 208
    # ST's driver of the LSM6DSO for Qualcomm's sensor core, at 208 Hz: 4.86 ms.
    assert identity.gyr_delay_us == 4860
    # Half of a measurement at 155 Hz, half of a period.
    assert identity.mag_lag_us == pytest.approx(5e5 / 155 + 5e5 / 208, abs=2)
    assert identity.gyr_lsb_nrad_s == round(math.radians(0.070) * 1e9)
    assert identity.acc_lsb_nm_s2 == round(0.488e-3 * 9.80665 * 1e9)
    assert identity.mag_lsb_pt == round(1e8 / 6842)


@every_family
@pytest.mark.parametrize("inertial", [0x6A, 0x6B])
@pytest.mark.parametrize("magnetic", [0x1C, 0x1E])
def test_each_chip_is_found_at_either_of_its_addresses(make, inertial, magnetic):
    at = {"inertial": {"sa0": inertial == 0x6B}, "magnetic": {"sa1": magnetic == 0x1E}}
    bench = running(make, **at)
    # The status and the field in one burst; bit 7 has the LIS3MDL's addresses increase.
    assert bench.bursts == [(inertial, 0x20, 14), (magnetic, 0xA7, 7)]
    ready = bench.driver.ready
    assert (ready.address, ready.reg, ready.mask) == (inertial, 0x1E, 0x02)
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.488e-3))


@pytest.mark.parametrize("who", [0x6C, 0x6B])
def test_both_families_run_and_are_named(who):
    bench = running(inertial={"who_am_i": who})
    assert list(bench.identity.who_am_i) == [who, 0x3D]
    assert bench.check() == lib.SENSOR_OK


def test_a_relative_has_the_scales_and_delay_of_its_own_row():
    known = lib.adafruit_4517
    row = {"who_am_i": (0xED,), "gyr_delay_us": 1, "acc_lsb_nm_s2": 2, "rate_hz": 3}
    rows = ffi.new("struct sensor_identity[]", [known.inertial.chip.kinds[0], row])
    chip = ffi.new("struct part_chip *", known.inertial.chip[0])
    chip.kinds, chip.kinds_count = rows, 2
    inertial = ffi.new("struct joined_inertial *", known.inertial[0])
    inertial.chip = chip
    config = ffi.new("struct joined_config *", known)
    config.inertial = inertial
    bench = running(inertial={"who_am_i": 0xED}, config=config)
    found = {name: getattr(bench.identity, name) for name in row}
    assert found | {"who_am_i": tuple(found["who_am_i"])} == row | {
        "who_am_i": (0xED, 0x3D)
    }
    assert bench.identity.mag_lsb_pt == round(1e8 / 6842)


@pytest.mark.parametrize("who", [0x69, 0x6A, 0x6E, 0x71, 0xFF])
def test_an_inertial_chip_of_another_kind_is_refused_and_named(who):
    bench = Bench(inertial={"who_am_i": who})
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.log if what == "write"]


@pytest.mark.parametrize("who", [0x00, 0x40, 0x3C, 0xFF])
def test_a_magnetometer_of_another_kind_is_left_alone(who):
    bench = running(magnetic={"sa1": True, "who_am_i": who})
    assert list(bench.identity.who_am_i) == [0x6C, 0]
    assert bench.identity.self_test == INERTIAL_PASSED
    assert not [at for _, what, at, *_ in bench.log if (what, at) == ("write", 0x1E)]


def test_an_lsm6dso32_whose_ranges_are_twice_as_wide_is_told_by_its_force():
    # It has the LSM6DSO's identity, and says 1 g with half of its counts.
    bench = Bench(inertial={"acc_self_test_mg": [210, 195, 255]})
    bench.hold(g=(0, 0, 0.5))
    assert bench.set_up(bound_us=3_000_000) == lib.SENSOR_NO_FORCE


@every_family
def test_a_probe_that_is_shaken_at_first_is_waited_for(make):
    bench = make()
    bench.hold(g=(0, 0, 3))
    bench.call("begin")
    for _ in range(500):
        assert bench.step() == lib.SENSOR_BUSY
        bench.let_pass(1000)
    bench.hold()
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.let_pass(1000)
    assert result == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED


def test_set_up_waits_as_long_as_the_examples_of_st():
    bench = running()
    log = bench.log
    named = next(t for t, what, at, reg, _ in log if (what, reg) == ("read", 0x0F))
    assert named >= 10_000  # after power
    for address, reg, value_reads, wait_us in (
        (0x6A, 0x14, 0x28, 100_000),  # CTRL5_C: the accelerometer's stimulus
        (0x1C, 0x20, 0xA8, 60_000),  # CTRL_REG1: the magnetometer's
    ):
        writes = [
            t for t, what, at, r, _ in log if (what, at, r) == ("write", address, reg)
        ]
        reads = [
            t
            for t, what, at, r, _ in log
            if (what, at, r) == ("read", address, value_reads)
        ]
        stimulated = next(t for t in writes if t > reads[0])
        first = next(t for t in reads if t > stimulated)
        assert first - stimulated >= wait_us
        assert len([t for t in reads if t < stimulated]) == 6  # one is thrown away


def test_int1_is_off_before_a_reset():
    # High, it would have the chip start with I3C alone.
    bench = running()
    assert bench.set_up() == lib.SENSOR_OK
    writes = [reg for _, what, at, reg, _ in bench.log if (what, at) == ("write", 0x6A)]
    first, second = (
        i for i, reg in enumerate(writes) if writes[i : i + 2] == [0x0D, 0x12]
    )
    assert first == 0
    assert second > 0


@every_family
def test_data_ready_is_low_where_set_up_ends(make):
    bench = running(make)
    assert not bench.inertial.call("pin_is_high", 0)


@every_family
@pytest.mark.parametrize(
    "chip",
    [
        {"inertial": {"reset_ns": 15_000_000}},
        {"magnetic": {"soft_reset_ns": 15_000_000}},
    ],
)
def test_a_reset_that_takes_long_is_waited_for(make, chip):
    bench = make(**chip)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED


@every_family
def test_an_inertial_reset_without_end_is_stuck_in_bounded_time(make):
    bench = make(inertial={"reset_ns": 10**15})
    assert bench.set_up() == lib.SENSOR_STUCK
    assert bench.now_ns < 100_000_000


@every_family
@pytest.mark.parametrize("quantity", [lib.CHIP_ACC, lib.CHIP_GYR])
def test_an_inertial_sensor_that_never_gets_ready_is_stuck_in_bounded_time(
    make, quantity
):
    bench = make()
    bench.inertial.fault("NO_DATA_READY", value=1 + quantity)
    assert bench.set_up() == lib.SENSOR_STUCK
    bench.inertial.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK


@every_family
def test_one_that_stops_after_its_test_is_stuck_too(make):
    bench = running(make)
    bench.inertial.fault("NO_DATA_READY", value=1 + lib.CHIP_ACC)
    assert bench.set_up() == lib.SENSOR_STUCK


@every_family
def test_an_inertial_chip_that_does_not_answer_is_a_failed_bus_until_it_does(make):
    bench = make()
    bench.inertial.fault("NACK")
    assert bench.set_up() == lib.SENSOR_BUS_NACK
    assert [at for *_, at, _, _ in bench.log] == [0x6A, 0x6B]
    bench.inertial.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK


def test_a_register_that_does_not_keep_its_value_is_named():
    bench = Bench()
    put = bench.inertial.try_put
    bench.inertial.try_put = lambda address, reg, value: put(
        address, reg, value & ~0x0C if (reg, value) == (0x11, 0x5C) else value
    )
    # It has 250 deg/s: the answers are clipped, and the register read back differs.
    assert bench.set_up() == lib.SENSOR_UNSET
    assert bench.identity.wrong_register == 0x11


def test_without_a_magnetometer_there_are_six_axes():
    bench = Bench()
    bench.magnetic.fault("NACK")
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0]
    assert bench.identity.self_test == INERTIAL_PASSED
    assert bench.bursts == [(0x6A, 0x20, 14)]
    assert not any(sample.has_mag for sample in bench.samples(40))


def test_a_magnetometer_that_never_measures_is_left_out_and_told():
    bench = Bench()
    bench.magnetic.fault("NO_DATA_READY")
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0]
    assert bench.identity.self_test == INERTIAL_PASSED | lib.SELF_TEST_MAG_FAILED


def test_a_magnetometer_that_holds_the_bus_is_for_the_board_to_free():
    bench = Bench()
    bench.magnetic.fault("STUCK_SDA")
    assert bench.set_up() == lib.SENSOR_BUS_STUCK
    bench.magnetic.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x6C, 0x3D]


@every_family
@pytest.mark.parametrize(
    ("chip", "name", "weak", "failed"),
    [
        ("inertial", "acc_self_test_mg", (500, 40, 500), lib.SELF_TEST_ACC_FAILED),
        ("inertial", "acc_self_test_mg", (500, 500, 1800), lib.SELF_TEST_ACC_FAILED),
        ("inertial", "gyr_self_test_dps", (140, 400, 400), lib.SELF_TEST_GYR_FAILED),
        ("inertial", "gyr_self_test_dps", (400, 720, 400), lib.SELF_TEST_GYR_FAILED),
        ("magnetic", "self_test_ut", (90, 200, 50), lib.SELF_TEST_MAG_FAILED),
        ("magnetic", "self_test_ut", (200, 310, 50), lib.SELF_TEST_MAG_FAILED),
        ("magnetic", "self_test_ut", (200, 200, 9), lib.SELF_TEST_MAG_FAILED),
        ("magnetic", "self_test_ut", (200, 200, 110), lib.SELF_TEST_MAG_FAILED),
    ],
)
def test_a_sensor_that_answers_weakly_or_wildly_fails_its_self_test(
    make, chip, name, weak, failed
):
    bench = make(**{chip: {name: weak}})
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED & ~(failed >> 4) | failed
    # The verdict is kept: it is not tested again.
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED & ~(failed >> 4) | failed


@every_family
@pytest.mark.parametrize(
    ("unit", "weak", "swing"),
    [
        ("g", {"inertial": {"acc_self_test_mg": [0] * 3}}, ((0, 0, 1), (0, 0.15, 1))),
        ("dps", {"inertial": {"gyr_self_test_dps": [0] * 3}}, ((0, 0, 0), (0, 0, 5))),
        (
            "gauss",
            {"magnetic": {"self_test_ut": [0] * 3}},
            ((0.2, 0, 0), (0.2, 0.12, 0)),
        ),
    ],
)
def test_a_failure_while_the_probe_moves_is_no_verdict(make, unit, weak, swing):
    bench = make(**weak)
    bench.call("begin")
    turn = 0
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.hold(**{unit: swing[turn // 8 % 2]})
        bench.let_pass(1000)
        turn += 1
    assert result == lib.SENSOR_OK
    flags = bench.identity.self_test
    assert bin(flags).count("1") == 2
    assert flags & ~ALL_PASSED == 0
    # The next set-up tests again: good chips.
    for address, chip in make().chips.items():
        chip.now = bench.chip.now
        bench.chips[address] = chip
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED
