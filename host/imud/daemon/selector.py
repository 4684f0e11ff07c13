# SPDX-License-Identifier: MIT
"""The selector of the daemon's loop, made for many ports. Under light load it wakes for
each event at once; under heavy load it lets events gather, as network drivers do.
"""

from __future__ import annotations

import selectors
import time

# The load is heavy after more turns in a row than this without waiting: hardly ever
# with 8 probes at 200 Hz, nearly always with 64.
BUSY = 1

# A wake-up costs more than a message: messages of this time share one.
GATHER_S = 0.001

Ready = list[tuple[selectors.SelectorKey, int]]


class GatheringSelector(selectors.DefaultSelector):
    """Under heavy load, waits a little and looks again."""

    def __init__(self) -> None:
        super().__init__()
        self._busy = 0  # turns in a row without waiting

    def select(self, timeout: float | None = None) -> Ready:
        ready = super().select(0)
        if not ready:
            self._busy = 0
            has_work = timeout is not None and timeout <= 0
            return ready if has_work else super().select(timeout)
        self._busy += 1
        if self._busy <= BUSY:
            return ready
        time.sleep(GATHER_S)
        return super().select(0)
