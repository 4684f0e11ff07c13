# SPDX-License-Identifier: MIT
"""The verdicts of the MPU-9250's self-test."""

from __future__ import annotations

import math
from typing import Any

import pytest

from core.mpu9250_desk import (
    ACC_PASSED,
    ALL_PASSED,
    DEGREE,
    GYR_PASSED,
    MAG_PASSED,
    Bench,
    G,
    lib,
    scripted,
)
from core.sensor_desk import STEP_US


def test_a_weak_gyroscope_fails_its_self_test():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ACC_PASSED | lib.SELF_TEST_GYR_FAILED | (
        MAG_PASSED
    )


def test_a_weak_accelerometer_fails_its_self_test():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == lib.SELF_TEST_ACC_FAILED | GYR_PASSED | (
        MAG_PASSED
    )


@pytest.mark.parametrize(("rate_dps", "passes"), [(19.9, True), (-20.1, False)])
def test_a_gyroscope_that_rests_beyond_20_deg_s_fails(rate_dps, passes):
    bench = Bench()
    bench.hold(gyr=(0, 0, rate_dps * DEGREE))
    assert bench.set_up() == lib.SENSOR_OK
    verdict = bench.identity.self_test & (GYR_PASSED | lib.SELF_TEST_GYR_FAILED)
    assert verdict == (GYR_PASSED if passes else lib.SELF_TEST_GYR_FAILED)


def set_up_in_motion(bench: Bench) -> int:
    """Set up in a hand that turns by 60 deg/s and shakes by 3 m/s2."""
    lib.mpu9250_begin(bench.driver)
    while (result := bench.step()) == lib.SENSOR_BUSY:
        angle = bench.now_ns * 1e-9 * 2 * math.pi * 1.5
        rate = 60 * DEGREE * math.sin(angle)
        bench.hold(gyr=(rate, -rate / 2, 0), acc=(3 * math.cos(angle), 0, G))
        bench.now_ns += STEP_US * 1000
        lib.mpu9250_chip_advance(bench.chip, bench.now_ns)
    return int(result)


def test_a_self_test_that_motion_spoils_is_no_verdict():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert set_up_in_motion(bench) == lib.SENSOR_OK
    assert bench.identity.self_test == MAG_PASSED


def test_a_self_test_without_verdict_is_run_again_by_the_next_set_up():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert set_up_in_motion(bench) == lib.SENSOR_OK
    lib.i2c_slave_clear_faults(lib.mpu9250_chip_wire(bench.chip))
    bench.hold()
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED


def verdict_of(**settings: Any) -> int:
    bench = scripted(**settings)
    assert bench.set_up() == lib.SENSOR_OK
    return int(bench.identity.self_test)


def factory_response(code: int) -> float:
    return 2620 * 1.01 ** (code - 1)


@pytest.mark.parametrize("code", [1, 2, 3, 64, 127, 128, 129, 200, 235])
def test_self_test_limits_follow_the_factory_code(code):
    trim = factory_response(code)

    def verdict(acc: float, gyr: float) -> int:
        # The last axis is near its limit, the others in the middle.
        response = [round(value) for value in (trim, trim, acc, trim, trim, gyr)]
        return verdict_of(response=response, codes=[code] * 6) & ~MAG_PASSED

    # The driver's trim is rounded: its limits may be a count off.
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict(trim / 2 + 1, trim / 2 + 1) == ACC_PASSED | GYR_PASSED
    assert verdict(trim / 2 - 1, trim / 2 - 1) == failed
    assert verdict(-trim, -trim) == failed
    if trim * 1.5 < 32766:
        assert verdict(trim * 1.5 - 1, 32767) == ACC_PASSED | GYR_PASSED
        assert verdict(trim * 1.5 + 1, 32767) == lib.SELF_TEST_ACC_FAILED | GYR_PASSED


@pytest.mark.parametrize("sign", [-1, 1])
def test_without_factory_codes_fixed_limits_hold(sign):
    # 225 to 675 mg at 16384 a g, 60 deg/s at 131 a deg/s; 200 counts are summed.
    def verdict(acc: int, gyr: int) -> int:
        response = [sign * acc] * 3 + [sign * gyr] * 3
        return verdict_of(response=response, codes=[0] * 6) & ~MAG_PASSED

    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict(3687, 7860) == ACC_PASSED | GYR_PASSED
    assert verdict(11059, 32767) == ACC_PASSED | GYR_PASSED
    assert verdict(3685, 7859) == failed
    assert verdict(11060, 7859) == failed


def test_the_largest_readings_do_not_overflow_the_self_test():
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    for rest, response in ((32767, -65535), (-32768, 65535)):
        verdict = verdict_of(rest=[rest] * 6, response=[response] * 6, codes=[255] * 6)
        assert verdict & ~MAG_PASSED & ~ACC_PASSED in (
            failed,
            lib.SELF_TEST_GYR_FAILED,
        )


@pytest.mark.parametrize(
    ("noise", "moves"), [(327, False), (328, True), (-30000, True)]
)
def test_motion_is_a_rate_that_strays_by_two_and_a_half_deg_s(noise, moves):
    verdict = verdict_of(codes=[100] * 6, noise=noise)  # no response: fails
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict & ~MAG_PASSED == (0 if moves else failed)


@pytest.mark.parametrize(
    ("field", "passes"),
    [
        ((0, 0, -2000), True),
        ((200, -200, -800), True),
        ((-200, 200, -3200), True),
        ((201, 0, -2000), False),
        ((0, -201, -2000), False),
        ((0, 0, -799), False),
        ((0, 0, -3201), False),
        ((0, 0, 2000), False),
        (None, False),  # no data-ready ever
    ],
)
def test_the_magnetometer_is_judged_by_its_data_sheet(field, passes):
    mag = MAG_PASSED if passes else lib.SELF_TEST_MAG_FAILED
    inertial = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict_of(mag_test=field, codes=[100] * 6) == mag | inertial


def test_a_magnetometer_that_fails_is_still_read():
    bench = scripted(mag_test=None)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0x48
    assert bench.burst.length == 22


@pytest.mark.parametrize("mag_id", [0x00, 0x47, 0x49, 0xFF])
def test_another_chip_at_the_magnetometers_address_is_not_used(mag_id):
    bench = scripted(mag_id=mag_id)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0
    assert bench.burst.length == 14


@pytest.mark.parametrize(("refusals", "is_found"), [(1, True), (49, True), (50, False)])
def test_a_magnetometer_may_refuse_for_a_while(refusals, is_found):
    bench = scripted(refusals=refusals)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == (0x48 if is_found else 0)
