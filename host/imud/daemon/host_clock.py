# SPDX-License-Identifier: MIT
"""Follows UTC on this machine; a step of it is told in the journal and on `clock`."""

from __future__ import annotations

import time

from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry, Registry
from imud.machine.utc import Sync, sync_of_host
from imud.probes.clock import Refit
from imud.probes.timeline import READING_NS, Timeline, host_ns, slept_ns

CLOCK = "clock"  # topic of the records

# From a sleep of this length on it is told. imud looks every 0.05 s; a busy machine
# lets it wait for longer, which is a fault from this length on.
SLEPT_NS = 100_000_000
STOOD_NS = 2_000_000_000

# So long after a check another one finds only a slew, of 10 us at most, unless two
# clocks that are read in no time have parted: one counts sleep and steps of UTC.
RECENT_NS = 20_000_000


class HostClock:
    """The timeline that all sessions share, and who hears of its steps."""

    def __init__(
        self, registry: Registry, publisher: RecordPublisher, lines: ProbeLines
    ) -> None:
        self._registry = registry
        self._publisher = publisher
        self._lines = lines
        # Use the reading with the least time between both clocks.
        self.timeline = Timeline(max(time.time_ns() - host_ns() for _ in range(5)))
        self._looked_ns: int | None = None  # host's time
        self._slept_ns = slept_ns()
        self._ticks_ns = self._apart_ns = 0  # at the last check
        self.sync = Sync("")
        self.look()

    def look(self) -> None:
        """Asks whether this host follows UTC; tells when that changes."""
        before, self.sync = self.sync, sync_of_host()
        self.timeline.whose = (self.sync.host, self.sync.bound_us)
        is_known = None not in (before.is_synchronised, self.sync.is_synchronised)
        if is_known and before.is_synchronised != self.sync.is_synchronised:
            self._lines.synchronised(is_so=bool(self.sync.is_synchronised))

    def now_ns(self) -> int:
        """UTC, which never runs backwards within a timeline."""
        return self.timeline.utc(host_ns())

    def follow(self) -> None:
        """Checks whether the host's clock was set, and whether imud could run. To be
        called before messages are dated, and several times a second.
        """
        ticks_ns = time.monotonic_ns()
        apart_ns = time.time_ns() - ticks_ns
        is_recent = ticks_ns - self._ticks_ns < RECENT_NS
        if is_recent and -READING_NS < apart_ns - self._apart_ns < READING_NS:
            return
        self._ticks_ns, self._apart_ns = ticks_ns, apart_ns
        before_ns, utc_ns = host_ns(), time.time_ns()
        self._notice_pause(before_ns)
        before = self.timeline.number
        step_ns = self.timeline.follow(before_ns, utc_ns, host_ns())
        if step_ns == 0:
            return
        is_anew = self.timeline.number != before
        self._lines.clock_set(step_ns, is_anew=is_anew)
        for entry in self._registry:
            self._say(entry, step_ns, "set")

    def notice_refit(self, entry: ProbeEntry, refit: Refit) -> None:
        """Tells that the time of a probe was wrong."""
        self._lines.refit(entry, refit)
        self._say(entry, refit.step_ns, refit.reason)

    def _notice_pause(self, now_ns: int) -> None:
        """Silence of a time in which imud did not run is nobody's."""
        slept = slept_ns() - self._slept_ns
        self._slept_ns += slept
        looked_ns, self._looked_ns = self._looked_ns, now_ns
        stood_ns = 0 if looked_ns is None else now_ns - looked_ns - slept
        if slept < SLEPT_NS and stood_ns < STOOD_NS:
            return
        for pause_ns, least_ns, reason in (
            (slept, SLEPT_NS, "slept"),
            (stood_ns, STOOD_NS, "stood_still"),
        ):
            if pause_ns < least_ns:
                continue
            self.timeline.woke_ns = now_ns
            self._lines.paused(pause_ns, reason)
            for entry in self._registry:
                self._say(entry, pause_ns, reason)

    def _say(self, entry: ProbeEntry, step_ns: int, reason: str) -> None:
        t_ns, number = self.now_ns(), self.timeline.number
        about = {"step_ns": step_ns, "timeline": number, "reason": reason}
        self._publisher.say(entry, CLOCK, {"t_ns": t_ns, **about}, t_ns)
