# SPDX-License-Identifier: MIT
"""The way from a sensor to samples, over a board of the test's own: bursts that fail,
a sensor that is absent or silent, a bus that is held, edges that were missed."""

from __future__ import annotations

from typing import Any

import pytest

from core.desk import ffi, lib
from core.probe_bench import MPU9250, REST, Bench, callbacks

MILLISECOND = 1000
RETRY_US = 200 * MILLISECOND
SILENCE_US = 50 * MILLISECOND
BURSTS = [(0x68, 0x3B, 14), (0x0C, 0x02, 8)]
BAD = 0xEE  # the first byte of what can be no reading


class Board:
    """A sensor, its bus and the interrupts of a board, as far as acquisition knows."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.calls: list[str] = []
        self.setup_results = [lib.SENSOR_BUSY, lib.SENSOR_OK]
        self.check_result = lib.SENSOR_BUSY
        self.recovered = lib.BUS_OK
        self.readings: list[tuple[int, int, int]] = []  # result, missed, first byte
        self.age_us = 0  # of a reading, when it is taken
        self.gaps: list[bool] = []
        self._kept = [
            callbacks(
                "struct sensor_driver",
                check=self._check,
                begin=lambda _: self.calls.append("begin"),
                setup=self._setup,
                parse=self._parse,
            ),
            callbacks(
                "struct acquisition_port",
                recover_bus=self._recover,
                start_sampling=self._start,
                stop_sampling=lambda: self.calls.append("stop"),
                take_reading=self._take,
            ),
        ]
        driver, port = self._kept
        self.identity = ffi.new("struct sensor_identity *", MPU9250[0])
        self._bursts = ffi.new("struct bus_burst[]", BURSTS)
        driver |= {
            "identity": self.identity,
            "bursts": self._bursts,
            "bursts_count": len(BURSTS),
        }
        self._driver = ffi.new("struct sensor_driver *", driver)
        self._bus = ffi.new("struct bus_device *")  # the driver's affair
        port |= {"sensor": self._driver, "bus": self._bus}
        self._port = ffi.new("struct acquisition_port *", port)
        self.c = ffi.new("struct acquisition *")
        lib.acquisition_begin(self.c, self._port, self.bench.c)

    def _setup(self, _: Any, bus: Any, now_us: int) -> int:
        assert now_us == self.bench.time_us
        assert bus == self._bus
        return int(self.setup_results.pop(0))

    def _check(self, _: Any, bus: Any) -> int:
        assert bus == self._bus
        self.calls.append("check")
        return int(self.check_result)

    def _parse(self, _: Any, data: Any, time_us: int, out: Any) -> bool:
        if data[0] == BAD:
            return False
        has_gap = bool(out.has_gap)
        ffi.buffer(out)[:] = REST[0].tobytes()
        out.has_gap, out.time_us = has_gap, time_us
        self.gaps.append(has_gap)
        return True

    def _recover(self) -> int:
        self.calls.append("recover")
        return int(self.recovered)

    def _start(self, bursts: Any, count: int) -> None:
        found = [(b.address, b.reg, b.length) for b in bursts[0:count]]
        assert found == BURSTS
        self.calls.append("start")

    def _take(self, out: Any) -> int:
        if not self.readings:
            return int(lib.READING_NONE)
        result, out.missed, out.bytes[0] = self.readings.pop(0)
        out.time_us = self.bench.time_us - self.age_us
        return int(result)

    def step(self, elapsed_us: int = MILLISECOND) -> bool:
        self.bench.now_us += elapsed_us
        return bool(lib.acquisition_step(self.c, self.bench.time_us))

    def take(self, result: int, missed: int = 0, first: int = 0) -> bool:
        """One step with a reading."""
        self.readings.append((result, missed, first))
        return self.step()

    def sampling(self) -> Board:
        while self.c.phase != lib.ACQUISITION_SAMPLING:
            assert not self.step()
        self.calls.clear()
        self.bench.messages.clear()
        return self

    @property
    def samples(self) -> int:
        return int(self.bench.c.status.samples_read)

    @property
    def is_faulty(self) -> bool:
        return bool(self.bench.state == lib.STATE_FAULT)

    def gives_up_for(self, event: int, cause: int, detail: int = 0) -> None:
        """It has stopped, freed the bus, told why, and waits for the next attempt."""
        assert self.calls[-2:] == ["stop", "recover"]
        assert self.bench.events()[-1] == (event, cause, detail)
        assert self.is_faulty
        self.calls.clear()
        self.recovered = lib.BUS_OK
        self.setup_results = [lib.SENSOR_OK]
        assert not self.step(RETRY_US - 1)
        assert self.calls == []
        self.step(1)
        assert self.calls == ["begin"]
        self.step()
        assert self.calls == ["begin", "start"]
        assert not self.is_faulty
        assert self.bench.events()[-1][0] == lib.EVENT_BUS_RECOVERED
        assert self.take(lib.READING_OK)
        assert self.gaps.pop()


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
    board = Board().sampling()
    board.bench.command(lib.COMMAND_FIELDS, lib.STREAM_RAW)
    board.bench.command(lib.COMMAND_START)
    assert board.take(lib.READING_OK, missed=3)
    assert (lib.EVENT_OVERRUN, lib.CAUSE_LATE, 3) in board.bench.events()
    assert board.bench.c.status.overruns == 3
    assert board.take(lib.READING_OK)
    flags = [raw.fields["sample_flags"] for raw in board.bench.of("raw")]
    assert flags == [lib.SAMPLE_GAP, 0]


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
