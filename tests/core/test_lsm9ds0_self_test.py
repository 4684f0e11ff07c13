# SPDX-License-Identifier: MIT
"""The verdicts of the LSM9DS0's self-test."""

from __future__ import annotations

import itertools

import pytest

from core.lsm9ds0_desk import (
    ACC_FAILED,
    ACC_PASSED,
    BOTH_PASSED,
    GYR_FAILED,
    GYR_PASSED,
    Bench,
)
from core.sensor_desk import STEP_US, Triple, lib

NOTHING = (0.0, 0.0, 0.0)


def verdict_of(
    dps: Triple = NOTHING, g: Triple = (0.0, 0.0, 1.0), **config: Triple
) -> int:
    bench = Bench(**config)
    bench.hold(dps, g)
    assert bench.set_up() == lib.SENSOR_OK
    return int(bench.identity.self_test)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("dps", "passes"), [(150.1, True), (149.9, False), (999.9, True), (1000.1, False)]
)
def test_the_gyroscope_is_judged_by_its_data_sheet(axis, sign, dps, passes):
    response = [400.0, -400.0, -400.0]
    response[axis] = sign * dps
    verdict = verdict_of(gyr_self_test_dps=response)
    assert verdict == ACC_PASSED | (GYR_PASSED if passes else GYR_FAILED)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("mg", "passes"), [(60.1, True), (59.9, False), (1699.9, True), (1700.1, False)]
)
def test_the_accelerometer_is_judged_by_its_data_sheet(axis, mg, passes):
    response = [300.0, 300.0, 300.0]
    response[axis] = mg
    verdict = verdict_of(g=NOTHING, acc_self_test_mg=response)
    assert verdict == GYR_PASSED | (ACC_PASSED if passes else ACC_FAILED)


def test_the_largest_readings_do_not_overflow_the_self_test():
    # From one end of the registers to the other: no response that could pass.
    verdict = verdict_of(dps=(-3000.0,) * 3, gyr_self_test_dps=(6000.0,) * 3)
    assert verdict == ACC_PASSED | GYR_FAILED
    verdict = verdict_of(g=(-9.0,) * 3, acc_self_test_mg=(18_000.0,) * 3)
    assert verdict == ACC_FAILED | GYR_PASSED


@pytest.mark.parametrize(
    ("strays_dps", "moves"), [(3.9, False), (4.1, True), (-900, True)]
)
def test_a_self_test_that_motion_spoils_is_no_verdict(strays_dps, moves):
    bench = Bench(gyr_self_test_dps=NOTHING, acc_self_test_mg=NOTHING)
    lib.lsm9ds0_begin(bench.driver)
    turns = itertools.count()
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.hold(dps=(0, strays_dps * (next(turns) % 2), 0))
        bench.let_pass(STEP_US)
    assert result == lib.SENSOR_OK
    assert bench.identity.self_test == (0 if moves else ACC_FAILED | GYR_FAILED)


def test_a_verdict_is_kept_and_a_missing_one_is_sought_by_the_next_set_up():
    bench = Bench()
    bench.chip.fault("GYR_SELF_TEST")
    assert bench.set_up() == lib.SENSOR_OK
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ACC_PASSED | GYR_FAILED
    bench.driver.identity.self_test = 0  # as after motion
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == BOTH_PASSED
