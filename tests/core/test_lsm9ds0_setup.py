# SPDX-License-Identifier: MIT
"""The set-up of the LSM9DS0, and every failure of it."""

from __future__ import annotations

import itertools
import math

import pytest

from core.lsm9ds0_desk import BOTH_PASSED, XM, Bench, G, running
from core.sensor_desk import axes, lib


@pytest.mark.parametrize(
    ("is_fast", "gyr", "acc"), [(False, 0xBF, 0x9F), (True, 0xFF, 0xAF)]
)
def test_set_up_leaves_the_chip_as_the_document_wants_it(is_fast, gyr, acc):
    bench = running(is_fast=is_fast)
    # CTRL_REG1_G to 5: rate and low-pass of 100 Hz, all axes on; no high-pass; data-
    # ready on its pin; blocks updated whole, 2000 deg/s, no test; low-passed.
    registers = [bench.chip.peek(reg, G) for reg in range(0x20, 0x25)]
    assert registers == [gyr, 0x00, 0x08, 0xA0, 0x02]
    # CTRL_REG0_XM to 7: no FIFO; 800 or 1600 Hz, whole blocks, all axes; 194 Hz, 16 g,
    # no test; no pins; temperature, high resolution, 100 Hz; 2 gauss; continuous.
    registers = [bench.chip.peek(reg, XM) for reg in range(0x1F, 0x27)]
    assert registers == [0x00, acc, 0x60, 0x00, 0x00, 0xF4, 0x00, 0x00]
    assert bench.complaint is None


@pytest.mark.parametrize(("is_fast", "rate_hz"), [(False, 380), (True, 760)])
def test_identity_tells_chip_units_and_verdict(is_fast, rate_hz):
    identity = running(is_fast=is_fast).identity
    assert identity.kind == lib.SENSOR_LSM9DS0
    assert list(identity.who_am_i) == [0xD4, 0x49]
    assert list(identity.mag_adjust) == [0, 0, 0]
    assert identity.self_test == BOTH_PASSED
    assert identity.rate_hz == rate_hz
    # Two poles at 100 Hz.
    assert identity.gyr_delay_us == round(math.sqrt(2) / (2 * math.pi * 100) * 1e6)
    assert identity.gyr_lsb_nrad_s == round(math.radians(0.070) * 1e9)
    assert identity.acc_lsb_nm_s2 == round(0.732e-3 * 9.80665 * 1e9)
    assert identity.mag_lsb_pt == round(0.08e-3 * 1e-4 * 1e12)


@pytest.mark.parametrize(("gyr", "xm"), [(0x6B, 0x1D), (0x6A, 0x1E), (0x6B, 0x1E)])
def test_a_sample_is_three_bursts_of_the_halves_where_they_are_wired(gyr, xm):
    bench = running(sa0_g=gyr == 0x6B, sa0_xm=xm == 0x1D)
    assert bench.bursts == [(gyr, 0xA7, 7), (xm, 0xA7, 7), (xm, 0x85, 9)]
    assert sum(length for *_, length in bench.bursts) <= lib.BUS_BURST_MAX
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.732e-3))


def test_set_up_waits_as_long_as_the_documents_want():
    bench = Bench()
    assert bench.set_up(100) == lib.SENSOR_OK
    g, xm = bench.g_at, bench.xm_at
    log = [(t, what, at, reg & 0x7F, length) for t, what, at, reg, length in bench.log]
    named = next(t for t, *what in log if what == ["read", g, 0x0F, 1])
    assert named >= 10_000  # after power
    boots = [
        t for t, *what in log if what in (["write", g, 0x24, 1], ["write", xm, 0x1F, 1])
    ]
    assert len(boots) == 2
    changes = [t for t, *what in log if what == ["write", g, 0x20, 5]]
    assert len(changes) == 4  # start, run without and with stimulus, samples
    assert changes[0] - boots[1] >= 10_000
    reads = [t for t, *what in log if what == ["read", g, 0x27, 7]][:-1]
    assert len(reads) == 64
    assert reads[0] - changes[0] >= 800_000  # the gyroscope's start
    for run, changed in zip((reads[:32], reads[32:]), changes[1:3], strict=True):
        assert run[0] - changed >= 60_000
        assert all(b - a > 1e6 / 760 for a, b in itertools.pairwise(run))


def test_powered_down_nothing_measures_until_the_next_set_up():
    bench = running()
    assert lib.lsm9ds0_power_down(bench.driver, bench.bus)
    assert bench.chip.next_event() == 2**64 - 1
    assert bench.set_up() == lib.SENSOR_OK
    bench.samples(10)


