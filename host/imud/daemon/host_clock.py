# SPDX-License-Identifier: MIT
"""Follows UTC on this machine; a step of it is told in the journal and on `clock`."""

from __future__ import annotations

import time

from imud.daemon.host_sync import Sync, sync_of_host
from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import Registry
from imud.probes.timeline import Timeline, host_ns

CLOCK = "clock"  # topic of the records


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
        """Checks whether the host's clock was set. To be called before messages are
        dated.
        """
        before_ns, utc_ns = host_ns(), time.time_ns()
        before = self.timeline.number
        step_ns = self.timeline.follow(before_ns, utc_ns, host_ns())
        if step_ns == 0:
            return
        is_anew = self.timeline.number != before
        self._lines.clock_set(step_ns, is_anew=is_anew)
        t_ns = self.now_ns()
        for entry in self._registry:
            number = self.timeline.number
            values = {"t_ns": t_ns, "step_ns": step_ns, "timeline": number}
            self._publisher.say(entry, CLOCK, values, t_ns)
