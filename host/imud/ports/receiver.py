# SPDX-License-Identifier: MIT
"""The receiver of what ports hear, and which probes a port may speak for."""

from __future__ import annotations

from typing import Any, Protocol

from imud.probes.session import Event, OtherSchema, Probe, Session
from imud.probes.timeline import Timeline, host_ns

# A probe sends a hello every second: one that was silent for so long is gone from its
# port.
GONE_NS = 3_000_000_000


class EventReceiver(Protocol):
    """The interface that ports use: questions about their probes, and the receiver of
    events."""

    @property
    def timeline(self) -> Timeline: ...
    def probe(self, probe_id: str) -> Probe: ...
    def holder(self, probe_id: str, port: Any, since_ns: int) -> Any: ...
    def has_room(self, probe_id: str) -> bool: ...
    def missing(self) -> list[str]: ...
    def on_double(self, probe_id: str, holder: Any, port: Any) -> None: ...
    def follow_host(self, read_ns: int) -> None: ...
    def handle(self, event: Event, port: Any) -> None: ...
    def handle_other(self, event: OtherSchema, port: Any) -> None: ...
    def port_ended(self, session: Session, port: Any) -> None: ...


class Claim:
    """Which probes a port speaks for. One that speaks on another port, or is one too
    many, is ignored on this port.
    """

    def __init__(self, probes: EventReceiver, port: Any) -> None:
        self._probes = probes
        self._port = port
        self._left_out: set[str] = set()  # ids that are heard here and ignored

    def __contains__(self, probe_id: str) -> bool:
        return probe_id not in self._left_out

    def clear(self) -> None:
        self._left_out.clear()

    def is_held(self, probe_id: str, t_ns: int) -> bool:
        """Whether that probe speaks on another port (host's time)."""
        since_ns = self._probes.timeline.since(t_ns, GONE_NS)
        return self._probes.holder(probe_id, self._port, since_ns) is not None

    def find(self, probe_id: str) -> Probe:
        """The probe, or a stand-in for one that is ignored on this port."""
        since_ns = self._probes.timeline.since(host_ns(), GONE_NS)
        holder = self._probes.holder(probe_id, self._port, since_ns)
        if not self._probes.has_room(probe_id):
            self._left_out.add(probe_id)
            return Probe(probe_id)
        if holder is None:
            before = self._probes.holder(probe_id, self._port, 0)
            if before is not None:
                before.listen_again()
            self._left_out.discard(probe_id)
            return self._probes.probe(probe_id)
        self._left_out.add(probe_id)
        self._probes.on_double(probe_id, holder, self._port)
        return Probe(probe_id)
