# SPDX-License-Identifier: MIT
"""What an asyncio loop waits in, made for many ports: with little to do it wakes for
each of them at once; with much it lets some gather, as network drivers do.
"""

from __future__ import annotations

import selectors
import time

# After more turns in a row than this that had not to be waited for there is much to do:
# hardly ever with 8 probes at 200 Hz, nearly always with 64.
BUSY = 1

# A wake-up costs more than a message: what comes in this time shares one.
GATHER_S = 0.001

Ready = list[tuple[selectors.SelectorKey, int]]


class GatheringSelector(selectors.DefaultSelector):
    """Waits a little before it looks once more, while there is much to do."""

    def __init__(self) -> None:
        super().__init__()
        self._busy = 0  # turns in a row

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
