# SPDX-License-Identifier: MIT
"""Writes the daemon's lines to the journal, and only a few of one kind in a while."""

from __future__ import annotations

import logging
import time
from collections import Counter, deque

# Of one kind of line, BURST are written in QUIET_S; the rest is counted.
BURST = 3
QUIET_S = 10.0

logger = logging.getLogger("imud")


class Limiter:
    """Lets `burst` lines of a kind through in `quiet_s` seconds; counts the others."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._quiet_s = quiet_s
        self._burst = burst
        self._spoken_s: dict[object, deque[float]] = {}
        self._withheld: Counter[object] = Counter()

    def configure(self, quiet_s: float, burst: int) -> None:
        self._quiet_s = quiet_s
        self._burst = burst

    def allow(self, kind: object, now_s: float) -> str | None:
        """The text to append to the line, or None to withhold it."""
        spoken = self._spoken_s.setdefault(kind, deque())
        while spoken and now_s - spoken[0] >= self._quiet_s:
            spoken.popleft()
        if len(spoken) >= self._burst:
            self._withheld[kind] += 1
            return None
        spoken.append(now_s)
        withheld = self._withheld.pop(kind, 0)
        return f" (and {withheld} like it before)" if withheld else ""


class Speaker:
    """Writes lines to the journal, limited by kind. Not thread-safe."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._limiter = Limiter(quiet_s, burst)

    def configure(self, quiet_s: float, burst: int) -> None:
        self._limiter.configure(quiet_s, burst)

    def say(
        self,
        kind: object,
        text: str,
        *,
        is_warning: bool = False,
        is_total: bool = False,
    ) -> bool:
        """Writes the line unless there were too many of its kind; returns whether it
        did. The next one of the kind says how many were withheld; not with `is_total`,
        whose text has the total.
        """
        more = self._limiter.allow(kind, time.monotonic())
        if more is not None:
            level = logging.WARNING if is_warning else logging.INFO
            logger.log(level, "%s%s", text, "" if is_total else more)
        return more is not None
