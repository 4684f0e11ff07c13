# SPDX-License-Identifier: MIT
"""Whether records are logged; each change is told on the topic `log`."""

from __future__ import annotations

import msgspec

from imud.daemon.hub import Hub
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry, Registry

LOG = "log"  # name of the sink, and topic of the records


class LogState(msgspec.Struct, frozen=True):
    """Whether there is a log: on, paused or off; and why it pauses. `files` and
    `bytes`: of all logs that are kept, None: nothing says how many are to be.
    """

    state: str
    reason: str | None = None
    files: int | None = None
    bytes: int | None = None


class LogWatch:
    """Follows how the sink of the log does."""

    def __init__(
        self, registry: Registry, hub: Hub, publisher: RecordPublisher, *, is_on: bool
    ) -> None:
        self._registry = registry
        self._hub = hub
        self._publisher = publisher
        self._state = LogState("on" if is_on else "off")

    def state_of(self, entry: ProbeEntry) -> LogState:
        """For the status of a probe; one can be left out of the log."""
        return self._state if entry.is_logged else LogState("off")

    def follow(self, t_ns: int) -> None:
        """Once a second, at `t_ns` UTC. The journal has the reason from the lane."""
        reason = self._hub.trouble(LOG)
        state = "off" if reason is None else "paused" if reason else "on"
        kept = getattr(self._hub.sink(LOG), "kept", None)
        size = (None, None) if kept is None else (kept.files, kept.bytes)
        before, self._state = self._state, LogState(state, reason or None, *size)
        if state == before.state:
            return
        for entry in self._registry:
            if entry.is_logged:
                values = {"t_ns": t_ns, "state": state, "reason": self._state.reason}
                values["dropped"] = self._hub.dropped(entry.name).get(LOG, 0)
                self._publisher.say(entry, LOG, values, t_ns)
