# SPDX-License-Identifier: MIT
"""A lane whose sink takes records in the caller's thread where it can.

Another thread would contend for the GIL with each record: it could hand over two
thousand per second while the loop is busy. So it gets only slow work.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
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


class Holder(Enum):
    """Who may take records from the queue. It changes with the lock held only.

              the caller comes            all are taken
        FREE ------------------> CALLER ----------------> CALLER_NEXT
        ^ ^ ^    some are left    |  ^  the caller comes   |   |   ^
        | | +---------------------+  +---------------------+   |   |
        | |   nobody came for GIVE_WAY_S, or the lane ends     |   |
        | +----------------------------------------------------+   |
        | the thread takes some; they are done                     | they are done
        v               the caller comes                           |
        THREAD -----------------------------------------> THREAD_THEN_CALLER

    Where the records are for the thread, the caller leaves FREE behind and takes none.
    """

    FREE = auto()  # either may take it
    THREAD = auto()  # it has records in hand
    THREAD_THEN_CALLER = auto()  # the same, and the caller waits for the queue
    CALLER_NEXT = auto()  # the thread leaves the records to a caller who is to come
    CALLER = auto()  # it has the first records of the queue


THREADS = (Holder.THREAD, Holder.THREAD_THEN_CALLER)


@runtime_checkable
class DirectSink(Sink, Protocol):
    """A sink for a DirectLane. try_write() takes a record without waiting; False: it is
    left to write() in the lane's thread.
    """

    def try_write(self, record: Item) -> bool: ...


class DirectLane(Lane):
    """Records keep their order: the caller takes none while the thread has one in hand,
    and takes those that wait before its own.
    """

    def __init__(self, sink: DirectSink, capacity: int = QUEUE_MAX) -> None:
        super().__init__(sink, capacity)
        self._try_write = sink.try_write
        self._detour_s = DETOUR_S
        self._detour_until_s = 0.0
        self._holder = Holder.FREE

    def _use(self, sink: Sink) -> None:
        super()._use(sink)
        if isinstance(sink, DirectSink):
            self._try_write = sink.try_write

    def put(self, *items: Item) -> None:
        line = self._claim(items)
        if line:
            self._give_back(line, self._write_at_once(line))

    def _claim(self, items: Sequence[Item]) -> Sequence[Item]:
        """Has records wait, and returns the first of all that do; none if they are for
        the thread.
        """
        is_whole = self._broken_until is None and self._before is None
        if is_whole and not self._is_closing:
            with self._wake:
                if not self._is_thread_free():
                    self._holder = Holder.THREAD_THEN_CALLER
                elif self._is_for_thread():
                    self._holder = Holder.FREE
                else:
                    self._holder = Holder.CALLER
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
            is_all = done == len(line)
            self._holder = Holder.CALLER_NEXT if is_all else Holder.FREE
            self._queue.extendleft(reversed(line[done:]))
            self._trim()
            if self._queue:
                self._wake.notify()

    def _is_thread_free(self) -> bool:
        """Whether the thread has no record in hand, if need be after a while."""
        patience_s = YIELD_S if len(self._queue) >= MANY else 0.0
        return self._wake.wait_for(lambda: self._holder not in THREADS, patience_s)

    def _is_for_thread(self) -> bool:
        """Whether the thread takes all records now."""
        return self._is_closing or time.monotonic() < self._detour_until_s

    def _write_at_once(self, items: Sequence[Item]) -> int:
        """How many of the items are done with: taken, or the last of them dropped."""
        done = 0

        def write() -> None:
            nonlocal done
            before_s = time.monotonic()
            for item in items:
                if not self._try_write(item):
                    return  # nor those behind it: the order stays
                done += 1
                now_s = time.monotonic()
                if now_s - before_s > WAITED_S:
                    self._leave_to_thread(now_s)
                    return
                before_s = now_s

        is_well = self._attempt(write)
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
        return self._holder is not Holder.CALLER and super()._is_due()

    def _put_down(self) -> None:
        if self._holder is Holder.THREAD:
            self._holder = Holder.FREE
        elif self._holder is Holder.THREAD_THEN_CALLER:
            self._holder = Holder.CALLER_NEXT
        self._wake.notify()

    def _next(self) -> deque[Item]:
        """Few records, so that the caller gets those behind them soon; none if the
        caller is about to take them.
        """
        if self._holder is Holder.CALLER_NEXT:
            self._holder = Holder.FREE
            if not self._is_for_thread():
                came = Holder.CALLER_NEXT
                self._wake.wait_for(lambda: self._holder is came, GIVE_WAY_S)
        if self._holder is not Holder.FREE or not self._queue:
            return deque()
        self._holder = Holder.THREAD
        if self._is_for_thread():
            return super()._next()
        count = HAND_MAX if len(self._queue) >= MANY else 1
        return deque(self._queue.popleft() for _ in range(count))
