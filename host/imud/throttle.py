# SPDX-License-Identifier: MIT
"""How many connections a second a server takes. Whoever asks more often is refused
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

from imud.endpoint import network_of

ADDRESSES_MAX = 4096

# All addresses together may have so many times what one may.
ALL = 4

# Taken or refused in a row, before what else the loop has to do: it would take all that
# wait at once, and 100 take some 10 ms.
IN_A_ROW = 4

# Closes at once: the system need not remember the connection.
_NO_LINGER = struct.pack("ii", 1, 0)


@dataclass(frozen=True, slots=True)
class Rate:
    """So many connections at once, then so many a second."""

    at_once: int
    a_second: float


class Bucket:
    """A token bucket: fills with time up to a rate's `at_once`."""

    __slots__ = ("_at_s", "_left", "_rate")

    def __init__(self, rate: Rate, now_s: float) -> None:
        self._rate = rate
        self._left = float(rate.at_once)
        self._at_s = now_s

    def has(self, now_s: float) -> bool:
        """Whether a connection may be taken at that time, which never goes back."""
        fresh = (now_s - self._at_s) * self._rate.a_second
        self._left = min(self._left + fresh, float(self._rate.at_once))
        self._at_s = now_s
        return self._left >= 1.0

    def take(self) -> None:
        self._left -= 1.0


class Throttle:
    """The buckets of one server: one for each address, one for all of them."""

    def __init__(self, rate: Rate, on_refused: Callable[[str], None]) -> None:
        """`on_refused` gets the peer, as 192.0.2.1:5000, of each that is refused."""
        self.on_refused = on_refused
        self._rate = rate
        self._all = Bucket(Rate(rate.at_once * ALL, rate.a_second * ALL), 0.0)
        self._each: OrderedDict[str, Bucket] = OrderedDict()

    def admits(self, host: str, now_s: float) -> bool:
        name = network_of(host)
        bucket = self._each.get(name)
        if bucket is None:
            while len(self._each) >= ADDRESSES_MAX:
                self._each.popitem(last=False)
            bucket = self._each[name] = Bucket(self._rate, now_s)
        self._each.move_to_end(name)
        if not (bucket.has(now_s) and self._all.has(now_s)):
            return False
        bucket.take()
        self._all.take()
        return True


class Listening(socket.socket):
    """A socket that listens, and whose accept() leaves out what its throttle refuses.

    asyncio's selector loops call accept(); Windows' other loop does not, and takes all.
    """

    throttle: Throttle | None = None
    _in_a_row = 0

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
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
            with contextlib.suppress(OSError):
                taken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            taken.close()
            throttle.on_refused(f"{peer[0]}:{peer[1]}")
