# SPDX-License-Identifier: MIT
"""Sinks that take records as a test lets them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from fakes.port import PATIENCE_S
from imud.daemon.lane import Item
from imud.probes.record import Record


def record(number: int, probe: str = "p", topic: str = "pose") -> Record:
    return Record(probe, topic, b"{}", b"", number, 0, 0)


class FakeSink:
    """Takes records one by one as the test lets it."""

    period_s = 0.0
    patience_s = PATIENCE_S

    def __init__(self, name: str = "fake") -> None:
        self.name = name
        self.taken: queue.Queue[int] = queue.Queue()
        self.gate = threading.Event()
        self.gate.set()
        self.entered = threading.Event()
        self.fault: Callable[[], None] = lambda: None
        self.opened = 0
        self.closed = 0
        self.flushed = 0

    def open(self) -> None:
        self.opened += 1

    def write(self, item: Item) -> None:
        self.entered.set()
        self.gate.wait()
        self.fault()
        if isinstance(item, Record):
            self.taken.put(item.sequence)

    def flush(self) -> None:
        self.flushed += 1

    def close(self) -> None:
        self.closed += 1

    def numbers(self, count: int) -> list[int]:
        return [self.taken.get() for _ in range(count)]
