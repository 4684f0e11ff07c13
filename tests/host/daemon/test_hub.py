# SPDX-License-Identifier: MIT
"""A slow or broken sink is felt by nobody else, and what it misses is counted."""

from __future__ import annotations

import logging
import threading
import time

import pytest

from fakes import PATIENCE_S
from fakes.sinks import FakeSink, record
from imud.daemon import lane as lane_module
from imud.daemon.hub import FEW, Hub
from imud.daemon.lane import Lane
from imud.errors import FileError
from imud.probes.record import Presence


def test_records_arrive_in_order_at_every_sink() -> None:
    sinks = [FakeSink("a"), FakeSink("b")]
    whole = Hub()
    lanes = [whole.add(sink) for sink in sinks]
    for number in range(100):
        whole.put(record(number))
    whole.put(Presence("p", is_alive=True))
    whole.close()
    for sink, lane in zip(sinks, lanes, strict=True):
        assert sink.numbers(100) == list(range(100))
        assert (sink.opened, sink.closed) == (1, 1)
        assert lane.taken("p") == {"pose": 100}
    assert whole.dropped("p") == {"a": 0, "b": 0}


def test_records_of_a_full_turn_are_handed_over_at_its_end() -> None:
    sink = FakeSink()
    whole = Hub()
    whole.has_turns = True
    lane = whole.add(sink)
    for number in range(FEW):  # quiet so far: the first one is not kept back
        whole.put(record(number))
    assert sink.numbers(1) == [0]
    whole.end_turn()
    assert sink.numbers(FEW - 1) == list(range(1, FEW))
    sink.gate.clear()
    whole.put(record(FEW))
    assert lane.counts("p").waiting == 0
    whole.end_turn()
    sink.gate.set()
    assert sink.numbers(1) == [FEW]
    whole.put(record(FEW + 1))
    assert sink.numbers(1) == [FEW + 1]
    whole.close()


def test_a_stuck_sink_loses_its_oldest_and_holds_up_nobody() -> None:
    stuck, free = FakeSink("stuck"), FakeSink("free")
    stuck.gate.clear()
    lanes = [Lane(stuck, capacity=10), Lane(free, capacity=100)]
    for lane in lanes:
        lane.start()
    lanes[0].put(record(0))
    stuck.entered.wait()
    for number in range(1, 31):
        for lane in lanes:
            lane.put(record(number))
    assert free.numbers(30) == list(range(1, 31))
    assert lanes[0].dropped("p") == 20
    assert lanes[1].dropped("p") == 0
    stuck.gate.set()
    assert all(lane.close(PATIENCE_S) for lane in lanes)
    assert stuck.numbers(11) == [0, *range(21, 31)]
    assert lanes[0].taken("p") == {"pose": 11}


def test_a_sink_that_never_returns_does_not_hold_up_the_end() -> None:
    stuck = FakeSink()
    stuck.gate.clear()
    lane = Lane(stuck)
    lane.start()
    lane.put(record(0))
    stuck.entered.wait()
    assert not lane.close(0.01)
    stuck.gate.set()
    assert lane.close(PATIENCE_S)


def test_a_stuck_sink_takes_no_time_from_anothers_end(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stuck, slow = FakeSink("stuck"), FakeSink("slow")
    stuck.patience_s = 0.1
    stuck.gate.clear()
    slow.fault = lambda: time.sleep(0.1)  # one by one, longer than the other may take
    whole = Hub()
    lanes = [whole.add(sink) for sink in (stuck, slow)]
    for number in range(5):
        whole.put(record(number))
    whole.close()
    assert slow.numbers(5) == list(range(5))
    assert (stuck.closed, slow.closed) == (0, 1)
    assert [entry.message for entry in caplog.records] == [
        "stuck did not finish in time"
    ]
    stuck.gate.set()
    assert lanes[0].close(PATIENCE_S)


def test_a_failing_sink_is_told_once_and_opened_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "imud")
    monkeypatch.setattr(lane_module, "RETRY_S", 0.0)
    sink = FakeSink("disk")
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        raise OSError("No space left on device")

    sink.fault = fail
    lane = Lane(sink)
    lane.start()
    for number in range(3):
        failed.clear()
        lane.put(record(number))
        failed.wait()
    sink.fault = lambda: None
    lane.put(record(3))
    assert sink.numbers(1) == [3]
    assert lane.close(PATIENCE_S)
    assert lane.dropped("p") == 3
    assert lane.failures == 3
    assert sink.opened == 4
    assert [entry.message for entry in caplog.records] == [
        "disk failed, retrying: No space left on device",
        "disk works again",
    ]


def test_a_sink_that_can_not_be_opened_is_the_callers_to_tell() -> None:
    class Closed(FakeSink):
        def open(self) -> None:
            raise FileError("can't log there")

    with pytest.raises(FileError):
        Hub().add(Closed())


def test_a_sink_that_could_not_be_opened_is_without_a_record_once_it_can(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Subscribers come before the first probe does."""
    monkeypatch.setattr(lane_module, "RETRY_S", 0.0)
    opened = threading.Event()

    class Late(FakeSink):
        def open(self) -> None:
            super().open()
            if self.opened == 1:
                raise FileError("the address is taken")
            opened.set()

    whole = Hub()
    whole.set("late", Late("late"))
    opened.wait()
    whole.close()


def test_a_sink_goes_on_for_one_of_the_same_settings() -> None:
    class Lasting(FakeSink):
        went_on_for: FakeSink | None = None

        def go_on_for(self, other: FakeSink) -> None:
            self.went_on_for = other

    first, second, third = Lasting(), Lasting(), Lasting()
    whole = Hub()
    for number, sink in enumerate((first, second, third)):
        whole.set("fake", sink, goes_on=sink is second)
        whole.put(record(number))
        (third if sink is third else first).numbers(1)
    assert first.went_on_for is second
    assert (first.opened, second.opened, third.opened) == (1, 0, 1)
    assert whole.sink("fake") is third
    whole.close()
    assert (first.closed, second.closed, third.closed) == (2, 0, 2)  # first at its open


def test_a_sink_with_a_period_is_flushed_without_records() -> None:
    flushed = threading.Event()

    class Timed(FakeSink):
        period_s = 0.01

        def flush(self) -> None:
            super().flush()
            if self.flushed == 3:
                flushed.set()

    lane = Lane(Timed())
    lane.start()
    flushed.wait()
    assert lane.close(PATIENCE_S)
