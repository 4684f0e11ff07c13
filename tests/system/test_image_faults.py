# SPDX-License-Identifier: MIT
"""The image as flashed, in its emulator, under faults: an event and a retry instead of
a hang, and nothing lost in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imud.virtual import motion
from system.test_image import CLICK, each
from system.virtual import (
    F405,
    NANO,
    Run,
    Stub,
    assert_nothing_is_lost,
    every_board,
    run,
    write_rest,
)

pytestmark = pytest.mark.sampled(4)


def poses_after(done: Run, time_us: int) -> int:
    return sum(pose.time_us > time_us for pose in done.named("pose"))


def samples_missing(stub: Stub, done: Run) -> int:
    """Of those between the first and the last raw message; each hole is flagged."""
    raws = done.named("raw")
    steps = np.diff([raw.time_us for raw in raws]) * 1e-6 * stub.board.rate_hz
    after_hole = np.flatnonzero(np.rint(steps) > 1) + 1
    flagged = [at for at, r in enumerate(raws) if "gap" in r.fields["sample_flags"]]
    assert flagged == after_hole.tolist()
    return int(np.sum(np.rint(steps) - 1))


def assert_it_came_back(done: Run) -> None:
    assert done.last_status["state"] == "streaming"
    assert done.summary["resets"] == 0
    assert not done.summary["crashed"]
    end_us = done.messages[-1].time_us
    assert poses_after(done, end_us - 500_000) >= 48


# All that a device acknowledges of a burst: its address, the register, its address.
@pytest.mark.parametrize(
    ("stub", "byte"), each(lambda board: board.acknowledged), indirect=["stub"]
)
def test_a_nack_at_any_byte_costs_its_sample_and_is_told(stub: Stub, byte: int) -> None:
    fault = {"kind": "nack", "transaction": stub.board.transaction, "byte": byte}
    done = run(stub, 4, *CLICK, *stub.raw_too, faults=[fault])
    assert done.events.count(("bus_fault", "nack")) == 1
    assert done.last_status["bus_faults"] == 1
    assert samples_missing(stub, done) == 1
    assert_it_came_back(done)


@pytest.mark.parametrize(
    ("fault", "causes"),
    [
        ({"kind": "nack"}, {"nack"}),
        ({"kind": "stuck_sda", "byte": 1, "clocks": 4}, {"timeout", "stuck_bus"}),
    ],
    ids=["nack", "stuck"],
)
@pytest.mark.parametrize(
    ("stub", "transaction"),
    each(lambda board: board.setup_transactions),
    indirect=["stub"],
)
def test_a_fault_in_set_up_is_told_by_its_cause_and_tried_again(
    stub: Stub, fault: dict[str, Any], causes: set[str], transaction: int
) -> None:
    done = run(stub, 5, *CLICK, faults=[fault | {"transaction": transaction}])
    told = [cause for event, cause in done.events if event == "bus_fault"]
    assert len(told) == 1
    assert set(told) <= causes
    assert_it_came_back(done)


@pytest.mark.parametrize(
    ("stub", "byte"),
    each(lambda board: range(1, board.transaction_bytes, 4)),
    indirect=["stub"],
)
def test_a_wire_stuck_at_any_byte_is_clocked_free(stub: Stub, byte: int) -> None:
    fault = {"kind": "stuck_sda", "byte": byte, "clocks": 5}
    fault |= {"transaction": stub.board.transaction}
    done = run(stub, 5, *CLICK, *stub.raw_too, faults=[fault])
    assert [event for event, _ in done.events].count("bus_fault") == 1
    assert 1 <= samples_missing(stub, done) <= 5
    assert_it_came_back(done)


@every_board
def test_a_wire_held_for_a_second_is_a_fault_until_it_is_let_go(stub: Stub) -> None:
    fault = {"kind": "stuck_sda", "at_us": 2_000_000, "for_us": 1_000_000}
    done = run(stub, 6, *CLICK, faults=[fault])
    assert ("bus_fault", "stuck_bus") in done.events
    states = [status.fields["state"] for status in done.named("status")]
    assert "fault" in states
    assert any(event == "bus_recovered" for event, _ in done.events)
    assert_it_came_back(done)


@every_board
def test_stopped_data_ready_is_told_and_the_sensor_set_up_again(stub: Stub) -> None:
    fault = {"kind": "no_data_ready", "at_us": 2_000_000, "for_us": 300_000}
    done = run(stub, 6, *CLICK, faults=[fault])
    assert ("sensor_fault", "no_data_ready") in done.events
    assert any(event == "bus_recovered" for event, _ in done.events)
    assert_it_came_back(done)


@every_board
def test_a_wrong_chip_is_refused_by_name(stub: Stub) -> None:
    who = 0xFF if stub.board.has_relatives else 0x12
    fault = {"kind": "wrong_who_am_i", "value": who}
    done = run(stub, 3, *CLICK, faults=[fault])
    refused = [m for m in done.named("event") if m.fields["cause"] == "wrong_chip"]
    assert refused
    assert refused[0].fields["detail"] == who
    assert done.last_status["state"] == "fault"
    assert not done.named("pose")


@pytest.mark.parametrize(
    ("stub", "registers"),
    each(lambda board: board.kept_registers),
    indirect=["stub"],
)
def test_a_register_that_changes_by_itself_is_told_and_set_again(
    stub: Stub, registers: dict[str, int]
) -> None:
    fault = {"kind": "register_flip", "at_us": 2_500_000, **registers}
    done = run(stub, 22, *CLICK, faults=[fault])
    told = [m.fields for m in done.named("event") if m.fields["cause"] == "registers"]
    assert [fields["event"] for fields in told] == ["sensor_fault"]
    assert told[0]["detail"] // 256 == registers["reg"]
    assert_it_came_back(done)


@every_board
def test_a_sensor_that_loses_its_power_alone_is_set_up_again(stub: Stub) -> None:
    fault = {"kind": "sensor_brown_out", "at_us": 2_500_000}
    done = run(stub, 6, *CLICK, faults=[fault])
    assert any(event == "sensor_fault" for event, _ in done.events)
    assert_it_came_back(done)


@every_board
def test_without_its_magnetometer_a_probe_has_six_axes_and_says_so(stub: Stub) -> None:
    rest = write_rest(stub.folder / "rest", 6)
    fault = {"kind": stub.board.no_mag}
    done = run(stub, 6, "--motion", rest, *CLICK, faults=[fault])
    pose = done.named("pose")[-1].fields
    assert "mag_absent" in pose["pose_flags"]
    assert "heading_free" in pose["pose_flags"]
    assert pose["heading_sigma"] is None
    assert pose["tilt_sigma"] is not None
    assert_nothing_is_lost(done)


@every_board
def test_a_brown_out_is_in_the_next_hello(stub: Stub) -> None:
    done = run(stub, 5, faults=[{"kind": "brown_out", "at_us": 2_000_000}])
    hellos = done.named("hello")
    assert hellos[-1].fields["reset_cause"] == (stub.board.brown_out,)
    assert hellos[-1].fields["boot_count"] == hellos[0].fields["boot_count"] + 1
    assert done.last_status["state"] in ("calibrating", "idle")


def test_start_up_calibration_refuses_motion(stub: Stub) -> None:
    turning = np.zeros((6000, 3))
    turning[:, 2] = np.deg2rad(15) * np.sin(np.arange(6000) * 0.01)
    still = motion.Motion(
        1000.0,
        gyr=turning,
        acc=np.tile([0.0, 0.0, 9.80665], (6000, 1)),
        mag=np.tile([0.0, 20.0, -40.0], (6000, 1)),
    )
    path = stub.folder / "turning"
    with path.open("wb") as file:
        motion.write_stream(file, [still], count=6000)
    done = run(stub, 5, "--motion", path, *CLICK)
    assert ("calibration_refused", "motion") in done.events
    assert ("calibration_done", "none") not in done.events
    assert "uncalibrated" in done.named("pose")[-1].fields["pose_flags"]


@pytest.mark.parametrize("stub", [NANO.name], indirect=True)
def test_a_hundred_faults_one_after_the_other_are_all_told(stub: Stub) -> None:
    # The chip holds 32 at a time; each of these meets one sample of 5 ms or two.
    faults = [
        {"kind": "nack", "at_us": 2_000_000 + 50_000 * number, "for_us": 6000}
        for number in range(100)
    ]
    done = run(stub, 8, *CLICK, *stub.raw_too, faults=faults)
    told = done.events.count(("bus_fault", "nack"))
    assert 100 <= told <= 200
    assert told == done.last_status["bus_faults"] == samples_missing(stub, done)
    assert_it_came_back(done)


@every_board
def test_more_faults_at_a_time_than_a_chip_holds_are_refused(stub: Stub) -> None:
    faults = [{"kind": "frozen", "at_us": 1_000_000}] * 33
    run(stub, 2, faults=faults, code=2)
    faults = [{"kind": "power_cut", "at_us": 1}] * 4097
    with pytest.raises(AssertionError, match="more than 4096 faults"):
        run(stub, 2, faults=faults)
    if stub.board is F405:
        faults = [{"kind": "radio_drop", "at_us": 1}] * 33
        with pytest.raises(AssertionError, match="more than 32 faults of the radio"):
            run(stub, 2, faults=faults)
