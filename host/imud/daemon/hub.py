# SPDX-License-Identifier: MIT
"""One source, many sinks: hands each record to the lane of every sink."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping

from imud.daemon.direct_lane import DirectLane, DirectSink
from imud.daemon.lane import Item, Lane, Sink
from imud.probes.balance import SinkCounts

# Batch the records of a turn of the loop from this size: a thread woken in the middle
# of many would only contend for the GIL.
FEW = 4

logger = logging.getLogger("imud")


class Hub:
    """Hands each record to every sink: those of one turn of the loop together at its
    end, but the first one at once while turns have few. All calls come from one thread.
    """

    def __init__(self) -> None:
        self._lanes: list[Lane] = []
        self._fresh: list[Item] = []
        self._size = 0  # records of this turn
        self._is_quiet = True  # the last turn had few
        self.has_turns = False  # whether end_turn() is called; else each record is one

    def add(self, sink: Sink) -> Lane:
        """Opens the sink and starts its lane; raises what the sink's open() raises."""
        lane = _lane(sink)
        lane.start()
        self._lanes.append(lane)
        return lane

    def set(
        self,
        name: str,
        sink: Sink | None,
        names: Mapping[str, str] | None = None,
        put: Mapping[str, int] | None = None,
        *,
        goes_on: bool = False,
    ) -> None:
        """Replaces the sink of that name, or removes it (None); never waits.

        `names`: old and new names of renamed probes. `put`: the records of each probe
        so far, for a sink that did not exist before. `goes_on`: it has the settings of
        the one before.
        """
        self.hand_over()
        place = next(
            (n for n, e in enumerate(self._lanes) if e.sink.name == name), None
        )
        before = None if place is None else self._lanes.pop(place)
        if sink is None:
            if before is not None:
                before.end()
            return
        lane = _lane(sink)
        self._lanes.append(lane)
        lane.follow(before, names or {}, put or {}, goes_on=goes_on)

    def trouble(self, name: str) -> str | None:
        """Why that sink takes nothing; empty: it works, None: there is no such sink."""
        lanes = [lane for lane in self._lanes if lane.sink.name == name]
        return lanes[0].trouble if lanes else None

    def sink(self, name: str) -> Sink | None:
        return next((e.sink for e in self._lanes if e.sink.name == name), None)

    def failures(self) -> dict[str, int]:
        return {lane.sink.name: lane.failures for lane in self._lanes}

    def refused(self) -> dict[str, Mapping[str, int]]:
        """Clients and messages that sinks have refused, by sink and reason."""
        found = ((e.sink.name, getattr(e.sink, "refused", {})) for e in self._lanes)
        return {name: dict(reasons) for name, reasons in found if reasons}

    def put(self, item: Item) -> None:
        self._fresh.append(item)
        self._size += 1
        if not self.has_turns:
            self.end_turn()
        elif self._size == 1 and self._is_quiet:
            self.hand_over()

    def end_turn(self) -> None:
        """To be called before the loop waits again."""
        if self._size:
            self._is_quiet, self._size = self._size < FEW, 0
            self.hand_over()

    def hand_over(self) -> None:
        """Gives what was put so far to all sinks."""
        items, self._fresh = self._fresh, []
        if items:
            for lane in self._lanes:
                lane.put(*items)

    def counts(self, probe: str) -> dict[str, SinkCounts]:
        """The outcome of a probe's records, by sink."""
        self.hand_over()
        return {lane.sink.name: lane.counts(probe) for lane in self._lanes}

    def dropped(self, probe: str) -> dict[str, int]:
        return {lane.sink.name: lane.dropped(probe) for lane in self._lanes}

    def taken(self, probe: str, sink: str) -> dict[str, int]:
        """How many records of a probe a sink has taken, by topic."""
        lanes = [lane for lane in self._lanes if lane.sink.name == sink]
        return dict(sorted(lanes[0].taken(probe).items())) if lanes else {}

    def close(self) -> None:
        """Ends all sinks at the same time: none waits for another that hangs."""
        self.hand_over()
        begin_s = time.monotonic()
        for lane in self._lanes:
            lane.end()
        for lane in self._lanes:
            until_s = begin_s + lane.sink.patience_s
            if not lane.close(max(0.0, until_s - time.monotonic())):
                logger.warning("%s did not finish in time", lane.sink.name)


def _lane(sink: Sink) -> Lane:
    return DirectLane(sink) if isinstance(sink, DirectSink) else Lane(sink)
