# SPDX-License-Identifier: MIT
"""Limits the connections per second of a server. A client that exceeds it is refused
before anything is read: a flood then costs little, and the probes nothing.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

from imud.endpoint import network_of

Known = TypeVar("Known")

ADDRESSES_MAX = 4096

# Limit of all addresses together, as a multiple of that of one.
ALL = 4

# Taken or refused in a row, before what else the loop has to do: it would take all that
# wait at once, and 100 take some 10 ms.
IN_A_ROW = 4

# Closes at once: the system need not remember the connection.
_NO_LINGER = struct.pack("ii", 1, 0)


@dataclass(frozen=True, slots=True)
class Rate:
    """`at_once` connections, then `a_second` per second."""

    at_once: int
    a_second: float


class Bucket:
    """A token bucket: fills with time up to a rate's `at_once`."""

    __slots__ = ("_at_s", "_left", "_rate")

    def __init__(self, rate: Rate) -> None:
        self._rate = rate
        self._left = float(rate.at_once)
        self._at_s = 0.0

    def has(self, now_s: float) -> bool:
        """Whether a connection may be taken at that time, which never goes back."""
        fresh = (now_s - self._at_s) * self._rate.a_second
        self._left = min(self._left + fresh, float(self._rate.at_once))
        self._at_s = now_s
        return self._left >= 1.0

    def take(self) -> None:
        self._left -= 1.0


class ByNetwork(Generic[Known]):
    """The state of clients, by network; of the last ADDRESSES_MAX."""

    def __init__(self, make: Callable[[], Known]) -> None:
        """`make`: creates the state of a new client."""
        self._make = make
        self._known: OrderedDict[str, Known] = OrderedDict()

    def __len__(self) -> int:
        return len(self._known)

    def of(self, host: str) -> Known:
        name = network_of(host)
        if name not in self._known:
            while len(self._known) >= ADDRESSES_MAX:
                self._known.popitem(last=False)
            self._known[name] = self._make()
        self._known.move_to_end(name)
        return self._known[name]


class Throttle:
    """The buckets of one server: one for each address, one for all of them."""

    def __init__(self, rate: Rate, on_refused: Callable[[str], None]) -> None:
        """`on_refused` gets the peer, as 192.0.2.1:5000, of each that is refused."""
        self.on_refused = on_refused
        self._all = Bucket(Rate(rate.at_once * ALL, rate.a_second * ALL))
        self._each = ByNetwork(partial(Bucket, rate))

    def admits(self, host: str, now_s: float) -> bool:
        bucket = self._each.of(host)
        if not (bucket.has(now_s) and self._all.has(now_s)):
            return False
        bucket.take()
        self._all.take()
        return True


class ThrottledSocket(socket.socket):
    """A socket that listens, and whose accept() leaves out what its throttle refuses.

    asyncio's selector loops call accept(); Windows' other loop does not, and takes all.
    """

    throttle: Throttle | None = None
    _in_a_row = 0

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        """The next connection that the throttle admits; the others are closed and told.
        BlockingIOError after IN_A_ROW, or if none waits.
        """
        while True:
            self._in_a_row += 1
            if self._in_a_row > IN_A_ROW:
                self._in_a_row = 0
                raise BlockingIOError
            try:
                taken, peer = super().accept()
            except OSError:
                self._in_a_row = 0
                raise
            throttle = self.throttle
            if throttle is None or throttle.admits(peer[0], time.monotonic()):
                return taken, peer
            throttle.on_refused(f"{peer[0]}:{peer[1]}")  # first: who is refused can ask
            with contextlib.suppress(OSError):
                taken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            taken.close()
