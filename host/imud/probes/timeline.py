# SPDX-License-Identifier: MIT
"""The host's time and UTC. No I/O but `host_ns`; time is an argument.

Stamps are in UTC that never runs backwards, but where the host's clock is set back by
far: there a new timeline begins.
docs/pose-details.md explains how.
"""

from __future__ import annotations

from imud._core import Rising
from imud.machine import system

host_ns = system.host_clock_ns
slept_ns = system.slept_ns

# Readings of the host's clocks further apart than this are not used; so the difference
# of those clocks is known to this.
READING_NS = 10_000

# UTC that gains or loses more than this against the host's oscillator was stepped, not
# slewed: NTP slews by 500 ppm at most, an oscillator is right to 100 ppm. Steps below
# STEP_NS are not told.
SLEW_MAX = 1e-3
STEP_NS = 1_000_000

# A step backwards by more than this is not made up, which takes ten times as long.
BACK_MAX_NS = 2_000_000_000


class Timeline:
    """Turns the host's time into UTC, both in ns. Slews and steps forwards are followed
    at once, steps backwards slowly: UTC as given here never falls, unless a step
    backwards by more than BACK_MAX_NS begins a new timeline.
    """

    def __init__(self, offset_ns: int = 0) -> None:
        self._offset_ns = offset_ns
        self._begin(0)
        self._followed_ns: int | None = None
        # The last correction: before this time the offset may have been another one.
        self._turned_ns: int | None = None
        self._turn_ns = 0
        # The host whose UTC it is, and how far that may be off in us (None: not known).
        self.whose: tuple[str, int | None] | None = None
        self.steps = 0
        self.last_step_ns = 0
        self.number = 1  # of this timeline
        self.woke_ns = 0  # host's time since when imud has run without a pause

    def _begin(self, host_ns: int) -> None:
        self._rising = Rising()
        self.utc = self._rising.at  # of a host's time
        self._rising.turn(host_ns, host_ns + self._offset_ns, 0.0)

    def follow(self, before_ns: int, utc_ns: int, after_ns: int) -> int:
        """Takes UTC as read between two readings of the host's time. Returns by how
        many ns UTC was stepped, mostly 0.
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
        if off_ns < -BACK_MAX_NS:
            self._begin(after_ns)
            self.number += 1
        else:
            self._rising.turn(after_ns, after_ns + self._offset_ns, 0.0)
        if abs(off_ns) <= STEP_NS + SLEW_MAX * since_ns:
            return 0
        self.steps += 1
        self.last_step_ns = off_ns
        return off_ns

    def silence(self, heard_ns: int, now_ns: int) -> int:
        """For how many ns nothing was heard while imud could have heard it."""
        return now_ns - max(heard_ns, self.woke_ns)

    def since(self, now_ns: int, patience_ns: int) -> int:
        """What was heard since that host's time has not been silent for so long."""
        since_ns = now_ns - patience_ns
        return 0 if since_ns < self.woke_ns else since_ns

    def ahead(self, host_ns: int, utc_ns: int) -> int:
        """By how many ns `utc_ns` is ahead of the host's UTC after a step backwards."""
        return utc_ns - host_ns - self._offset_ns

    def doubt(self, host_ns: int, bound_ns: int, utc_ns: int) -> int:
        """Error bound in ns of `utc_ns`, from a host's time right to `bound_ns`."""
        doubt_ns = abs(utc_ns - host_ns - self._offset_ns)
        if self._turned_ns is not None and host_ns - bound_ns < self._turned_ns:
            doubt_ns = max(doubt_ns, self._turn_ns)
        return READING_NS + doubt_ns
