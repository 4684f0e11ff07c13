# SPDX-License-Identifier: MIT
"""The selector of the daemon's loop, made for many ports. With few messages it wakes
for each at once; with many it lets them gather, as network drivers do.
"""

from __future__ import annotations

import selectors
import time
from collections.abc import Callable

# Events a second from which they are many: 8 probes at 200 Hz make 1,600. Below the
# lower number they are few again.
MANY_HZ, FEW_HZ = 3000.0, 2500.0

# The rate is measured over so long.
MEASURE_S = 0.1

# A wake-up costs more than a message: those of this time share one.
GATHER_S = 0.001

Ready = list[tuple[selectors.SelectorKey, int]]


class GatheringSelector(selectors.DefaultSelector):
    """While events are many, waits a little before it looks for them. Before that it
    calls `on_turn`: what was to be done has been done.
    """

    def __init__(self) -> None:
        super().__init__()
        self.on_turn: Callable[[], object] = lambda: None
        self._is_many = False
        self._seen = 0
        self._since_s = time.monotonic()

    def select(self, timeout: float | None = None) -> Ready:
        """As selectors has it, but after GATHER_S while events are many."""
        self.on_turn()
        if self._is_many and (timeout is None or timeout >= GATHER_S):
            time.sleep(GATHER_S)
        ready = super().select(timeout)
        self._seen += len(ready)
        now_s = time.monotonic()
        if now_s - self._since_s >= MEASURE_S:
            rate_hz = self._seen / (now_s - self._since_s)
            self._is_many = rate_hz > (FEW_HZ if self._is_many else MANY_HZ)
            self._seen, self._since_s = 0, now_s
        return ready
