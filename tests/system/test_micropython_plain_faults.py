# SPDX-License-Identifier: MIT
"""Faults of sensor, bus and supply on the virtual pyboard without use of the module."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from system.test_image_faults import CLICK, samples_missing
from system.virtual import MICROPYTHON, Run, Stub, run

pytestmark = pytest.mark.long


@pytest.fixture
def stub(f405: Path, plain_image: Path, tmp_path: Path) -> Stub:
    return Stub(MICROPYTHON, f405, plain_image, tmp_path)


def assert_it_came_back(done: Run) -> None:
    assert done.last_status["state"] == "streaming"
    assert done.summary["resets"] == 0
    assert not done.summary["crashed"]
    end_us = done.messages[-1].time_us
    assert sum(raw.time_us > end_us - 500_000 for raw in done.named("raw")) >= 185


def causes(done: Run, event: str) -> list[Any]:
    return [cause for name, cause in done.events if name == event]


# A sample is read in three transactions; of each a device acknowledges its address, the
# register, and its address again.
@pytest.mark.parametrize("later", range(3))
@pytest.mark.parametrize("byte", range(3))
def test_a_nack_at_any_byte_costs_its_sample_and_is_told(
    stub: Stub, later: int, byte: int
) -> None:
    transaction = MICROPYTHON.transaction + later
    fault = {"kind": "nack", "transaction": transaction, "byte": byte}
    done = run(stub, 3, *CLICK, faults=[fault])
    assert causes(done, "bus_fault") == ["nack"]
    assert samples_missing(stub, done) == 1
    assert_it_came_back(done)


@pytest.mark.parametrize("byte", [1, 9])
def test_a_wire_stuck_at_a_byte_is_clocked_free(stub: Stub, byte: int) -> None:
    fault = {"kind": "stuck_sda", "byte": byte, "clocks": 5}
    done = run(
        stub, 3, *CLICK, faults=[fault | {"transaction": MICROPYTHON.transaction}]
    )
    assert len(causes(done, "bus_fault")) == 1
    assert 1 <= samples_missing(stub, done) <= 5
    assert_it_came_back(done)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (
            {"kind": "stuck_sda", "at_us": 2_000_000, "for_us": 1_000_000},
            ("bus_fault", "stuck_bus"),
        ),
        (
            {"kind": "no_data_ready", "at_us": 2_000_000, "for_us": 300_000},
            ("sensor_fault", "no_data_ready"),
        ),
    ],
    ids=["stuck", "silent"],
)
def test_a_sensor_that_is_gone_for_a_while_is_set_up_again(
    stub: Stub, fault: dict[str, Any], told: tuple[str, str]
) -> None:
    done = run(stub, 6, *CLICK, faults=[fault])
    assert told in done.events
    assert "fault" in [status.fields["state"] for status in done.named("status")]
    assert causes(done, "bus_recovered")
    assert_it_came_back(done)


def test_a_wrong_chip_is_refused_by_name(stub: Stub) -> None:
    done = run(stub, 3, *CLICK, faults=[{"kind": "wrong_who_am_i", "value": 0x12}])
    refused = [m for m in done.named("event") if m.fields["cause"] == "wrong_chip"]
    assert refused[0].fields["detail"] == 0x12
    assert done.last_status["state"] == "fault"
    assert not done.named("raw")


def test_without_its_magnetometer_it_sends_six_axes(stub: Stub) -> None:
    done = run(stub, 9, *CLICK, faults=[{"kind": MICROPYTHON.no_mag}])
    assert causes(done, "sensor_fault") == ["mag_silent"] * 3
    assert done.named("hello")[-1].fields["who_am_i"] == (0xD4, 0)
    assert all(raw.fields["mag"] is None for raw in done.named("raw"))
    assert_it_came_back(done)


def test_a_brown_out_is_in_the_next_hello(stub: Stub) -> None:
    done = run(stub, 4, faults=[{"kind": "brown_out", "at_us": 2_000_000}])
    first, last = (done.named("hello")[at].fields for at in (0, -1))
    assert last["reset_cause"] == ("brown_out",)
    assert last["boot_count"] == first["boot_count"] + 1
