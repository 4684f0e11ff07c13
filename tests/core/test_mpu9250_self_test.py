# SPDX-License-Identifier: MIT
"""What the MPU-9250's driver keeps of the self-test for a host to judge, and the force
that it wants to see."""

from __future__ import annotations

import math
from typing import Any

import pytest

from core.mpu9250_desk import (
    AT_REST,
    DEGREE,
    HOST_JUDGES,
    Bench,
    G,
    lib,
    running,
    scripted,
)
from core.sensor_desk import STEP_US

FACTORY = (98, 105, 120, 200, 206, 194)  # the model's codes


def response_of(code: int) -> float:
    """Counts that the factory measured, AN-MPU-9250A-03 3.2."""
    return 2620 * 1.01 ** (code - 1)


def answers(bench: Bench) -> dict[str, tuple[int, ...]]:
    fields = bench.identity.answers
    return {
        name: tuple(getattr(fields, name))
        for name in ("before", "stimulated", "after", "factory", "mag_response")
    }


def set_up(bench: Bench) -> dict[str, tuple[int, ...]]:
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == HOST_JUDGES
    return answers(bench)


def test_the_answers_to_the_stimulus_are_kept_for_a_host():
    readings = set_up(Bench())
    assert readings["before"] == readings["after"] == AT_REST
    assert readings["factory"] == FACTORY
    for rest, value, code in zip(AT_REST, readings["stimulated"], FACTORY, strict=True):
        assert value - rest == pytest.approx(response_of(code), abs=1)


@pytest.mark.parametrize(("kind", "weak"), [("ACC", range(3)), ("GYR", range(3, 6))])
def test_a_weak_response_is_told_as_it_is(kind, weak):
    bench = Bench()
    bench.chip.fault(f"{kind}_SELF_TEST")
    readings = set_up(bench)
    for axis, (rest, value) in enumerate(
        zip(AT_REST, readings["stimulated"], strict=True)
    ):
        share = 0.1 if axis in weak else 1
        assert value - rest == pytest.approx(share * response_of(FACTORY[axis]), abs=1)


def test_the_magnetometer_answers_in_its_own_axes_as_read():
    # The model's coil: 40, -60 and -1900 counts after adjustment.
    adjusts = [1 + (asa - 128) / 256 for asa in (176, 178, 166)]
    wanted = [v / a for v, a in zip((40, -60, -1900), adjusts, strict=True)]
    assert set_up(Bench())["mag_response"] == pytest.approx(wanted, abs=0.51)


@pytest.mark.parametrize("field", [(0, 0, -2000), (-32768, 32767, 1), None])
def test_the_response_of_the_magnetometer_is_not_judged_here(field):
    readings = set_up(scripted(mag_test=field))
    assert readings["mag_response"] == (field or (0, 0, 0))  # None: it never measures


def test_readings_at_the_ends_of_their_range_are_kept():
    rest = [0, 0, 16384, 32767, -32768, 0]
    readings = set_up(scripted(rest=rest, response=[0, 0, 0, -65535, 65535, 1]))
    assert readings["before"] == readings["after"] == tuple(rest)
    assert readings["stimulated"] == (0, 0, 16384, -32768, 32767, 1)


def turning(bench: Bench) -> int:
    """Set up in a hand that turns by 60 deg/s and shakes by 3 m/s2."""
    bench.call("begin")
    while (result := bench.step()) == lib.SENSOR_BUSY:
        angle = bench.now_ns * 1e-9 * 2 * math.pi * 1.5
        rate = 60 * DEGREE * math.sin(angle)
        bench.chip.hold(gyr=(rate, -rate / 2, 0), acc=(3 * math.cos(angle), 0, G))
        bench.let_pass(STEP_US)
    return result


def test_motion_is_seen_in_the_rates_without_the_stimulus():
    bench = Bench()
    assert turning(bench) == lib.SENSOR_OK
    readings = answers(bench)
    rates = [value / 131 for value in readings["before"][3:] + readings["after"][3:]]
    assert max(map(abs, rates)) > 5


def test_the_inertial_answers_are_kept_over_another_set_up():
    bench = running()
    first = answers(bench)
    bench.chip.fault("GYR_SELF_TEST")
    bench.chip.fault("ACC_SELF_TEST")
    assert set_up(bench) == first


def test_a_self_test_that_was_cut_short_is_run_again():
    bench = Bench()
    bench.pulled_at = 20
    assert bench.set_up() == lib.SENSOR_BUS_NACK
    assert bench.identity.self_test == 0
    assert set_up(bench)["stimulated"] != (0,) * 6


def rest_of(*acc: int) -> list[int]:
    return [*acc, 0, 0, 0]


@pytest.mark.parametrize(
    "acc",
    [
        (0, 0, 12288),
        (0, -12288, 0),
        (20480, 0, 0),
        (-9460, 9460, 9460),
        (0, 11585, -11585),
    ],
)
def test_a_force_from_three_to_five_quarters_of_g_is_gravity(acc):
    assert scripted(rest=rest_of(*acc)).set_up() == lib.SENSOR_OK


@pytest.mark.parametrize(
    "acc",
    [(0, 0, 0), (0, 0, 12287), (0, 20482, 0), (32767, 32767, 32767), (-32768,) * 3],
)
def test_a_chip_that_never_measures_gravity_is_refused(acc):
    bench = scripted(rest=rest_of(*acc))
    assert bench.set_up() == lib.SENSOR_NO_FORCE
    assert bench.identity.who_am_i[0] == 0x71
    assert bench.now_ns / 1e9 == pytest.approx(1.5, abs=0.2)  # and that in bounded time


def test_a_probe_that_falls_at_its_start_is_set_up_once_it_lies():
    chip: dict[str, Any] = {"rest": rest_of(0, 0, 0)}
    bench = scripted(**chip)
    assert bench.set_up() == lib.SENSOR_NO_FORCE
    bench = running()
    bench.chip.hold(acc=(0, 0, 0.2 * G))
    assert bench.set_up() == lib.SENSOR_OK  # its force was seen at the first set-up


def test_a_shaken_probe_passes_gravity_and_is_set_up():
    bench = Bench()
    bench.call("begin")
    while (result := bench.step()) == lib.SENSOR_BUSY:
        swing = math.sin(bench.now_ns * 1e-9 * 2 * math.pi * 3)
        bench.chip.hold(acc=(0, 0, G * (1 + 0.9 * swing)))
        bench.let_pass(STEP_US)
    assert result == lib.SENSOR_OK
