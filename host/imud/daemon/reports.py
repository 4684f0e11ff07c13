# SPDX-License-Identifier: MIT
"""Reports about each probe once a second: its status, and its losses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from imud.daemon.host_clock import HostClock
from imud.daemon.hub import Hub
from imud.daemon.lines import ProbeLines
from imud.daemon.log_state import LOG, LogWatch
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry, Registry
from imud.daemon.status import Delivered, status_of
from imud.probes.ledger import totals
from imud.probes.timeline import host_ns

NETWORK = "zenoh"  # name of the sink


class Reports:
    """Publishes the status of each probe and tells its losses."""

    def __init__(
        self,
        registry: Registry,
        hub: Hub,
        publisher: RecordPublisher,
        lines: ProbeLines,
        clock: HostClock,
        log: LogWatch,
    ) -> None:
        self._registry = registry
        self._hub = hub
        self._publisher = publisher
        self._lines = lines
        self._clock = clock
        self._log = log
        self.on_forgotten: Callable[[str], None] = lambda _: None  # gets its id
        self.on_status: Callable[[Mapping[str, Any]], None] = lambda _: None

    def tick(self, elapsed_s: float) -> Iterator[None]:
        """Once a second: rates, the status of each probe, what was lost. A step takes
        about a millisecond, between which others may do something.
        """
        self._clock.follow()
        self._clock.look()
        self._log.follow(self._clock.now_ns())
        for entry in self._registry:
            poses = entry.poses - entry.poses_before
            entry.poses_before = entry.poses
            entry.pose_rate_hz = poses / elapsed_s
            self.publish(entry)
            if poses > 0:
                self._lines.withheld(entry)
            self._report_losses(entry)
            yield

    def announce(self) -> None:
        """Says who is there, for sinks that have just been opened."""
        for entry in self._registry:
            self.publish(entry)
            self._publisher.announce(entry)

    def publish(self, entry: ProbeEntry) -> None:
        """The status of one probe, as it is now."""
        name, hub = entry.name, self._hub
        delivered = Delivered(
            hub.counts(name),
            hub.taken(name, NETWORK),
            hub.taken(name, LOG) if entry.is_logged else {},
            self._log.state_of(entry),
        )
        clock = self._clock
        status = status_of(entry, delivered, clock.timeline, clock.sync, host_ns())
        params, sensors = status["params"], status["sensors"]
        entry.host_flags = (*params.get("flags", ()), *sensors["flags"])
        if sensors["is_working"]:
            self._lines.calibration(entry, params.get("advice"))
        values = self._publisher.say(entry, "status", status, status["t_ns"])
        self.on_status(values)

    def _report_losses(self, entry: ProbeEntry) -> None:
        total = totals(entry.probe.account.counts())
        dropped = sum(self._hub.dropped(entry.name).values())
        counts = (total.lost, entry.corrupt, total.duplicated, dropped)
        self._lines.losses(entry, counts)
