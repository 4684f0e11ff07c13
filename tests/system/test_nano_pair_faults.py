# SPDX-License-Identifier: MIT
"""The Nano's image for an LSM6DSOX and a LIS3MDL under the faults that its image for an
MPU-9250 is tried with, too."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

import images
from benchmarks.common.images import build
from imud.virtual.boards import NANO as VIRTUAL
from native import locked
from system import test_image_faults as both
from system.test_image import CLICK
from system.virtual import NANO, Stub, run

pytestmark = pytest.mark.long

PAIR = VIRTUAL.with_sensor("lsm6dsox")
BOARD = dataclasses.replace(
    NANO, rate_hz=PAIR.sample_rate_hz, options=("--sensor", PAIR.sensor)
)
INERTIAL, MAGNETIC = 1, 2  # dies


@pytest.fixture(scope="module")
def image() -> Path:
    with locked(images.SIM / ".pair.lock"):
        return build(PAIR.image.parent.name)


@pytest.fixture
def pair(image: Path, tmp_path: Path) -> Stub:
    simulator = images.emulators() / VIRTUAL.simulator.name
    return Stub(BOARD, simulator, image, tmp_path)


# An address, a register, an address: of a burst of either chip.
@pytest.mark.parametrize("transaction", [500, 501, 502])
@pytest.mark.parametrize("byte", [0, 1, 2])
def test_a_nack_at_any_byte_costs_its_sample(
    pair: Stub, byte: int, transaction: int
) -> None:
    fault = {"kind": "nack", "transaction": transaction, "byte": byte}
    done = run(pair, 5, *CLICK, *pair.raw_too, faults=[fault])
    assert done.events.count(("bus_fault", "nack")) == 1
    assert both.samples_missing(pair, done) == 1
    both.assert_it_came_back(done)


@pytest.mark.parametrize("transaction", [2, 5, 9, 14, 19])
def test_a_fault_in_set_up_is_told_and_tried_again(
    pair: Stub, transaction: int
) -> None:
    for fault in ({"kind": "nack"}, {"kind": "stuck_sda", "byte": 1, "clocks": 4}):
        done = run(pair, 6, *CLICK, faults=[fault | {"transaction": transaction}])
        assert [event for event, _ in done.events].count("bus_fault") == 1
        both.assert_it_came_back(done)


@pytest.mark.parametrize("byte", range(1, 17, 3))
def test_a_wire_stuck_at_any_byte_is_clocked_free(pair: Stub, byte: int) -> None:
    both.test_a_wire_stuck_at_any_byte_is_clocked_free(pair, byte)


@pytest.mark.parametrize(
    "check",
    [
        both.test_a_wire_held_for_a_second_is_a_fault_until_it_is_let_go,
        both.test_stopped_data_ready_is_told_and_the_sensor_set_up_again,
        both.test_a_wrong_chip_is_refused_by_name,
        both.test_a_sensor_that_loses_its_power_alone_is_set_up_again,
        both.test_without_its_magnetometer_a_probe_has_six_axes_and_says_so,
        both.test_a_brown_out_is_in_the_next_hello,
    ],
    ids=lambda check: check.__name__,
)
def test_what_its_other_image_withstands(pair: Stub, check: Any) -> None:
    board = dataclasses.replace(BOARD, no_mag="no_mag")
    check(dataclasses.replace(pair, board=board))


@pytest.mark.parametrize(
    "registers",
    [
        {"die": INERTIAL, "reg": 0x10, "value": 0},
        {"die": MAGNETIC, "reg": 0x21, "value": 0x20},
    ],
    ids=str,
)
def test_a_register_that_changes_by_itself_is_told_and_set_again(
    pair: Stub, registers: dict[str, int]
) -> None:
    both.test_a_register_that_changes_by_itself_is_told_and_set_again(pair, registers)


def test_a_magnetometer_that_dies_leaves_six_axes(pair: Stub) -> None:
    fault = {"kind": "no_mag", "at_us": 4_000_000}
    done = run(pair, 12, *CLICK, *pair.raw_too, faults=[fault])
    assert any(event in ("bus_fault", "sensor_fault") for event, _ in done.events)
    assert "mag_absent" in done.named("pose")[-1].fields["pose_flags"]
    both.assert_it_came_back(done)
