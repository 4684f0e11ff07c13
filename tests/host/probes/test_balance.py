# SPDX-License-Identifier: MIT
"""A message that slips away uncounted, at any link, is told."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from imud.daemon.hub import Hub
from imud.daemon.lane import Item
from imud.probes.balance import SinkCounts, balance
from imud.probes.record import Presence, Record

COUNTERS: dict[str, Any] = {
    "samples_ready": 1000,
    "samples_read": 990,
    "samples_fused": 990,
    "overruns": 9,
    "messages_sent": 500,
    "messages_dropped": 20,
}


def balanced(
    *,
    received: int = 70,
    put: int = 80,
    numbered: int = 519,
    sinks: dict[str, SinkCounts] | None = None,
    **counters: int,
) -> dict[str, Any]:
    account = {"received": 40, "earlier_boots": {"received": 30}}
    sinks = sinks or {"zenoh": SinkCounts(70, 6, 4), "log": SinkCounts(80)}
    return balance(account, COUNTERS | counters, numbered, received, put, sinks)


def test_what_adds_up_is_said_link_by_link() -> None:
    found = balanced()
    assert found["adds_up"]
    assert found["differs"] == []
    assert found["sensor"]["unread"] == 1
    assert found["probe"] == {
        "numbers": 520,
        "sent": 500,
        "dropped": 20,
        "unexplained": 0,
    }
    assert found["sinks"]["zenoh"] == {
        "taken": 70,
        "dropped": 6,
        "waiting": 4,
        "earlier": 0,
    }


def test_what_was_put_before_a_sink_was_there_is_not_missed_there() -> None:
    found = balanced(sinks={"log": SinkCounts(taken=50, earlier=30)})
    assert found["adds_up"]
    found = balanced(sinks={"log": SinkCounts(taken=50, earlier=29)})
    assert found["differs"] == ["log"]


@pytest.mark.parametrize(
    ("changes", "link"),
    [
        ({"samples_read": 992}, "sensor"),
        ({"samples_fused": 991}, "sensor"),
        ({"messages_sent": 499}, "probe"),
        ({"messages_dropped": 21}, "probe"),
        ({"numbered": 520}, "probe"),
        ({"received": 69}, "wire"),
        ({"received": 71}, "wire"),
        ({"sinks": {"log": SinkCounts(79)}}, "log"),
        ({"sinks": {"log": SinkCounts(80, 0, 1)}}, "log"),
    ],
)
def test_one_too_many_or_too_few_is_told(changes: dict[str, Any], link: str) -> None:
    found = balanced(**changes)
    assert not found["adds_up"]
    assert found["differs"] == [link]


def test_counters_that_wrap_add_up() -> None:
    top = 1 << 32
    assert balanced(
        numbered=top - 1, messages_sent=top - 5, messages_dropped=5, samples_ready=3,
        samples_read=top - 2, samples_fused=top - 2, overruns=4,
    )["adds_up"]  # fmt: skip


def test_before_the_first_counters_there_is_nothing_to_say() -> None:
    account = {"received": 1, "earlier_boots": {"received": 0}}
    found = balance(account, {}, 0, 1, 1, {})
    assert found["adds_up"]
    assert found["sensor"] is None
    assert found["probe"] is None


class Held:
    """A sink that takes when it is let, and fails when it is told to."""

    name = "held"
    period_s = 0.0
    patience_s = 5.0

    def __init__(self) -> None:
        self.may = threading.Event()
        self.has_begun = threading.Event()
        self.is_failing = False

    def open(self) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...

    def write(self, _: Item) -> None:
        self.has_begun.set()
        self.may.wait()
        if self.is_failing:
            raise OSError("no room")


@pytest.mark.parametrize("is_failing", [False, True])
def test_a_sink_s_counts_add_up_while_it_is_stuck_and_after(is_failing: bool) -> None:
    hub, sink = Hub(), Held()
    sink.is_failing = is_failing
    hub.add(sink)
    for number in range(20_000):
        hub.put(Record("p", "pose", b"{}", b"", number, 0, 0))
        if number == 0:
            sink.has_begun.wait()
            hub.put(Presence("p", True))
    stuck = hub.counts("p")["held"]
    assert stuck.taken == 0
    assert stuck.dropped > 0
    assert stuck.waiting > 8000
    assert stuck.taken + stuck.dropped + stuck.waiting == 20_000
    sink.may.set()
    hub.close()
    after = hub.counts("p")["held"]
    assert after.waiting == 0
    assert after.taken + after.dropped == 20_000
    assert (after.taken == 0) is is_failing


def test_counts_add_up_while_another_sink_takes_the_place_of_a_stuck_one() -> None:
    hub, stuck, after = Hub(), Held(), Held()
    hub.add(stuck)
    after.may.set()

    def put(first: int) -> None:
        for number in range(first, first + 100):
            hub.put(Record("p", "pose", b"{}", b"", number, 0, 0))

    put(0)
    stuck.has_begun.wait()
    hub.set("held", after)
    put(100)
    counts = hub.counts("p")["held"]
    assert (counts.taken, counts.dropped, counts.waiting) == (0, 0, 200)
    stuck.may.set()
    after.has_begun.wait()
    hub.close()
    counts = hub.counts("p")["held"]
    assert (counts.taken, counts.dropped, counts.waiting) == (200, 0, 0)
