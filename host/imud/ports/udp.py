# SPDX-License-Identifier: MIT
"""Probes that send signed datagrams: one socket, and a port for each probe with a key.

What is refused is counted and never answered; docs/micropython.md says why.
"""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

from imud.config.settings import PortSettings
from imud.endpoint import host_and_port
from imud.errors import ConfigError, PortLost
from imud.journal.output import Journal
from imud.journal.phrases import port_problem
from imud.net import probe_keys
from imud.ports.datagram import (
    DATAGRAM_MAX,
    HELLO,
    Address,
    DatagramFault,
    Peer,
    addressed,
)
from imud.ports.receiver import Claim, EventReceiver
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

    def __init__(self, port: UdpPort, probes: EventReceiver) -> None:
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
        probes: EventReceiver,
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
        self._probes.follow_host(t_ns)
        self._heard_ns = t_ns
        if self.peer.sessions != self._sessions:
            self.end()
            self._sessions = self.peer.sessions
        if self.session is None:
            self._begin(address)
        if self.session is not None and payload:
            self._tell(self.session.receive(payload, t_ns))
        return None

    def check(self, t_ns: int) -> None:
        """Called once a second with the host's time. The probe hears that its session
        lives; silence ends it.
        """
        if self.session is None:
            return
        if self._probes.timeline.silence(self._heard_ns, t_ns) > LOST_NS:
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


# Datagrams read in one turn of the loop: a flood of them must not stop other ports.
BATCH = 64

# For half a second of 64 probes; Linux may grant less (net.core.rmem_max).
BUFFER_BYTES = 1 << 20

# When the folder of the keys has changed, in ns, and which it is.
KeysState = tuple[int, str]
NO_KEYS: KeysState = (-1, "")


class UdpPorts:
    """The socket, if the settings ask for one, and the ports of its probes."""

    def __init__(self, probes: EventReceiver, journal: Journal) -> None:
        self._probes = probes
        self._journal = journal
        self._socket: socket.socket | None = None
        self._listens = ""  # the setting that the socket has
        self._fault = ""  # the last one told
        self._keys_state = NO_KEYS
        self._ports: dict[bytes, UdpPort] = {}
        self.refused: Counter[DatagramFault] = Counter()

    def __iter__(self) -> Iterator[UdpPort]:
        return iter(self._ports.values())

    async def serve(self, settings: PortSettings, waiter: Executor) -> None:
        """Does what the settings say; called about once a second. A key that was made
        or deleted counts at once. Disks and look-ups of names wait in `waiter`.
        """
        if settings.udp != self._listens:
            self.close()
        if not settings.udp:
            return
        in_thread = partial(asyncio.get_running_loop().run_in_executor, waiter)
        try:
            folder = Path(settings.udp_keys)
            state, keys = await in_thread(_read_keys, folder, self._keys_state)
            if keys is not None:
                self._keys_state = state
                self._use(keys)
            if self._socket is None:
                self._listen(await in_thread(_opened, settings.udp), settings.udp)
        except (ConfigError, OSError) as error:
            why = getattr(error, "strerror", None) or error
            text = f"udp {settings.udp}: {why}"
            if text != self._fault:
                self._journal.write(("udp", "fault"), text, is_warning=True)
            self._fault = text
        else:
            self._fault = ""

    def check(self, t_ns: int) -> None:
        """Called once a second with the host's time."""
        for port in self:
            port.check(t_ns)

    def close(self) -> None:
        """Ends all ports, and closes the socket."""
        for port in self:
            port.end()
        self._ports.clear()
        self._keys_state = NO_KEYS
        self._listens = ""
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
        self._socket = None

    def _listen(self, opened: socket.socket | None, listen: str) -> None:
        if opened is None:
            return  # refused by the rules of the settings
        self._socket, self._listens = opened, listen
        asyncio.get_running_loop().add_reader(opened, self._read)
        host, port = opened.getsockname()[:2]
        count = len(self._ports)
        probes = "1 probe" if count == 1 else f"{count} probes"
        text = f"udp {host}:{port}: open to {probes} with a key"
        self._journal.write(("udp", "open"), text)

    def _use(self, keys: Mapping[bytes, bytes]) -> None:
        for probe_id, port in list(self._ports.items()):
            if keys.get(probe_id) != port.peer.key:
                port.end()
                del self._ports[probe_id]
        for probe_id, key in keys.items():
            if probe_id not in self._ports:
                peer = Peer(probe_id, key)
                port = UdpPort(peer, self._probes, self._journal, self._send)
                self._ports[probe_id] = port

    def _send(self, datagram: bytes, address: Address) -> None:
        """As far as the network takes it: the other end asks again."""
        if self._socket is None:
            return
        try:
            self._socket.sendto(datagram, address)
        except OSError as error:
            text = f"udp: can't send to {address[0]}: {error.strerror}"
            self._journal.write(("udp", "send"), text, is_warning=True)

    def _read(self) -> None:
        for _ in range(BATCH):
            if self._socket is None:
                return
            try:
                datagram, address = self._socket.recvfrom(DATAGRAM_MAX + 1)
            except OSError:  # no more, or a probe's machine refused what was sent
                return
            fault = self._receive(datagram, address[:2], host_ns())
            if fault is not None:
                self._refuse(fault, address)

    def _receive(
        self, datagram: bytes, address: Address, t_ns: int
    ) -> DatagramFault | None:
        found = addressed(datagram)
        if isinstance(found, DatagramFault):
            return found
        kind, probe_id = found
        port = self._ports.get(probe_id)
        if port is None:
            return DatagramFault.UNKNOWN_KEY
        if kind != HELLO:
            return port.receive(datagram, address, t_ns)
        answer = port.peer.welcome(datagram, address)
        if isinstance(answer, DatagramFault):
            port.refused[answer] += 1
            return answer
        self._send(answer, address)
        return None

    def _refuse(self, fault: DatagramFault, address: Address) -> None:
        self.refused[fault] += 1
        text = (
            f"udp: datagrams refused: {self.refused[fault]} "
            f"{fault.replace('_', ' ')}, the last from {address[0]}"
        )
        self._journal.write(("udp", fault), text, is_warning=True, is_total=True)


def _read_keys(
    folder: Path, before: KeysState
) -> tuple[KeysState, Mapping[bytes, bytes] | None]:
    """Reads the keys; None if they are the ones before."""
    place = folder / probe_keys.PROBES
    try:
        state = place.stat().st_mtime_ns, str(place)
    except OSError:
        state = (-1, str(place))
    if state == before and state[0] >= 0:
        return state, None
    return state, probe_keys.read(folder)


def _opened(listen: str) -> socket.socket | None:
    """A socket at that address; None: it is none."""
    address = host_and_port(listen)
    if address is None:
        return None
    family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_DGRAM)
    try:
        opened.setblocking(False)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        opened.bind(address)
    except OSError:
        opened.close()
        raise
    return opened
