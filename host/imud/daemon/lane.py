# SPDX-License-Identifier: MIT
"""A lane: one sink in a thread of its own, behind a bounded queue.

A slow sink loses its oldest records; a sink that fails is opened again after a while.
Both are counted, and neither slows down the reader of the ports or another sink.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence, Set
from functools import partial
from itertools import islice
from typing import Any, NamedTuple, Protocol, runtime_checkable

from imud.errors import reason
from imud.probes.balance import SinkCounts
from imud.probes.record import Presence, Record


class LaneCounts(NamedTuple):
    """Records of one sink: taken by probe and topic, the others by probe."""

    taken: defaultdict[str, Counter[str]]
    dropped: Counter[str]
    earlier: Counter[str]  # put before there was such a sink

    @staticmethod
    def none() -> LaneCounts:
        return LaneCounts(defaultdict(Counter), Counter(), Counter())

    def after(self, before: LaneCounts, names: Mapping[str, str]) -> LaneCounts:
        """These counts and those before them; `names` are old and new names."""
        total = LaneCounts.none()
        for counts, renamed in ((self, {}), (before, names)):
            for probe, by_topic in counts.taken.items():
                total.taken[renamed.get(probe, probe)] += by_topic
            for probe, count in counts.dropped.items():
                total.dropped[renamed.get(probe, probe)] += count
            for probe, count in counts.earlier.items():
                total.earlier[renamed.get(probe, probe)] += count
        return total


Item = Record | Presence

# Records that may wait for a sink: 256 probes with 20 messages a second for 3 s; 30 MB.
QUEUE_MAX = 16_384

# A sink that failed is tried again after this long: a disk may have room again.
RETRY_S = 2.0

# A sink that replaces another waits so long for that to close, since both may use the
# same address. Records of that time wait in its queue.
SUCCEED_S = 10.0

# A sink with a period handles many records at a time. After this many it releases the
# GIL, for which the loop would otherwise wait for milliseconds. Each time costs changes
# of threads. One whose `is_quick` is true only keeps what it takes, and needs no
# pauses.
PAUSE_EVERY, PAUSE_S = 128, 0.0001

logger = logging.getLogger("imud")


class Sink(Protocol):
    """The interface of a sink for its lane. All but the first open() runs in the thread
    of the lane."""

    name: str
    period_s: float  # 0: wakes for each record; else wakes and flushes this often
    patience_s: float  # at the end, for waiting records and close()

    def open(self) -> None: ...
    def write(self, record: Item) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


@runtime_checkable
class LastingSink(Sink, Protocol):
    """A sink that what it has open outlasts: it can go on in place of another of the
    same settings, for probes of other names.
    """

    def go_on_for(self, other: Any) -> None: ...


class Lane:
    """The queue and the thread of one sink."""

    def __init__(self, sink: Sink, capacity: int = QUEUE_MAX) -> None:
        self.sink = sink
        self._capacity = capacity
        self._half = (capacity + 1) // 2
        self._pauses = not getattr(sink, "is_quick", False)
        self._queue: deque[Item] = deque()
        self._in_hand: Sequence[Item] = ()  # out of the queue, not yet counted
        self._wake = threading.Condition()
        self._is_closing = False
        self._mine = LaneCounts.none()
        self._failures = 0
        self._broken_until: float | None = None
        self._was_open = False
        self._trouble = ""
        # The lane that this one replaces, until that is closed; old and new names.
        self._before: Lane | None = None
        self._names: Mapping[str, str] = {}
        self._goes_on = False  # the sink, in the lane that replaces this one
        # A daemon thread: if it hangs in a library, the process can still end.
        self._thread = threading.Thread(
            target=self._run, name=f"imud-{sink.name}", daemon=True
        )

    def start(self) -> None:
        self.sink.open()
        self._was_open = True
        self._thread.start()

    def follow(
        self,
        before: Lane | None,
        names: Mapping[str, str],
        put: Mapping[str, int],
        *,
        goes_on: bool,
    ) -> None:
        """Starts in the place of another lane: opens the sink in its own thread when
        that one has closed, and continues its counts. Records wait meanwhile. `names`
        maps old names of probes to new ones, `put` has the records of each so far.
        `goes_on`: that one's sink has the same settings and goes on where it can.
        """
        self._before, self._names = before, names
        if before is None:
            self._mine.earlier.update(put)
        self._broken_until = 0.0  # open it before the first record
        if before is not None:
            before._goes_on = goes_on and isinstance(before.sink, LastingSink)
            before.end()
        self._thread.start()

    def put(self, *items: Item) -> None:
        """Hands records to the sink. All calls come from one thread."""
        self._wait_in_line(items)

    def _wait_in_line(self, items: Sequence[Item]) -> None:
        with self._wake:
            before = len(self._queue)
            self._queue.extend(items)
            self._trim()
            # Woken once: the thread takes all that is in the queue.
            enough = 1 if self.sink.period_s == 0 else self._half
            if before < enough <= len(self._queue):
                self._wake.notify()

    def _trim(self) -> None:
        """Drops the oldest records beyond the capacity."""
        for _ in range(len(self._queue) - self._capacity):
            self._count_dropped(self._queue.popleft())

    def end(self) -> None:
        """Asks the thread to hand over what waits and to close the sink."""
        with self._wake:
            self._is_closing = True
            self._wake.notify()

    def close(self, timeout_s: float) -> bool:
        """Ends the lane and waits for that; False if it took too long."""
        self.end()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def taken(self, probe: str) -> dict[str, int]:
        with self._wake:
            return dict(self._counts().taken.get(probe, {}))

    def dropped(self, probe: str) -> int:
        with self._wake:
            return self._counts().dropped[probe]

    def counts(self, probe: str) -> SinkCounts:
        """The counts of one probe, all at the same moment."""
        with self._wake:
            all_counts = self._counts()
            taken = all_counts.taken.get(probe)
            return SinkCounts(
                taken.total() if taken is not None else 0,
                all_counts.dropped[probe],
                self._waiting({probe}),
                all_counts.earlier[probe],
            )

    @property
    def waiting(self) -> int:
        """Records that the sink has not begun to take."""
        return len(self._queue)

    def _counts(self) -> LaneCounts:
        """Includes those of the lane that this one replaces."""
        before = self._before
        if before is None:
            return self._mine
        with before._wake:
            return self._mine.after(before._counts(), self._names)

    def _waiting(self, probes: Set[str]) -> int:
        """Records of these probes not yet taken, here and by the lane it replaces."""
        # A list: asked once a second for each probe, of thousands of records.
        count = sum(
            [
                item.probe in probes
                for items in (self._in_hand, self._queue)
                for item in items
                if type(item) is Record
            ]
        )
        before, names = self._before, self._names
        if before is not None:
            old = {name for name, fresh in names.items() if fresh in probes}
            with before._wake:
                count += before._waiting(old | (probes - names.keys()))
        return count

    def _succeed(self, before: Lane) -> None:
        if not before.close(SUCCEED_S):
            before._goes_on = False
            # Its counts may still change, so they are read again each time.
            logger.warning("%s did not finish in time", before.sink.name)
            return
        with self._wake:
            self._mine = self._counts()
            self._failures += before.failures
            self._before = None
        if before._goes_on and isinstance(before.sink, LastingSink):
            other = self.sink
            self._use(before.sink)
            self._was_open, self._trouble = before._was_open, before._trouble
            self._broken_until = before._broken_until
            self._attempt(partial(before.sink.go_on_for, other))

    def _use(self, sink: Sink) -> None:
        self.sink = sink

    @property
    def failures(self) -> int:
        return self._failures

    @property
    def trouble(self) -> str:
        """Why the sink takes nothing; empty while it works."""
        return self._trouble

    def _run(self) -> None:
        if self._before is not None:
            self._succeed(self._before)
        if self._broken_until is not None:
            self._is_usable()
        deadline = time.monotonic() + self.sink.period_s
        while True:
            with self._wake:
                self._wake.wait_for(self._is_due, timeout=self._patience(deadline))
                self._in_hand = items = self._next()
                is_closing = self._is_closing
            if self.sink.period_s > 0:
                deadline = time.monotonic() + self.sink.period_s
            self._hand_over(items)
            if is_closing:
                if not self._goes_on:
                    self._attempt(self.sink.close)
                return

    def _next(self) -> deque[Item]:
        """The next items of the queue for the thread."""
        items, self._queue = self._queue, deque()
        return items

    def _is_due(self) -> bool:
        if self._is_closing:
            return True
        if self.sink.period_s == 0:
            return len(self._queue) > 0
        return len(self._queue) >= self._half

    def _patience(self, deadline: float) -> float | None:
        if self.sink.period_s == 0:
            # One that was never open is tried again without a record, too.
            if self._broken_until is None or self._was_open:
                return None
            deadline = self._broken_until
        return max(0.0, deadline - time.monotonic())

    def _hand_over(self, items: Sequence[Item]) -> None:
        if not self._is_usable():
            self._settle(items, 0)
            return
        done = 0

        def write() -> None:
            nonlocal done
            for item in items:
                self.sink.write(item)
                done += 1
                is_due = done % PAUSE_EVERY == 0 and self._pauses
                if is_due and self.sink.period_s > 0:
                    time.sleep(PAUSE_S)

        is_well = self._attempt(write)
        # Without its flush nothing of this turn is written.
        if is_well and not self._attempt(self.sink.flush):
            done = 0
        self._settle(items, done)
        if is_well and done and self._trouble:
            self._trouble = ""
            logger.info("%s works again", self.sink.name)

    def _is_usable(self) -> bool:
        if self._broken_until is None:
            return True
        if time.monotonic() < self._broken_until:
            return False
        self._attempt(self.sink.close)
        is_open = self._attempt(self.sink.open)
        if is_open:
            self._broken_until = None
            self._was_open = True
        return is_open

    def _attempt(self, action: Callable[[], None]) -> bool:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - a fault of a sink stays in its lane
            self._failures += 1
            is_reported = bool(self._trouble)
            why = self._trouble = reason(error) or type(error).__name__
            if not is_reported:
                logger.warning("%s failed, retrying: %s", self.sink.name, why)
            self._broken_until = time.monotonic() + RETRY_S
            return False
        return True

    def _settle(self, items: Sequence[Item], done: int) -> None:
        """Counts the first `done` items as taken, the rest as dropped."""
        # Outside the lock, which put() waits for.
        taken = Counter(
            [
                (item.probe, item.topic)
                for item in islice(items, done)
                if type(item) is Record
            ]
        )
        dropped = Counter(
            [item.probe for item in islice(items, done, None) if type(item) is Record]
        )
        with self._wake:
            for (probe, topic), count in taken.items():
                self._mine.taken[probe][topic] += count
            self._mine.dropped.update(dropped)
            self._in_hand = ()
            self._put_down()

    def _put_down(self) -> None:
        """The thread has nothing in hand any more; called with the lock held."""

    def _count_dropped(self, item: Item) -> None:
        if isinstance(item, Record):
            self._mine.dropped[item.probe] += 1
