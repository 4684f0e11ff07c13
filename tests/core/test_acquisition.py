# SPDX-License-Identifier: MIT
"""The way from a sensor to samples: bursts that fail, a sensor that is absent or silent
or leaves a sample out, a bus that is held, edges that were missed.
"""

from __future__ import annotations

import pytest

from core.acquisition_desk import BAD, SILENCE_US, Board
from core.desk import lib


def test_a_sensor_is_set_up_step_by_step_then_sampled() -> None:
    board = Board()
    board.setup_results = [lib.SENSOR_BUSY] * 3 + [lib.SENSOR_OK]
    assert board.calls == ["begin"]
    for _ in range(3):
        assert not board.step()
        assert board.c.phase == lib.ACQUISITION_SETUP
    assert not board.step()
    assert board.calls == ["begin", "start"]
    assert board.c.phase == lib.ACQUISITION_SAMPLING
    assert board.bench.messages[-1].fields["sensor"] == lib.SENSOR_MPU9250
    assert board.take(lib.READING_OK)
    assert not board.step()
    assert (board.samples, board.gaps) == (1, [False])


@pytest.mark.parametrize(
    ("result", "cause"),
    [
        ("BUS_NACK", "CAUSE_NACK"),
        ("BUS_TIMEOUT", "CAUSE_TIMEOUT"),
        ("BUS_STUCK", "CAUSE_STUCK_BUS"),
    ],
)
def test_a_bus_that_fails_in_set_up_is_told_by_its_result(
    result: str, cause: str
) -> None:
    board = Board()
    board.setup_results = [getattr(lib, f"SENSOR_{result}")]
    board.step()
    board.gives_up_for(lib.EVENT_BUS_FAULT, getattr(lib, cause))


@pytest.mark.parametrize(
    ("result", "cause", "detail"),
    [
        ("WRONG_CHIP", "CAUSE_WRONG_CHIP", 0x71),
        ("STUCK", "CAUSE_TIMEOUT", 0x71),
        ("UNSET", "CAUSE_REGISTERS", 0x1C71),
        ("NO_FORCE", "CAUSE_FORCE", 0x71),
        ("MAG_STUCK", "CAUSE_MAG_STUCK", 0x71),
    ],
)
def test_a_sensor_that_is_absent_or_never_ready_is_tried_again(
    result: str, cause: str, detail: int
) -> None:
    board = Board()
    board.identity.wrong_register = detail // 256
    board.setup_results = [getattr(lib, f"SENSOR_{result}")]
    board.step()
    board.gives_up_for(lib.EVENT_SENSOR_FAULT, getattr(lib, cause), detail)


def test_a_bus_that_stays_held_is_the_cause_whatever_came_first() -> None:
    board = Board()
    board.setup_results = [lib.SENSOR_WRONG_CHIP]
    board.recovered = lib.BUS_STUCK
    board.step()
    board.gives_up_for(lib.EVENT_SENSOR_FAULT, lib.CAUSE_STUCK_BUS, 0x71)


@pytest.mark.parametrize(
    ("result", "cause"),
    [
        ("READING_NACK", "CAUSE_NACK"),
        ("READING_TIMEOUT", "CAUSE_TIMEOUT"),
        ("READING_STUCK", "CAUSE_STUCK_BUS"),
    ],
)
def test_a_burst_that_fails_costs_one_sample(result: str, cause: str) -> None:
    board = Board().sampling()
    assert board.take(lib.READING_OK)
    assert not board.take(getattr(lib, result))
    assert board.calls == ["stop", "recover", "start"]
    assert board.bench.events() == [(lib.EVENT_BUS_FAULT, getattr(lib, cause), 1)]
    assert not board.is_faulty
    assert board.take(lib.READING_OK)
    assert board.take(lib.READING_OK)
    assert (board.samples, board.gaps) == (3, [False, True, False])


def test_bytes_that_can_be_no_reading_are_a_failed_burst() -> None:
    board = Board().sampling()
    assert not board.take(lib.READING_OK, first=BAD)
    assert board.bench.events() == [(lib.EVENT_BUS_FAULT, lib.CAUSE_STUCK_BUS, 1)]
    assert board.take(lib.READING_OK)
    assert (board.samples, board.gaps) == (1, [True])


