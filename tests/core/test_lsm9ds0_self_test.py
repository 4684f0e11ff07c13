# SPDX-License-Identifier: MIT
"""The verdicts of the LSM9DS0's self-test."""

from __future__ import annotations

import itertools

import pytest

from core.lsm9ds0_chip import (
    ACC_FAILED,
    ACC_PASSED,
    BOTH_PASSED,
    GYR_FAILED,
    GYR_PASSED,
    Triple,
    lib,
)
from core.lsm9ds0_desk import Bench
from core.sensor_desk import STEP_US


def verdict_of(**world: Triple) -> int:
    bench = Bench()
    for name, value in world.items():
        setattr(bench.chip, name, value)
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
    verdict = verdict_of(gyr_response=tuple(response))
    assert verdict == ACC_PASSED | (GYR_PASSED if passes else GYR_FAILED)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("mg", "passes"), [(60.1, True), (59.9, False), (1699.9, True), (1700.1, False)]
)
def test_the_accelerometer_is_judged_by_its_data_sheet(axis, mg, passes):
    response = [0.3, 0.3, 0.3]
    response[axis] = mg * 1e-3
    verdict = verdict_of(acc_response=tuple(response), acc_g=(0, 0, 0))
    assert verdict == GYR_PASSED | (ACC_PASSED if passes else ACC_FAILED)


def test_the_largest_readings_do_not_overflow_the_self_test():
    # From one end of the registers to the other: no response that could pass.
    rest, response = (-3000.0,) * 3, (6000.0,) * 3
    world = {"gyr_dps": rest, "gyr_response": response}
    assert verdict_of(**world) == ACC_PASSED | GYR_FAILED
    world = {"acc_g": (-9.0,) * 3, "acc_response": (18.0,) * 3}
    assert verdict_of(**world) == ACC_FAILED | GYR_PASSED


@pytest.mark.parametrize(
    ("strays_dps", "moves"), [(3.9, False), (4.1, True), (-900, True)]
)
def test_a_self_test_that_motion_spoils_is_no_verdict(strays_dps, moves):
    bench = Bench()
    bench.chip.gyr_response = bench.chip.acc_response = (0, 0, 0)
    lib.lsm9ds0_begin(bench.driver)
    turns = itertools.count()
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.chip.gyr_dps = (0, strays_dps * (next(turns) % 2), 0)
        bench.chip.now_us += STEP_US
    assert result == lib.SENSOR_OK
    assert bench.identity.self_test == (0 if moves else ACC_FAILED | GYR_FAILED)


def test_a_verdict_is_kept_and_a_missing_one_is_sought_by_the_next_set_up():
    bench = Bench()
    bench.chip.gyr_response = (0, 0, 0)
    assert bench.set_up() == lib.SENSOR_OK
    bench.chip.gyr_response = (400, -400, -400)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ACC_PASSED | GYR_FAILED
    bench.driver.identity.self_test = 0  # as after motion
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == BOTH_PASSED
