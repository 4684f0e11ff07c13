# SPDX-License-Identifier: MIT
"""One probe that sends signed datagrams: a port of the daemon without a device."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from imud.errors import PortLost
from imud.journal.output import Journal
from imud.journal.phrases import port_problem
from imud.ports.datagram import Address, DatagramFault, Peer
from imud.ports.listener import Claim, Listener
from imud.probes.session import (
    Event,
    OnlyNoise,
    OtherSchema,
    Probe,
    Session,
    Silent,
)
from imud.probes.timeline import host_ns

# A probe that was silent for so long has no port any longer.
LOST_NS = 10_000_000_000


class DatagramSession(Session):
    """A session whose counts include those of its datagrams."""

    def __init__(self, port: UdpPort, probes: Listener) -> None:
        super().__init__(port.find, host_ns(), timeline=probes.timeline)
        self._port = port

    def counts(self) -> dict[str, Any]:
        port = self._port
        datagrams = {
            "received": port.received,
            "refused": {str(fault): port.refused[fault] for fault in DatagramFault},
            "sessions": port.peer.sessions,
        }
        return super().counts() | {"datagrams": datagrams}


class UdpPort:
    """A port without a baud rate; its session is one of the signed ones."""

    baud = 0

    def __init__(
        self,
        peer: Peer,
        probes: Listener,
        journal: Journal,
        send: Callable[[bytes, Address], None],
    ) -> None:
        self.peer = peer
        self.name = f"udp of {peer.probe_id.hex()}"
        self._probes = probes
        self._journal = journal
        self._send = send
        self._claim = Claim(probes, self)
        self._sessions = 0  # of the peer, when this session began
        self._heard_ns = 0
        self.session: Session | None = None
        self.received = 0
        self.refused: Counter[DatagramFault] = Counter()

    def write(self, data: bytes) -> None:
        """Sends bytes to the probe; PortLost if it is not there."""
        session = self.session
        is_here = session is not None and session.probe is not None
        if not is_here or self.peer.probe_id.hex() not in self._claim:
            raise PortLost(f"{self.name}: no hello from the probe yet; wait for it")
        self._seal(data)

    def receive(
        self, datagram: bytes, address: Address, t_ns: int
    ) -> DatagramFault | None:
        """A datagram of the probe, or one that claims to be."""
        payload = self.peer.open(datagram, address)
        if isinstance(payload, DatagramFault):
            self.refused[payload] += 1
            return payload
        self.received += 1
        self._heard_ns = t_ns
        if self.peer.sessions != self._sessions:
            self.end()
            self._sessions = self.peer.sessions
        if self.session is None:
            self._begin(address)
        self._probes.follow_host(t_ns)
        if self.session is not None and payload:
            self._tell(self.session.receive(payload, t_ns))
        return None

    def check(self, t_ns: int) -> None:
        """Called once a second with the host's time. The probe hears that its session
        lives; silence ends it.
        """
        if self.session is None:
            return
        if t_ns - self._heard_ns > LOST_NS:
            self.end()
            return
        self._seal(b"")
        probe = self.session.probe
        is_other = probe is not None and probe.probe_id not in self._claim
        if is_other and not self._claim.is_held(self.peer.probe_id.hex(), t_ns):
            self.listen_again()
            return
        self._tell(self.session.check(t_ns))

    def listen_again(self) -> None:
        """Begins to listen as if the probe had just come."""
        self.end()

    def end(self) -> None:
        session, self.session = self.session, None
        if session is None:
            return
        self._tell(session.close())
        self._probes.port_ended(session, self)
        self._claim.clear()

    def find(self, probe_id: str) -> Probe:
        """The probe of the key; a stand-in for any other that speaks with that key."""
        if probe_id == self.peer.probe_id.hex():
            return self._claim.find(probe_id)
        text = f"{self.name}: a probe claims to be {probe_id}, with the key of another"
        self._journal.write(("udp", self.name, "other"), text, is_warning=True)
        return Probe(probe_id)

    def _begin(self, address: Address) -> None:
        self.name = f"udp:{address[0]}:{address[1]}"
        self.session = DatagramSession(self, self._probes)
        # Datagrams hold whole frames: the first one is no rest of another.
        self.session.receive(b"\0", self._heard_ns)

    def _seal(self, data: bytes) -> None:
        channel, address = self.peer.channel, self.peer.address
        if channel is not None and address is not None:
            self._send(channel.seal(data), address)

    def _tell(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, OnlyNoise | Silent):
                text = port_problem(self.name, event, ())
                kind = ("problem", self.name, type(event))
                self._journal.write(kind, text, is_warning=True)
            elif event.probe_id != self.peer.probe_id.hex():
                continue  # told by find()
            elif isinstance(event, OtherSchema):
                if self._probes.has_room(event.probe_id):
                    self._probes.handle_other(event, self)
            elif event.probe_id in self._claim:
                self._probes.handle(event, self)