def test_five_failed_bursts_in_a_row_set_the_sensor_up_again() -> None:
    board = Board().sampling()
    for count in (1, 2, 3, 4):
        assert not board.take(lib.READING_NACK)
        assert board.bench.events()[-1][2] == count
    assert board.take(lib.READING_OK)  # the row ends
    for _ in range(5):
        assert not board.is_faulty
        assert not board.take(lib.READING_NACK)
    board.gives_up_for(lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 5)


def test_a_bus_that_a_failed_burst_leaves_held_ends_sampling() -> None:
    board = Board().sampling()
    board.recovered = lib.BUS_STUCK
    assert not board.take(lib.READING_TIMEOUT)
    board.gives_up_for(lib.EVENT_BUS_FAULT, lib.CAUSE_STUCK_BUS, 1)


def test_a_sensor_gone_silent_is_set_up_again() -> None:
    board = Board().sampling()
    assert board.take(lib.READING_OK)
    assert not board.step(SILENCE_US - 1)
    assert not board.is_faulty
    assert not board.step(1)
    board.gives_up_for(lib.EVENT_SENSOR_FAULT, lib.CAUSE_NO_DATA_READY, 0x71)


def test_missed_edges_are_told_and_leave_a_gap() -> None:
    board = Board().sampling().streaming()
    assert board.take(lib.READING_OK, missed=3)
    assert (lib.EVENT_OVERRUN, lib.CAUSE_LATE, 3) in board.bench.events()
    assert board.bench.c.status.overruns == 3
    assert board.take(lib.READING_OK)
    flags = [raw.fields["sample_flags"] for raw in board.bench.of("raw")]
    assert flags == [lib.SAMPLE_GAP, 0]


def test_a_sample_that_the_sensor_left_out_leaves_a_gap() -> None:
    board = Board().sampling().streaming()
    for elapsed_us in (5000, 7500, 7501, 5000):  # 1.5 periods of 200 Hz are allowed
        board.readings.append((lib.READING_OK, 0, 0))
        assert board.step(elapsed_us)
    flags = [raw.fields["sample_flags"] for raw in board.bench.of("raw")]
    assert flags == [0, 0, lib.SAMPLE_GAP, 0]


UNCHECKED = 199  # samples before the sensor is looked after


def almost_checked() -> Board:
    board = Board().sampling()
    for _ in range(UNCHECKED):
        assert board.take(lib.READING_OK)
    assert board.calls == []
    return board


def test_the_sensor_is_looked_after_now_and_then_between_two_bursts() -> None:
    board = almost_checked()
    assert board.take(lib.READING_OK)
    assert board.calls == ["stop", "check", "start"]
    board.calls.clear()
    for _ in range(UNCHECKED):
        assert board.take(lib.READING_OK)
    assert board.calls == []
    assert board.take(lib.READING_OK)
    assert board.calls == ["stop", "check", "start"]
    assert not any(board.gaps)


def test_a_sample_that_is_taken_late_leaves_no_time_for_a_look() -> None:
    board = almost_checked()
    board.age_us = 1001
    for _ in range(3):
        assert board.take(lib.READING_OK)
    assert board.calls == []
    board.age_us = 1000
    assert board.take(lib.READING_OK)
    assert board.calls == ["stop", "check", "start"]


def test_a_sensor_whose_samples_all_come_late_is_looked_after_all_the_same() -> None:
    board = almost_checked()
    board.age_us = 1001
    for _ in range(55):
        assert board.take(lib.READING_OK)
    assert board.calls == []
    assert board.take(lib.READING_OK)
    assert board.calls == ["stop", "check", "start"]


@pytest.mark.parametrize(
    ("result", "cause", "register"),
    [("UNSET", "CAUSE_REGISTERS", 0x1B), ("MAG_CHANGED", "CAUSE_MAG_SILENT", 0)],
)
def test_what_a_look_finds_wrong_sets_the_sensor_up_again(
    result: str, cause: str, register: int
) -> None:
    board = almost_checked()
    board.check_result = getattr(lib, f"SENSOR_{result}")
    board.identity.wrong_register = register
    before = board.samples
    assert board.take(lib.READING_OK)
    assert board.samples == before + 1  # the sample itself is good
    detail = 256 * register + 0x71
    board.gives_up_for(lib.EVENT_SENSOR_FAULT, getattr(lib, cause), detail)


def test_a_look_that_the_bus_fails_costs_a_sample_at_most() -> None:
    board = almost_checked()
    board.check_result = lib.SENSOR_BUS_NACK
    assert board.take(lib.READING_OK)
    assert board.bench.events()[-1] == (lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 1)
    assert not board.is_faulty
    assert board.take(lib.READING_OK)
