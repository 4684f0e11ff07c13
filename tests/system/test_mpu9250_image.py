# SPDX-License-Identifier: MIT
"""The Nano's image with an MPU-9250 as it may be sold: of another identity, without a
magnetometer, or with one that hangs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from system.test_image import CLICK
from system.test_image_faults import assert_it_came_back
from system.virtual import Stub, run, write_rest

pytestmark = pytest.mark.sampled(3)
nano = pytest.mark.parametrize("stub", ["nano"], indirect=True)


@nano
@pytest.mark.parametrize("who", [0x01, 0x12, 0x68, 0x70, 0x73, 0x74, 0x75, 0x78, 0xFE])
def test_a_relative_of_the_sensor_runs_under_its_own_name(stub: Stub, who: int) -> None:
    fault = {"kind": "wrong_who_am_i", "value": who}
    done = run(stub, 3, *CLICK, faults=[fault])
    hello = done.named("hello")[-1].fields
    assert hello["sensor"] == "mpu9250"
    assert hello["who_am_i"] == (who, 0x48)
    assert_it_came_back(done)


def hello_after(
    stub: Stub, seconds: float, *faults: dict[str, Any]
) -> Mapping[str, Any]:
    done = run(stub, seconds, *CLICK, faults=faults)
    assert_it_came_back(done)
    return done.named("hello")[-1].fields


PHASES = 30


@nano
@pytest.mark.parametrize("part", range(3))
def test_a_reset_while_the_chip_reads_its_magnetometer_loses_nothing(
    stub: Stub, part: int
) -> None:
    # The read takes 0.25 of the 5 ms between two samples; firmware that resets the
    # chip at once has no magnetometer, and no poses, after 18 of 30 such resets.
    for phase in range(part, PHASES, 3):
        at_us = 3_000_000 + 5000 * phase // PHASES + 7 * phase
        done = run(stub, 5, faults=[{"kind": "reset", "at_us": at_us}])
        hello = done.named("hello")[-1].fields
        assert hello["boot_count"] == 2
        assert (hello["sensor"], hello["who_am_i"]) == ("mpu9250", (0x71, 0x48))


@nano
@pytest.mark.parametrize("clocks", [1, 5, 9])
def test_a_magnetometer_that_holds_its_bus_is_clocked_free(
    stub: Stub, clocks: int
) -> None:
    fault = {"kind": "mag_hung", "at_us": 2_500_000, "clocks": clocks}
    rest = write_rest(stub.folder / "rest", 7)
    done = run(stub, 7, "--motion", rest, *CLICK, faults=[fault])
    assert ("sensor_fault", "mag_stuck") in done.events
    assert done.named("hello")[-1].fields["sensor"] == "mpu9250"
    assert "mag_absent" not in done.named("pose")[-1].fields["pose_flags"]
    assert_it_came_back(done)


@nano
def test_a_magnetometer_that_never_lets_go_leaves_six_axes(stub: Stub) -> None:
    hello = hello_after(stub, 5, {"kind": "mag_hung"})
    assert (hello["sensor"], hello["who_am_i"]) == ("mpu6500", (0x71, 0x00))


@nano
def test_a_magnetometer_that_comes_late_is_found(stub: Stub) -> None:
    fault = {"kind": "no_ak8963", "for_us": 3_000_000}
    done = run(stub, 22, *CLICK, faults=[fault])
    sensors = [hello.fields["sensor"] for hello in done.named("hello")]
    assert "mpu6500" in sensors
    assert sensors[-1] == "mpu9250"
    assert ("sensor_fault", "mag_silent") in done.events
    assert_it_came_back(done)


@nano
@pytest.mark.parametrize("part", ["gyr", "acc"])
def test_a_failing_self_test_is_sent_to_be_judged(stub: Stub, part: str) -> None:
    done = run(stub, 3, faults=[{"kind": f"{part}_self_test"}])
    assert done.named("hello")[-1].fields["self_test"] == ("host_judges",)
    answers = done.named("self_test")[-1].fields
    for axis in range(6):
        response = answers["stimulated"][axis] - answers["before"][axis]
        share = response / (2620 * 1.01 ** (answers["factory"][axis] - 1))
        is_weak = (axis < 3) == (part == "acc")
        assert share == pytest.approx(0.1 if is_weak else 1, abs=0.01)
