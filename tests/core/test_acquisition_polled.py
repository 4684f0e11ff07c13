# SPDX-License-Identifier: MIT
"""A board whose data-ready has no wire: the sensor is asked, and all else continues as
with the wire."""

from __future__ import annotations

from typing import Any

import pytest

from core.acquisition_desk import BURSTS, MILLISECOND, RETRY_US, SILENCE_US, Board
from core.desk import ffi, lib
from core.probe_bench import MPU9250, callbacks

STATUS = (0x68, 0x3A, 0x01)
PERIOD_US = 5000
QUESTION_US = 100


class Asked(Board):
    """Its sensor has a sample every 5 ms, and says so when it is asked."""

    def __init__(self) -> None:
        super().__init__()
        self.is_silent = False
        self.result = lib.BUS_OK
        self.fails_at = 0  # the register at which it does
        self.newest = self.taken = 0  # numbers of samples
        self._ready = ffi.new("struct sensor_ready *", STATUS)
        self._driver.ready = self._ready
        self._read = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, uint8_t *, uint8_t)", self._ask
        )
        self._bus.read = self._read
        self._time = ffi.callback("uint32_t(void)", lambda: self.bench.time_us)
        self._port.time_us = self._time

    def _ask(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.bench.now_us += QUESTION_US
        if self.result != lib.BUS_OK and self.fails_at == reg:
            return int(self.result)
        if (address, reg) == STATUS[:2]:
            assert length == 1
            newest = self.bench.now_us // PERIOD_US
            data[0] = int(newest > self.taken and not self.is_silent)
            self.taken = newest
        else:
            assert (address, reg, length) in self.bursts
            data[0] = 0
        return int(lib.BUS_OK)

    def run(self, seconds: float) -> None:
        end_us = self.bench.now_us + seconds * 1e6
        while self.bench.now_us < end_us:
            is_due = lib.acquisition_is_due(self.c, self.bench.time_us)
            self.step(20 if is_due else MILLISECOND)

    def asked(self) -> Asked:
        self.sampling()
        assert not lib.acquisition_is_due(self.c, self.bench.time_us)
        self.run(0.2)
        assert self.c.is_polled
        return self


def test_what_is_known_of_the_edges_outlives_a_look_at_the_sensor() -> None:
    board = Asked().asked()
    known = []
    for _ in range(30):  # looks come about once a second
        board.run(0.1)
        known.append(board.c.polled.learned)
    assert known == sorted(known)
    assert known[0] > 0
    assert board.calls.count("check") >= 2


def test_where_no_edge_comes_the_sensor_is_asked() -> None:
    board = Asked().asked()
    events = board.bench.events()
    assert events[0] == (lib.EVENT_DATA_READY_POLLED, lib.CAUSE_NO_DATA_READY, 0)
    assert board.calls == ["stop"]
    before = board.samples
    board.run(1.0)
    assert 199 <= board.samples - before <= 201
    assert lib.acquisition_polled_edges(board.c) >= board.samples
    assert not board.is_faulty


def test_times_are_those_of_the_edges() -> None:
    board = Asked().asked()
    times: list[int] = []
    parse = board._parse

    def noted(state: Any, data: Any, time_us: int, out: Any) -> bool:
        times.append(time_us)
        return parse(state, data, time_us, out)

    kept = ffi.callback(
        "bool(void *, const uint8_t *, uint32_t, struct sample *)", noted
    )
    board._driver.parse = kept
    board.run(1.0)
    errors = [
        (time_us + PERIOD_US // 2) % PERIOD_US - PERIOD_US // 2 for time_us in times
    ]
    assert max(map(abs, errors[5:])) < 60


class Wired(Asked):
    """Its sensor has a wire, which comes off and back."""

    def __init__(self) -> None:
        super().__init__()
        self.is_wired, self.off_us = True, 0  # of an edge that is not the sensor's
        self.edge = 0
        self.setup_results = [lib.SENSOR_OK] * 99

    def _start(self, bursts: Any, count: int) -> None:
        super()._start(bursts, count)
        self.edge = self.bench.now_us // PERIOD_US

    def _take(self, out: Any) -> int:
        newest = (self.bench.now_us - self.off_us) // PERIOD_US
        if self.calls[-1:] == ["stop"] or not self.is_wired or newest == self.edge:
            return int(lib.READING_NONE)
        self.edge = newest
        out.time_us, out.missed, out.bytes[0] = newest * PERIOD_US + self.off_us, 0, 0
        return int(lib.READING_OK)


def test_a_wire_that_comes_off_is_done_without_and_used_again() -> None:
    board = Wired()
    board.run(2)
    assert board.samples == pytest.approx(400, abs=2)
    board.is_wired = False
    board.run(2)
    told = (lib.EVENT_SENSOR_FAULT, lib.CAUSE_NO_DATA_READY, 0x71)
    assert board.bench.events().count(told) == 2
    assert board.c.is_polled
    before = board.samples
    board.run(4)  # listened in vain: no sample is lost
    assert board.samples - before == pytest.approx(800, abs=2)
    board.off_us, board.is_wired = PERIOD_US // 2, True
    board.run(2)
    assert board.c.is_polled  # such edges are noise
    board.off_us, before = 0, board.samples
    board.run(2)
    assert not board.c.is_polled
    told = (lib.EVENT_BUS_RECOVERED, lib.CAUSE_NO_DATA_READY, 0)
    assert board.bench.events()[-1] == told
    assert board.samples - before == pytest.approx(400, abs=2)


@pytest.mark.parametrize("reg", [STATUS[1], BURSTS[1][1]])
def test_a_bus_that_fails_is_told_and_asked_again(reg: int) -> None:
    board = Asked().asked()
    board.bench.messages.clear()
    board.result, board.fails_at = lib.BUS_NACK, reg
    while not board.bench.events():
        board.step(20)
    assert board.bench.events() == [(lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 1)]
    board.result = lib.BUS_OK
    before = board.samples
    board.run(0.5)
    assert board.samples - before > 90
    assert "start" not in board.calls


def test_a_sensor_that_says_nothing_is_set_up_again_and_asked() -> None:
    board = Asked().asked()
    board.is_silent = True
    board.setup_results = [lib.SENSOR_OK]
    board.calls.clear()
    board.run(0.1)
    fault = (lib.EVENT_SENSOR_FAULT, lib.CAUSE_NO_DATA_READY, 0x71)
    assert fault in board.bench.events()
    board.is_silent = False
    board.run(0.6)
    assert not board.is_faulty
    assert board.c.is_polled
    assert board.calls == ["stop", "recover", "begin"]


class Choice(Asked):
    """Its sensor may be another, which answers at another address."""

    def __init__(self) -> None:
        super().__init__()
        self.other_results: list[int] = []
        self._other_kept = callbacks(
            "struct sensor_driver",
            check=self._check,
            begin=lambda _: self.calls.append("begin other"),
            setup=lambda *_: (self.other_results or [lib.SENSOR_OK]).pop(0),
            parse=self._parse,
        )
        self.other_identity = ffi.new("struct sensor_identity *", MPU9250[0])
        self.other_identity.kind = lib.SENSOR_LSM6DSOX
        self._other = ffi.new(
            "struct sensor_driver *",
            self._other_kept
            | {
                "identity": self.other_identity,
                "bursts": self._bursts,
                "bursts_count": len(BURSTS),
                "ready": self._ready,
            },
        )
        self._driver.or_else = self._other
        self.setup_results = [lib.SENSOR_BUS_NACK]

    @property
    def sensor(self) -> int:
        """As the last hello names it."""
        return int(self.bench.of("hello")[-1].fields["sensor"])

    @property
    def faults(self) -> list[tuple[int, int, int]]:
        return [e for e in self.bench.events() if e[0] == lib.EVENT_BUS_FAULT]


NOT_IT = ["BUS_NACK", "WRONG_CHIP", "UNSET", "NO_FORCE"]


@pytest.mark.parametrize("result", NOT_IT)
def test_where_the_first_sensor_is_not_there_another_is_set_up(result: str) -> None:
    board = Choice()
    board.setup_results = [getattr(lib, f"SENSOR_{result}")]
    board.other_results = [lib.SENSOR_BUSY, lib.SENSOR_OK]
    for _ in range(3):
        board.step()
    assert board.calls == ["begin", "begin other", "start"]
    assert board.faults == []
    assert board.c.phase == lib.ACQUISITION_SAMPLING
    assert board.sensor == lib.SENSOR_LSM6DSOX


@pytest.mark.parametrize("result", NOT_IT[1:])
def test_without_the_other_the_fault_of_the_first_is_told(result: str) -> None:
    board = Choice()
    board.identity.who_am_i = [0x03, 0]
    board.setup_results = [getattr(lib, f"SENSOR_{result}"), lib.SENSOR_OK]
    board.other_results = [lib.SENSOR_BUS_NACK]
    board.step()
    board.step()
    cause = {"WRONG_CHIP": "WRONG_CHIP", "UNSET": "REGISTERS", "NO_FORCE": "FORCE"}
    told = (lib.EVENT_SENSOR_FAULT, getattr(lib, f"CAUSE_{cause[result]}"), 0x03)
    assert board.bench.events()[1:] == [told]  # after that of the settings


def test_where_neither_answers_that_is_told_and_the_first_is_tried_again() -> None:
    board = Choice()
    board.other_results = [lib.SENSOR_BUS_NACK]
    board.step()
    board.step()
    assert board.faults == [(lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 0)]
    board.calls.clear()
    board.setup_results = [lib.SENSOR_OK]
    board.step(RETRY_US)
    board.step()
    assert board.calls == ["begin", "start"]
    assert board.sensor == lib.SENSOR_MPU9250


@pytest.mark.parametrize("result", ["BUS_STUCK", "BUS_TIMEOUT", "STUCK"])
def test_a_sensor_that_is_there_and_fails_is_not_given_up_for_another(result) -> None:
    board = Choice()
    board.setup_results = [getattr(lib, f"SENSOR_{result}"), lib.SENSOR_OK]
    board.step()
    board.step(RETRY_US)
    board.step()
    assert "begin other" not in board.calls
    assert board.sensor == lib.SENSOR_MPU9250


def test_a_sensor_that_was_there_is_waited_for_without_trying_another() -> None:
    board = Choice()
    board.other_results = [lib.SENSOR_OK]
    board.step()
    board.step()
    board.calls.clear()
    board.step(SILENCE_US)  # asked from now on
    board.is_silent = True
    board.run(0.2)
    board.other_results = [lib.SENSOR_BUS_NACK, lib.SENSOR_OK]
    board.run(0.6)
    assert set(board.calls) <= {"begin other", "stop", "recover", "start"}
    assert board.calls.count("begin other") >= 2


def test_a_burst_of_no_length_ends_those_of_a_sample() -> None:
    board = Asked()
    board._bursts[1].length = 0
    board.bursts = BURSTS[:1]
    board.sampling()
    board.run(0.3)
    assert board.samples > 30
