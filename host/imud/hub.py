# SPDX-License-Identifier: MIT
"""One source, many sinks: each in its own thread behind its own bounded queue.

A sink that is slow loses its oldest records, one that fails is opened again after a
while; both are counted, neither is felt by the reader or by another sink.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Protocol

from imud.record import Presence, Record

Item = Record | Presence

# Records a sink may be behind: 8 probes with 300 messages a second for 3 s.
QUEUE_MAX = 8192

# A sink that failed is tried again after this long: a disk may have room again.
RETRY_S = 2.0

logger = logging.getLogger("imud")


class Sink(Protocol):
    """What the hub needs. All but the first open() is called in the sink's thread."""

    name: str
    period_s: float  # 0: woken by each record; else by the clock, then flushed
    patience_s: float  # at the end, for what waits to be taken and for close()

    def open(self) -> None: ...
    def take(self, record: Item) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


class Lane:
    """The queue and the thread of one sink."""

    def __init__(self, sink: Sink, capacity: int = QUEUE_MAX) -> None:
        self.sink = sink
        self._capacity = capacity
        self._queue: deque[Item] = deque()
        self._wake = threading.Condition()
        self._is_closing = False
        self._taken: Counter[tuple[str, str]] = Counter()
        self._dropped: Counter[str] = Counter()
        self._failures = 0
        self._broken_until: float | None = None
        self._is_told = False
        # A daemon thread: one stuck in its library must not keep the process alive.
        self._thread = threading.Thread(
            target=self._run, name=f"imud-{sink.name}", daemon=True
        )

    def start(self) -> None:
        self.sink.open()
        self._thread.start()

    def put(self, item: Item) -> None:
        with self._wake:
            if len(self._queue) >= self._capacity:
                self._count_dropped(self._queue.popleft())
            self._queue.append(item)
            is_behind = len(self._queue) * 2 >= self._capacity
            if self.sink.period_s == 0 or is_behind:
                self._wake.notify()

    def end(self) -> None:
        """Has the thread hand over what waits and close the sink."""
        with self._wake:
            self._is_closing = True
            self._wake.notify()

    def close(self, timeout_s: float) -> bool:
        """Ends it and waits for that; False if it took too long."""
        self.end()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def taken(self, probe: str) -> dict[str, int]:
        with self._wake:
            items = self._taken.items()
            return {topic: n for (name, topic), n in items if name == probe}

    def dropped(self, probe: str) -> int:
        with self._wake:
            return self._dropped[probe]

    @property
    def failures(self) -> int:
        return self._failures

    def _run(self) -> None:
        deadline = time.monotonic() + self.sink.period_s
        while True:
            with self._wake:
                self._wake.wait_for(self._is_due, timeout=self._patience(deadline))
                items = list(self._queue)
                self._queue.clear()
                is_closing = self._is_closing
            if self.sink.period_s > 0:
                deadline = time.monotonic() + self.sink.period_s
            self._hand_over(items)
            if is_closing:
                self._attempt(self.sink.close)
                return

    def _is_due(self) -> bool:
        if self._is_closing:
            return True
        if self.sink.period_s == 0:
            return len(self._queue) > 0
        return len(self._queue) * 2 >= self._capacity

    def _patience(self, deadline: float) -> float | None:
        if self.sink.period_s == 0:
            return None
        return max(0.0, deadline - time.monotonic())

    def _hand_over(self, items: list[Item]) -> None:
        if not self._is_usable():
            self._drop(items)
            return
        for index, item in enumerate(items):
            if not self._attempt(partial(self.sink.take, item)):
                self._drop(items[index:])
                return
            if isinstance(item, Record):
                with self._wake:
                    self._taken[item.probe, item.topic] += 1
        if self._attempt(self.sink.flush) and items and self._is_told:
            self._is_told = False
            logger.info("%s works again", self.sink.name)

    def _is_usable(self) -> bool:
        if self._broken_until is None:
            return True
        if time.monotonic() < self._broken_until:
            return False
        self._attempt(self.sink.close)
        self._broken_until = None
        return self._attempt(self.sink.open)

    def _attempt(self, action: Callable[[], None]) -> bool:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - a sink's fault stays in its lane
            self._failures += 1
            if not self._is_told:
                self._is_told = True
                logger.warning("%s fails and is tried again: %s", self.sink.name, error)
            self._broken_until = time.monotonic() + RETRY_S
            return False
        return True

    def _drop(self, items: list[Item]) -> None:
        with self._wake:
            for item in items:
                self._count_dropped(item)

    def _count_dropped(self, item: Item) -> None:
        if isinstance(item, Record):
            self._dropped[item.probe] += 1


class Hub:
    """Hands each record to every sink."""

    def __init__(self) -> None:
        self._lanes: list[Lane] = []

    def add(self, sink: Sink) -> Lane:
        """Opens the sink; an ImudError here is the caller's to tell."""
        lane = Lane(sink)
        lane.start()
        self._lanes.append(lane)
        return lane

    def put(self, item: Item) -> None:
        for lane in self._lanes:
            lane.put(item)

    def dropped(self, probe: str) -> dict[str, int]:
        return {lane.sink.name: lane.dropped(probe) for lane in self._lanes}

    def taken(self, probe: str, sink: str) -> dict[str, int]:
        """Records of a probe that a sink has taken, by topic."""
        lanes = [lane for lane in self._lanes if lane.sink.name == sink]
        return dict(sorted(lanes[0].taken(probe).items())) if lanes else {}

    def close(self) -> None:
        """Ends all at once: none has to wait for another that is stuck."""
        begin_s = time.monotonic()
        for lane in self._lanes:
            lane.end()
        for lane in self._lanes:
            until_s = begin_s + lane.sink.patience_s
            if not lane.close(max(0.0, until_s - time.monotonic())):
                logger.warning("%s did not finish in time", lane.sink.name)