def test_a_chip_that_does_not_answer_is_not_powered_down():
    bench = Bench()
    bench.set_up()
    for pulled in (1, 2, 3):
        bench.pulled_at = bench.transactions + pulled
        assert not lib.lsm9ds0_power_down(bench.driver, bench.bus)


@pytest.mark.parametrize("who", [0x00, 0x49, 0x68, 0xD3, 0xD5, 0xD7, 0xFF])
def test_a_gyroscope_of_another_kind_is_refused_and_named(who):
    bench = Bench(who_am_i_g=who)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.log if what == "write"]


@pytest.mark.parametrize("who", [0x00, 0x41, 0x48, 0x4A, 0xD4, 0xFF])
def test_another_half_of_another_kind_is_refused_and_named(who):
    bench = Bench(who_am_i_xm=who)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.log if what == "write"]


@pytest.mark.parametrize("half", [G, XM])
def test_a_half_that_does_not_answer_is_a_failed_bus_until_it_does(half):
    bench = Bench()
    bench.chip.fault("NACK", die=half)
    assert bench.set_up() == lib.SENSOR_BUS_NACK
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]


def test_a_magnetometer_that_never_measures_leaves_six_axes_and_is_told():
    bench = Bench()
    bench.chip.fault("NO_MAG")
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0]
    assert bench.identity.self_test == BOTH_PASSED | lib.SELF_TEST_MAG_FAILED
    bench.chip.clear_faults()  # a loose joint: not to be trusted by halves
    samples = bench.samples(40)
    assert not any(sample.has_mag or sample.mag_overflow for sample in samples)
    assert axes(samples[-1].acc) == (0, 0, round(1 / 0.732e-3))
    assert lib.SENSOR_MAG_CHANGED in (bench.check(), bench.check())
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]
    assert bench.identity.self_test == BOTH_PASSED


@pytest.mark.parametrize("quantity", [lib.CHIP_GYR, lib.CHIP_ACC])
def test_a_sensor_that_never_gets_ready_is_stuck_in_bounded_time(quantity):
    bench = Bench()
    bench.chip.fault("NO_DATA_READY", value=1 + quantity)
    assert bench.set_up() == lib.SENSOR_STUCK
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK


@pytest.mark.parametrize("quantity", [lib.CHIP_GYR, lib.CHIP_ACC, lib.CHIP_MAG])
@pytest.mark.parametrize("from_ms", [0, 100, 400, 700])
def test_a_sensor_that_is_late_with_its_samples_is_waited_for(quantity, from_ms):
    bench = Bench()
    late = {"from_ns": from_ms * 1_000_000, "for_ns": 40_000_000}
    bench.chip.fault("NO_DATA_READY", value=1 + quantity, **late)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]
    assert bench.identity.self_test & ~lib.SELF_TEST_MAG_FAILED == BOTH_PASSED


def test_data_ready_is_low_where_set_up_ends_and_no_sample_is_missed():
    bench = running()
    assert not bench.chip.call("pin_is_high", 0)
    assert not bench.sample().has_gap


def test_a_magnetometer_that_stops_is_left_out_after_three_set_ups():
    bench = Bench()
    names, looks = [], []
    for _ in range(6):
        bench.chip.clear_faults()
        assert bench.set_up() == lib.SENSOR_OK
        names.append(bench.identity.who_am_i[1])
        if names[-1] != 0:
            bench.chip.fault("NO_MAG")
            bench.chip.get(bench.xm_at, 0x88, 6)  # nothing waits to be read
        looks.append(1)
        while bench.samples(8) and bench.check() == lib.SENSOR_OK:
            looks[-1] += 1
    assert names == [0x49, 0x49, 0x49, 0, 0x49, 0]
    # Every other look is at its half.
    assert [count // 2 for count in looks] == [6, 6, 6, 8, 6, 16]


@pytest.mark.parametrize("is_fast", [False, True])
def test_a_healthy_chip_passes_every_check(is_fast):
    bench = running(is_fast=is_fast)
    for _ in range(20):
        before_ns = bench.now_ns
        assert bench.check() == lib.SENSOR_OK
        assert bench.now_ns - before_ns < 350_000  # of 1.316 ms between two edges
        bench.samples(3)


@pytest.mark.parametrize(
    ("half", "reg"),
    [
        *((G, reg) for reg in range(0x20, 0x25)),
        *((XM, reg) for reg in range(0x1F, 0x27)),
    ],
)
def test_a_register_that_changes_by_itself_is_noticed_by_the_second_check(half, reg):
    bench = running()
    bench.flip(bench.chip, reg, bench.chip.peek(reg, half) ^ 0x41, half)
    assert lib.SENSOR_UNSET in (bench.check(), bench.check())
    assert bench.identity.wrong_register == reg
    assert bench.set_up() == lib.SENSOR_OK
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.732e-3))
