# SPDX-License-Identifier: MIT
"""The guard's knowledge of a client: its address, and the TLS records that it sends."""

from __future__ import annotations

from dataclasses import dataclass, field

# After this many consecutive failures an address waits, each time twice as long; less,
# if a client there once completed a handshake.
FAILURES = 5
WAIT_S, WAIT_MAX_S, WAIT_KNOWN_S = 0.5, 30.0, 1.0
# Records of TLS (RFC 8446, 5.1): a handshake, and what is sent after its end.
HANDSHAKE, DATA = 22, 23
RECORD_HEAD = 5
RECORD_MAX = 16384


@dataclass(slots=True)
class Address:
    """The state of clients from an address, or from a /64 of IPv6."""

    unfinished: int = 0
    failures: int = 0  # in a row
    until_s: float = 0.0  # refused until then
    is_known: bool = False  # a client there has completed a handshake

    def fail(self, now_s: float) -> None:
        self.failures += 1
        if self.failures >= FAILURES:
            wait_s = WAIT_S * 2 ** min(self.failures - FAILURES, 10)
            most_s = WAIT_KNOWN_S if self.is_known else WAIT_MAX_S
            self.until_s = now_s + min(wait_s, most_s)

    def succeed(self) -> None:
        self.is_known, self.failures, self.until_s = True, 0, 0.0


@dataclass(slots=True)
class Records:
    """Follows the heads of TLS records in a stream; keeps none of it."""

    skip: int = 0  # bytes of the record that is passing
    head: bytes = b""
    seen: set[int] = field(default_factory=set)
    whole: int = 0  # records

    def feed(self, data: bytes) -> bool:
        """False: it is no TLS."""
        at = 0
        while at < len(data):
            if self.skip:
                taken = min(self.skip, len(data) - at)
                self.skip -= taken
                at += taken
                self.whole += not self.skip
                continue
            taken = RECORD_HEAD - len(self.head)
            self.head += data[at : at + taken]
            at += taken
            if self.head[0] not in (20, 21, HANDSHAKE, DATA):
                return False
            if len(self.head) == RECORD_HEAD:
                self.seen.add(self.head[0])
                self.skip = int.from_bytes(self.head[3:], "big")
                if not 0 < self.skip <= RECORD_MAX + 2048:
                    return False
                self.head = b""
        return True
