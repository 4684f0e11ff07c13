# SPDX-License-Identifier: MIT
"""A lane whose sink takes records in the caller's thread where it can.

With each record, another thread would wait for the interpreter: it could hand over two
thousand a second while the loop is busy. So it gets only what takes time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import Protocol, runtime_checkable

from imud.daemon.lane import QUEUE_MAX, Item, Lane, Sink
from imud.probes.record import Record

# A record that took the caller so long had to wait for something: Zenoh waits 50 ms for
# room in the queue of a subscriber. Only the sink's thread may wait like that, so for a
# while it gets all records: longer each time that it happens again soon. Zenoh gives up
# a subscriber that is silent after 10 s.
WAITED_S = 0.04
DETOUR_S, DETOUR_MAX_S = 0.25, 10.0

# Records that the caller takes in a turn of those that wait: some milliseconds.
TURN_MAX = 512

# The thread leaves the records that wait to a caller that has asked for them, for so
# long. From so many on, the caller in turn waits for the thread: with the interpreter
# to itself, that declares a probe in 1 ms, beside a busy loop in 16 ms.
GIVE_WAY_S = 0.02
MANY, YIELD_S = 128, 0.005
HAND_MAX = 16  # records that the thread then takes in a row


@runtime_checkable
class DirectSink(Sink, Protocol):
    """A sink for a DirectLane. take_at_once() takes a record without waiting; False: it
    is left to take() in the lane's thread.
    """

    def take_at_once(self, record: Item) -> bool: ...


class DirectLane(Lane):
    """Records keep their order: the caller takes none while the thread has one in hand,
    and takes those that wait before its own.
    """

    def __init__(self, sink: DirectSink, capacity: int = QUEUE_MAX) -> None:
        super().__init__(sink, capacity)
        self._at_once = sink.take_at_once
        self._detour_s = DETOUR_S
        self._detour_until_s = 0.0
        self._is_wanted = False  # the caller waits for the queue
        self._is_taking = False  # it has the first records of it

    def put(self, *items: Item) -> None:
        line = self._claim(items)
        if line:
            self._give_back(line, self._take_at_once(line))

    def _claim(self, items: Sequence[Item]) -> Sequence[Item]:
        """Has records wait, and returns the first of all that do; none if they are for
        the thread.
        """
        is_whole = self._broken_until is None and self._before is None
        if is_whole and not self._is_closing:
            with self._wake:
                self._is_wanted = not self._is_thread_free()
                if not self._is_wanted and not self._is_for_thread():
                    self._is_taking = True
                    self._queue.extend(items)
                    count = min(TURN_MAX, len(self._queue))
                    return [self._queue.popleft() for _ in range(count)]
        self._wait_in_line(items)
        return ()

    def _give_back(self, line: Sequence[Item], done: int) -> None:
        """Leaves the rest of the records to the thread, unless the caller could take
        more of them with its next ones.
        """
        with self._wake:
            self._is_taking = False
            self._is_wanted = done == len(line)
            self._queue.extendleft(reversed(line[done:]))
            self._trim()
            if self._queue:
                self._wake.notify()

    def _is_thread_free(self) -> bool:
        """Whether the thread has no record in hand, if need be after a while."""
        patience_s = YIELD_S if len(self._queue) >= MANY else 0.0
        return self._wake.wait_for(lambda: not self._in_hand, patience_s)

    def _is_for_thread(self) -> bool:
        """Whether the thread takes all records now."""
        return self._is_closing or time.monotonic() < self._detour_until_s

    def _take_at_once(self, items: Sequence[Item]) -> int:
        """How many of the items are done with: taken, or the last of them dropped."""
        done = 0

        def take() -> None:
            nonlocal done
            before_s = time.monotonic()
            for item in items:
                if not self._at_once(item):
                    return  # nor those behind it: the order stays
                done += 1
                now_s = time.monotonic()
                if now_s - before_s > WAITED_S:
                    self._leave_to_thread(now_s)
                    return
                before_s = now_s

        is_well = self._attempt(take)
        with self._wake:
            for item in islice(items, done):
                if type(item) is Record:
                    self._mine.taken[item.probe][item.topic] += 1
            if not is_well:
                self._count_dropped(items[done])
        return done if is_well else done + 1

    def _leave_to_thread(self, now_s: float) -> None:
        is_again = now_s - self._detour_until_s < DETOUR_MAX_S
        span_s = 2 * self._detour_s if is_again else DETOUR_S
        self._detour_s = min(DETOUR_MAX_S, span_s)
        self._detour_until_s = now_s + self._detour_s

    def _is_due(self) -> bool:
        return not self._is_taking and super()._is_due()

    def _settle(self, items: Sequence[Item], done: int) -> None:
        super()._settle(items, done)
        with self._wake:
            self._wake.notify()

    def _next(self) -> deque[Item]:
        """Few records, so that the caller gets those behind them soon; none if the
        caller is about to take them.
        """
        if self._is_wanted and not self._is_for_thread():
            self._is_wanted = False
            self._wake.wait_for(lambda: self._is_wanted, GIVE_WAY_S)
        if self._is_wanted or self._is_taking:
            return deque()
        if self._is_for_thread() or not self._queue:
            return super()._next()
        count = HAND_MAX if len(self._queue) >= MANY else 1
        return deque(self._queue.popleft() for _ in range(count))
