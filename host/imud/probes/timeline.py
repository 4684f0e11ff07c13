# SPDX-License-Identifier: MIT
"""The host's time and UTC. No I/O but `host_ns`; time is an argument.

Stamps are in UTC that never runs backwards, whatever is done to the host's clock.
docs/clock.md has the arithmetic.
"""

from __future__ import annotations

import time
from collections import deque
from functools import partial

# The host's time: of the oscillator, which nothing sets or slews. NTP changes the rate
# of the monotonic clock by 500 ppm, which would look like a probe's that jumps.
host_ns = partial(
    time.clock_gettime_ns,
    getattr(time, "CLOCK_MONOTONIC_RAW", time.CLOCK_MONOTONIC),
)

# Two readings of the host's clocks are this far apart at most, or they don't count; and
# the difference of those clocks is known to this.
READING_NS = 10_000

# UTC that goes faster or slower than the host's oscillator by more than this is not
# slewed, but stepped: NTP slews by 500 ppm at most, an oscillator is right to 100. A
# step that is smaller than the other is not worth telling.
SLEW_MAX = 1e-3
STEP_NS = 1_000_000

# Time that has to be taken back goes slower by this for as long as it takes.
SLOWEST = (9, 10)

# Pieces that are kept for messages that come out of their order.
PIECES = 16


class Rising:
    """A function of time, made of pieces as they become known, that never falls."""

    def __init__(self) -> None:
        # Each from beyond its first x: x, aim, rate, floor.
        self._pieces: deque[tuple[int, int, float, int]] = deque(maxlen=PIECES)
        self._last: int | None = None

    def turn(self, x: int, aim: int, rate: float) -> None:
        """Aims at `aim` at x and 1 + rate around it, without going back."""
        begin, floor = x - 1, None
        if self._last is not None:
            begin, floor = self._last, self.at(self._last)
        else:
            self._pieces.clear()
        aim += begin - x + round(rate * (begin - x))
        self._pieces.append((begin, aim, rate, aim if floor is None else floor))

    def is_beyond(self, x: int) -> bool:
        return self._last is not None and self._last > x

    def at(self, x: int) -> int:
        if self._last is None or x > self._last:
            self._last = x
        piece = next((each for each in reversed(self._pieces) if x > each[0]), None)
        begin, aim, rate, floor = piece or self._pieces[0]
        step = x - begin
        slow, of = SLOWEST
        return max(aim + step + round(rate * step), floor + step * slow // of)


class Timeline:
    """UTC of the host's time. A step of UTC forwards is taken at once, one backwards by
    and by; slews are followed.
    """

    def __init__(self, offset_ns: int = 0) -> None:
        self._offset_ns = offset_ns
        self._rising = Rising()
        self._rising.turn(0, offset_ns, 0.0)
        self._followed_ns: int | None = None
        # Of the last correction: until when another offset may have been true.
        self._turned_ns: int | None = None
        self._turn_ns = 0
        self.steps = 0
        self.last_step_ns = 0

    def follow(self, before_ns: int, utc_ns: int, after_ns: int) -> int:
        """Hears UTC as read between two readings of the host's time. Answers by how
        much UTC was stepped.
        """
        if after_ns - before_ns > READING_NS:
            return 0
        now_ns = (before_ns + after_ns) // 2
        since_ns = 0 if self._followed_ns is None else now_ns - self._followed_ns
        self._followed_ns = now_ns
        off_ns = utc_ns - now_ns - self._offset_ns
        if abs(off_ns) <= READING_NS:
            return 0
        self._offset_ns += off_ns
        self._turned_ns, self._turn_ns = after_ns, abs(off_ns)
        self._rising.turn(after_ns, after_ns + self._offset_ns, 0.0)
        if abs(off_ns) <= STEP_NS + SLEW_MAX * since_ns:
            return 0
        self.steps += 1
        self.last_step_ns = off_ns
        return off_ns

    def utc(self, host_ns: int) -> int:
        return self._rising.at(host_ns)

    def ahead(self, host_ns: int, utc_ns: int) -> int:
        """Of UTC as the host has it, while a step backwards is made up."""
        return utc_ns - host_ns - self._offset_ns

    def doubt(self, host_ns: int, bound_ns: int, utc_ns: int) -> int:
        """How far from UTC that may be, of a host's time right to `bound_ns`."""
        doubt_ns = abs(self.ahead(host_ns, utc_ns))
        if self._turned_ns is not None and host_ns - bound_ns < self._turned_ns:
            doubt_ns = max(doubt_ns, self._turn_ns)
        return READING_NS + doubt_ns
