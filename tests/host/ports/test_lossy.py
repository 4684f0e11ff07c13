# SPDX-License-Identifier: MIT
"""A probe's datagrams over a bad network, in simulated time: what is passed on is what
the probe sent, once and in order, and the rest is counted."""

from __future__ import annotations

import heapq
import random
from types import SimpleNamespace
from typing import Any

import pytest

from fakes import FakeProbe
from fakes.datagrams import SignedProbe
from imud.journal.output import Journal
from imud.ports.datagram import DatagramFault, Peer
from imud.ports.udp import UdpPort
from imud.probes.session import Probe, Received
from imud.probes.timeline import Timeline, host_ns
from imud.wire.frame import encode_frame

ID, KEY = bytes.fromhex("00000000000000a1"), bytes(range(32))
HERE = ("192.0.2.7", 5000)
MS = 1_000_000
END_MS, OUTAGE = 60_000, range(20_000, 30_000)
LOST, JITTER_MS = 0.2, 200
GREET_MS, GONE_MS = 1000, 3500  # as in the package's udp.py


class Air:
    """Both ends, and the network between them."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)  # noqa: S311 - a network, no secret
        self.start_ns = host_ns()
        self.probe, self.wire = FakeProbe(probe_id=ID), SignedProbe(ID, KEY)
        self.known = Probe(ID.hex())
        self.passed: list[bytes] = []
        receiver: Any = SimpleNamespace(
            timeline=Timeline(),
            **{"probe": lambda _id: self.known, "holder": lambda *_: None},
            **{"has_room": lambda _id: True, "follow_host": lambda _ns: None},
            **{"handle": self.handle, "port_ended": lambda *_: None},
        )
        self.port = UdpPort(Peer(ID, KEY), receiver, Journal(), self.answer)
        self.sent: set[bytes] = set()
        self.waiting: list[tuple[int, int, bytes]] = []
        self.old: list[bytes] = []
        self.refusals = self.now_ms = 0
        self.greeted_ms = -GREET_MS
        self.heard_ms = -GONE_MS - 1

    def handle(self, event: object, _port: object) -> None:
        if isinstance(event, Received):
            self.passed.append(event.content)

    def answer(self, datagram: bytes, _address: object) -> None:
        """The daemon's datagrams are lost as well."""
        if self.is_lost():
            return
        self.heard_ms = self.now_ms
        if datagram[0] == 0x12 and datagram[9:25] == self.wire.nonce:
            self.wire.heed(datagram)

    def is_lost(self) -> bool:
        return self.now_ms in OUTAGE or self.random.random() < LOST

    def send(self, datagram: bytes, times: int = 1) -> None:
        for _ in range(0 if self.is_lost() else times):
            due_ms = self.now_ms + self.random.randrange(JITTER_MS)
            heapq.heappush(
                self.waiting, (due_ms, self.random.getrandbits(60), datagram)
            )

    def say(self, name: str) -> None:
        self.probe.time_us = 1000 * self.now_ms
        content = self.probe.content(name)
        self.sent.add(content)
        if not self.wire.session:
            return  # it has nobody to send to: dropped, and counted by its number
        datagram = self.wire.data(encode_frame(content))
        self.old.append(datagram)
        self.send(datagram, self.random.choice((1, 1, 1, 2)))
        if self.random.random() < 0.1:  # an attacker's
            at = self.random.randrange(9, len(datagram))
            self.send(datagram[:at] + bytes((datagram[at] ^ 1,)) + datagram[at + 1 :])
            self.send(self.random.choice(self.old))

    def turn(self) -> None:
        """10 ms."""
        while self.waiting and self.waiting[0][0] <= self.now_ms:
            _, _, datagram = heapq.heappop(self.waiting)
            if datagram[0] == 0x11:
                welcome = self.port.peer.welcome(datagram, HERE)
                assert isinstance(welcome, bytes)
                self.answer(welcome, HERE)
                continue
            t_ns = self.start_ns + self.now_ms * MS
            self.refusals += self.port.receive(datagram, HERE, t_ns) is not None
        is_gone = self.now_ms - self.heard_ms > GONE_MS
        if is_gone and self.now_ms - self.greeted_ms >= GREET_MS:
            self.greeted_ms = self.now_ms
            self.wire = SignedProbe(ID, KEY)
            self.send(self.wire.hello())
        self.say("pose")
        if self.now_ms % 1000 == 0:
            self.say("hello")
            self.port.check(self.start_ns + self.now_ms * MS)
        self.now_ms += 10


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_skewed_or_doubled_is_passed_on_and_the_lost_are_counted(
    seed: int,
) -> None:
    air = Air(seed)
    while air.now_ms < END_MS:
        air.turn()
    air.port.end()
    counts: Any = air.known.account.counts()
    numbers = [int.from_bytes(content[1:5], "little") for content in air.passed]
    assert set(air.passed) <= air.sent
    assert numbers == sorted(set(numbers))  # once, and in order
    assert len(numbers) == counts["received"] > 1000
    skewed = sum(counts["skewed"].values())
    assert counts["boots"] == 1
    assert counts["sent"] == counts["received"] + skewed + counts["lost"]
    # All but those before the first that came and after the last.
    assert len(air.sent) - 500 < counts["sent"] <= len(air.sent)
    assert counts["lost"] > LOST * counts["sent"]
    assert sum(air.port.refused.values()) == air.refusals > 100
    assert {DatagramFault.BAD_SIGNATURE, DatagramFault.REPLAYED} <= {*air.port.refused}
    assert air.port.peer.sessions > 1
