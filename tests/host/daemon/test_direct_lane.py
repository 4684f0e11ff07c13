# SPDX-License-Identifier: MIT
"""Records are taken in the caller's thread unless something has to be waited for. They
keep their order.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from fakes import PATIENCE_S
from fakes.sinks import FakeSink, record
from imud.daemon import direct_lane
from imud.daemon import lane as lane_module
from imud.daemon.direct_lane import DETOUR_MAX_S, DETOUR_S, MANY, TURN_MAX, DirectLane
from imud.daemon.lane import Item
from imud.probes.record import Record
from streaming import until


class QuickSink(FakeSink):
    """Takes records of the topic `pose` in the caller's thread."""

    def __init__(self) -> None:
        super().__init__()
        self.threads: list[int] = []

    def try_write(self, item: Item) -> bool:
        if not isinstance(item, Record) or item.topic != "pose":
            return False
        self.fault()
        self.threads.append(threading.get_ident())
        self.taken.put(item.sequence)
        return True


@pytest.fixture
def sink() -> QuickSink:
    return QuickSink()


@pytest.fixture
def lane(sink: QuickSink) -> Iterator[DirectLane]:
    made = DirectLane(sink)
    made.start()
    yield made
    assert made.close(PATIENCE_S)


def test_a_sink_takes_records_at_once_in_the_callers_thread(
    sink: QuickSink, lane: DirectLane
) -> None:
    lane.put(record(0), record(1))
    assert sink.threads == [threading.get_ident()] * 2
    assert lane.taken("p") == {"pose": 2}
    assert sink.numbers(2) == [0, 1]


def test_records_taken_at_once_keep_their_place_behind_others(
    sink: QuickSink, lane: DirectLane
) -> None:
    sink.gate.clear()
    lane.put(record(0), record(1, topic="status"), record(2))
    sink.entered.wait()
    lane.put(record(3))  # the thread has the one before it in hand
    assert len(sink.threads) == 1
    sink.gate.set()
    assert sink.numbers(4) == [0, 1, 2, 3]
    assert lane.close(PATIENCE_S)
    assert lane.taken("p") == {"pose": 3, "status": 1}


def test_a_record_that_fails_at_once_is_counted_and_the_sink_opened_again(
    monkeypatch: pytest.MonkeyPatch, sink: QuickSink, lane: DirectLane
) -> None:
    monkeypatch.setattr(lane_module, "RETRY_S", 0.0)

    def fail() -> None:
        raise OSError("no network")

    sink.fault = fail
    lane.put(record(0))
    assert lane.trouble == "no network"
    sink.fault = lambda: None
    lane.put(record(1))  # by the thread, which opens the sink again
    assert sink.numbers(1) == [1]
    assert lane.close(PATIENCE_S)
    assert (sink.opened, lane.failures, lane.dropped("p")) == (2, 1, 1)
    assert lane.taken("p") == {"pose": 1}
    assert lane.trouble == ""


def test_the_thread_gets_the_records_while_taking_them_means_waiting(
    monkeypatch: pytest.MonkeyPatch, sink: QuickSink, lane: DirectLane
) -> None:
    monkeypatch.setattr(direct_lane, "WAITED_S", 0.0)
    lane.put(record(0))
    lane.put(record(1))
    assert sink.numbers(2) == [0, 1]
    assert len(sink.threads) == 1


def test_the_caller_takes_what_waits_once_the_thread_has_nothing_in_hand(
    sink: QuickSink, lane: DirectLane
) -> None:
    sink.gate.clear()
    lane.put(record(0, topic="status"), *map(record, range(1, MANY)))
    sink.entered.wait()
    sink.gate.set()
    number = MANY
    while not sink.threads:  # by the thread, those before it
        lane.put(record(number))
        number += 1
    assert {threading.get_ident()} == set(sink.threads)
    until(lambda: not lane.waiting)
    assert sink.numbers(number) == list(range(number))


def test_the_thread_does_not_wait_for_a_caller_that_does_not_come(
    monkeypatch: pytest.MonkeyPatch, sink: QuickSink, lane: DirectLane
) -> None:
    monkeypatch.setattr(direct_lane, "GIVE_WAY_S", 0.001)
    sink.gate.clear()
    lane.put(record(0, topic="status"))
    sink.entered.wait()
    lane.put(record(1))  # the caller would take it, and never comes back
    sink.gate.set()
    assert sink.numbers(2) == [0, 1]
    assert sink.threads == []


def test_at_its_end_nothing_is_left_for_a_caller_that_was_to_be_next(
    sink: QuickSink, lane: DirectLane
) -> None:
    sink.gate.clear()
    lane.put(record(0, topic="status"))
    sink.entered.wait()
    lane.put(record(1), record(2))  # they wait: the thread has one in hand
    lane.end()
    sink.gate.set()
    assert lane.close(PATIENCE_S)
    assert sink.numbers(3) == [0, 1, 2]


def test_a_caller_takes_a_part_of_a_long_queue_in_a_turn(
    sink: QuickSink, lane: DirectLane
) -> None:
    sink.gate.clear()
    lane.put(*map(record, range(TURN_MAX)), record(TURN_MAX), record(TURN_MAX + 1))
    assert len(sink.threads) == TURN_MAX
    sink.gate.set()
    assert sink.numbers(TURN_MAX + 2) == list(range(TURN_MAX + 2))


def test_the_order_stays_whoever_takes_them(sink: QuickSink, lane: DirectLane) -> None:
    random = np.random.default_rng(7)
    number = 0
    for _ in range(2000):
        topics = random.choice(
            ["pose", "status"], random.integers(1, 9), p=[0.95, 0.05]
        )
        lane.put(
            *(record(number + n, topic=str(topic)) for n, topic in enumerate(topics))
        )
        number += len(topics)
        if random.random() < 0.01:
            pause_s = random.random() * 2 * direct_lane.GIVE_WAY_S
            time.sleep(pause_s)  # the thread may take over, or not
    assert sink.numbers(number) == list(range(number))
    assert lane.close(PATIENCE_S)
    assert sum(lane.taken("p").values()) == number
    assert 0 < len(sink.threads) < number


def test_a_sink_that_makes_the_caller_wait_again_is_left_alone_for_longer(
    monkeypatch: pytest.MonkeyPatch, sink: QuickSink, lane: DirectLane
) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(direct_lane.time, "monotonic", lambda: now_s[0])

    def wait() -> None:
        now_s[0] += 2 * direct_lane.WAITED_S

    sink.fault = wait
    spans = []
    for number in range(9):
        lane.put(record(number))
        assert sink.threads == [threading.get_ident()] * (number + 1)
        spans.append(lane._detour_until_s - now_s[0])
        now_s[0] = lane._detour_until_s
    assert spans == pytest.approx(
        [min(DETOUR_S * 2**n, DETOUR_MAX_S) for n in range(9)]
    )
    now_s[0] += 2 * DETOUR_MAX_S
    lane.put(record(9))
    assert lane._detour_until_s - now_s[0] == pytest.approx(DETOUR_S)
