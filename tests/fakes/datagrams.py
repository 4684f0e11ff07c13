# SPDX-License-Identifier: MIT
"""The probe's end of signed datagrams, written from docs/micropython.md."""

from __future__ import annotations

import hashlib
import hmac
import os
import socket
from dataclasses import dataclass, field

from fakes.port import PATIENCE_S

EACH_S = 0.2  # between two hellos; one that comes before the daemon listens is lost


def signed(key: bytes, content: bytes) -> bytes:
    return content + hmac.new(key, content, hashlib.sha256).digest()[:16]


@dataclass
class SignedProbe:
    """Makes and reads datagrams. No I/O."""

    probe_id: bytes
    key: bytes
    nonce: bytes = field(default_factory=lambda: os.urandom(16))
    session: bytes = b""
    counter: int = 0

    def hello(self) -> bytes:
        content = b"\x11" + self.probe_id + self.nonce + bytes(16)
        return signed(self.key, content)

    def heed(self, welcome: bytes) -> None:
        assert len(welcome) == 57
        assert welcome == signed(self.key, welcome[:-16])
        assert welcome[:25] == b"\x12" + self.probe_id + self.nonce
        material = b"imud" + welcome[1:41]
        self.session = hmac.new(self.key, material, hashlib.sha256).digest()

    def data(self, payload: bytes, counter: int | None = None) -> bytes:
        if counter is None:
            counter, self.counter = self.counter, self.counter + 1
        head = b"\x13" + self.probe_id + counter.to_bytes(4, "little")
        return signed(self.session, head + payload)

    def opened(self, datagram: bytes) -> tuple[int, bytes]:
        """Counter and payload."""
        assert datagram == signed(self.session, datagram[:-16])
        assert datagram[:9] == b"\x14" + self.probe_id
        return int.from_bytes(datagram[9:13], "little"), datagram[13:-16]


class UdpProbe:
    """A SignedProbe with a socket of its own."""

    def __init__(self, address: tuple[str, int], probe_id: bytes, key: bytes) -> None:
        self.signed = SignedProbe(probe_id, key)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(address)

    def close(self) -> None:
        self.socket.close()

    def greet(self) -> None:
        """Begins a session; tries again until the daemon listens."""
        self.signed = SignedProbe(self.signed.probe_id, self.signed.key)
        self.socket.settimeout(EACH_S)
        while True:
            try:
                self.socket.send(self.signed.hello())
                while True:
                    answer = self.socket.recv(2000)
                    if answer[:1] == b"\x12":
                        self.signed.heed(answer)
                        return
            except (TimeoutError, ConnectionRefusedError):
                continue
        raise AssertionError("no welcome came")

    def send(self, payload: bytes) -> bytes:
        """Sends a payload; returns its datagram."""
        datagram = self.signed.data(payload)
        self.socket.send(datagram)
        return datagram

    def receive(self) -> bytes:
        """The daemon's next datagram that is not empty."""
        self.socket.settimeout(PATIENCE_S)
        while True:
            _, payload = self.signed.opened(self.socket.recv(2000))
            if payload:
                return payload
