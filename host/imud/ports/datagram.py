# SPDX-License-Identifier: MIT
"""Signed datagrams between a probe and the daemon; docs/micropython.md has their
layout and what they protect from. No I/O.

Both ends know a key. A hello of the probe and a welcome of the daemon carry a random
number each, from which both derive the key of a session. Every datagram has a signature
and, within a session, a counter.
"""

from __future__ import annotations

import hmac
import os
import struct
from collections.abc import Callable
from enum import StrEnum

HELLO, WELCOME, FROM_PROBE, TO_PROBE = 0x11, 0x12, 0x13, 0x14

# Ethernet's 1500 bytes less the headers of IPv4 and UDP: no datagram is fragmented.
DATAGRAM_MAX = 1472
NONCE_SIZE = 16
SIGNATURE_SIZE = 16  # of the 32 bytes of HMAC-SHA256; RFC 2104 allows half

_PURPOSE = b"imud"
_ADDRESSED = struct.Struct("<B8s")
_GREETING = struct.Struct("<B8s16s16s")
_DATA = struct.Struct("<B8sI")

# Counters older than the highest by this are refused: a network that reorders does so
# by a few datagrams.
WINDOW = 64

# Greetings of one probe that no datagram has confirmed.
GREETED_MAX = 4

Address = tuple[str, int]


class DatagramFault(StrEnum):
    """Why a datagram is refused."""

    MALFORMED = "malformed"
    OVERSIZED = "oversized"
    UNKNOWN_KEY = "unknown_key"  # of a probe without a key here
    BAD_SIGNATURE = "bad_signature"
    NO_SESSION = "no_session"  # from an address that has not greeted
    REPLAYED = "replayed"  # or later than the window


def addressed(datagram: bytes) -> tuple[int, bytes] | DatagramFault:
    """Kind and probe of a datagram, neither of them proven."""
    if len(datagram) > DATAGRAM_MAX:
        return DatagramFault.OVERSIZED
    if len(datagram) < _ADDRESSED.size + SIGNATURE_SIZE:
        return DatagramFault.MALFORMED
    kind, probe_id = _ADDRESSED.unpack_from(datagram)
    return kind, bytes(probe_id)


def sign(key: bytes, content: bytes) -> bytes:
    return content + hmac.digest(key, content, "sha256")[:SIGNATURE_SIZE]


def _checked(key: bytes, datagram: bytes) -> bytes | None:
    """The content of a datagram whose signature is right."""
    content, signature = datagram[:-SIGNATURE_SIZE], datagram[-SIGNATURE_SIZE:]
    right = hmac.digest(key, content, "sha256")[:SIGNATURE_SIZE]
    return content if hmac.compare_digest(signature, right) else None


class Window:
    """The counters of a session that were taken."""

    def __init__(self) -> None:
        self.highest = -1
        self._taken = 0  # bit n: highest - n

    def accept(self, counter: int) -> bool:
        """False where it was taken before, or is too old to know."""
        ahead = counter - self.highest
        if ahead > 0:
            self._taken = (self._taken << min(ahead, WINDOW) | 1) & ((1 << WINDOW) - 1)
            self.highest = counter
            return True
        bit = 1 << -ahead
        if -ahead >= WINDOW or self._taken & bit:
            return False
        self._taken |= bit
        return True


class Channel:
    """One session, as the end sees it that opens datagrams of kind `opens`."""

    def __init__(
        self,
        key: bytes,
        probe_id: bytes,
        nonces: bytes,
        *,
        opens: int = FROM_PROBE,
        seals: int = TO_PROBE,
    ) -> None:
        self._key = hmac.digest(key, _PURPOSE + probe_id + nonces, "sha256")
        self._probe_id = probe_id
        self._opens = opens
        self._seals = seals
        self._window = Window()
        self._next = 0

    def open(self, datagram: bytes) -> bytes | DatagramFault:
        """The payload; each is given once."""
        content = _checked(self._key, datagram)
        if content is None:
            return DatagramFault.BAD_SIGNATURE
        if len(content) < _DATA.size:
            return DatagramFault.MALFORMED
        kind, _, counter = _DATA.unpack_from(content)
        if kind != self._opens:
            return DatagramFault.MALFORMED
        if not self._window.accept(counter):
            return DatagramFault.REPLAYED
        return content[_DATA.size :]

    def seal(self, payload: bytes) -> bytes:
        """A datagram, one of 2^32: the daemon seals one a second, and commands."""
        head = _DATA.pack(self._seals, self._probe_id, self._next)
        self._next += 1
        return sign(self._key, head + payload)


class Peer:
    """A probe whose key the daemon has."""

    def __init__(
        self,
        probe_id: bytes,
        key: bytes,
        random: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.probe_id = probe_id
        self.key = key
        self._random = random
        self._greeted: list[tuple[Address, Channel]] = []
        self.channel: Channel | None = None
        self.address: Address | None = None  # of the session
        self.sessions = 0

    def welcome(self, datagram: bytes, address: Address) -> bytes | DatagramFault:
        """The answer to a hello. A hello that was recorded gets one, too: it changes
        nothing until a datagram of that session comes.
        """
        content = _checked(self.key, datagram)
        if content is None:
            return DatagramFault.BAD_SIGNATURE
        if len(content) != _GREETING.size:
            return DatagramFault.MALFORMED
        _, _, theirs, _ = _GREETING.unpack(content)
        ours = self._random(NONCE_SIZE)
        channel = Channel(self.key, self.probe_id, theirs + ours)
        self._greeted = [*self._greeted, (address, channel)][-GREETED_MAX:]
        answer = _GREETING.pack(WELCOME, self.probe_id, theirs, ours)
        return sign(self.key, answer)

    def open(self, datagram: bytes, address: Address) -> bytes | DatagramFault:
        """The payload of a datagram. The first of a session begins it and ends the one
        before.
        """
        found: bytes | DatagramFault = DatagramFault.NO_SESSION
        if self.channel is not None and address == self.address:
            found = self.channel.open(datagram)
            if found is not DatagramFault.BAD_SIGNATURE:
                return found
        for where, channel in self._greeted:
            if where != address:
                continue
            found = channel.open(datagram)
            if not isinstance(found, DatagramFault):
                self.channel, self.address = channel, address
                self._greeted.clear()
                self.sessions += 1
                return found
        return found
