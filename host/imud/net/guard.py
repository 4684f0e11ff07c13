# SPDX-License-Identifier: MIT
"""A guard in front of Zenoh's TLS port: who does not speak TLS, or does not continue,
never reaches it. Runs as a process of its own, which guard_process.py starts.

Zenoh waits 10 s for a handshake and pauses 100 ms after each that failed, so that 1,600
idle connections keep everybody out for minutes
(github.com/eclipse-zenoh/zenoh/issues/2685). Here a connection has to say a whole hello
of TLS first, then end its handshake; addresses that fail again and again wait longer
and longer; and few of them may be unfinished at a time. Nothing is decrypted.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import cast

from imud.machine import system
from imud.throttle import ByNetwork, Rate, Throttle, ThrottledSocket

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


# Connections of all addresses; of those, unfinished ones: of all, of one address.
LINKS_MAX = 512
UNFINISHED_MAX = 64  # Zenoh takes 100
UNFINISHED_OF_ONE = 16

# Until the hello is whole, and then until the handshake is over.
HELLO_S = 3.0
HANDSHAKE_S = 8.0

# A session is open once the parent says so, or at this age: Zenoh closes others after
# 10 s. A connection that ends before is a failure, unless that word comes so late.
OLD_S = 12.0
LATE_S = 2.0

# A refusal by TLS, as for an unknown certificate, is one alert: 24 bytes.
ALERT_MAX = 64

# Lines a second about refusals; the next one tells how many were left out.
LINES_MAX = 20

# A client that connects more often is refused before any state is kept for it: poses go
# through this process, too.
RATE = Rate(at_once=128, a_second=20.0)

# Lines to the parent: what, and whom it is about; and every BEAT_S that it still runs.
CAME, REFUSED, BEAT = "came", "refused", "beat"
BEAT_S = 0.5


class Guard:
    """All connections of the process."""

    def __init__(self, inner: tuple[str, int], tell: int) -> None:
        self.inner = inner
        self._tell = tell
        self.addresses = ByNetwork(Address)
        self.links: dict[Outer, None] = {}  # the oldest first
        self.unopened: dict[str, Outer] = {}  # by their own address at Zenoh
        self.unfinished = 0
        self._second = self._lines = self._untold = 0

    def refusal(self, address: Address, now_s: float) -> str:
        """Why another connection is refused; empty: it is not."""
        if now_s < address.until_s:
            return "too many failures"
        if address.unfinished >= UNFINISHED_OF_ONE:
            return "too many at once"
        if len(self.links) >= LINKS_MAX:
            return "the daemon has too many connections"
        if self.unfinished >= UNFINISHED_MAX:
            self._make_room(now_s)
        return ""

    def _make_room(self, now_s: float) -> None:
        """Ends the oldest handshake of the address that has most of them."""
        waiting = [each for each in self.links if each.is_waiting]
        # Of equal ones, max() takes the first.
        most = max(waiting, key=lambda each: each.address.unfinished, default=None)
        if most is not None:
            most.address.fail(now_s)
            most.refuse("too many at once")

    def refuse(self, now_s: float, peer: str, why: str) -> None:
        """Tells of a refusal, and how many there were since the last that was told."""
        self._untold += 1
        if int(now_s) != self._second:
            self._second, self._lines = int(now_s), 0
        if self._lines < LINES_MAX:
            self._lines += 1
            self.say(REFUSED, str(self._untold), peer, why)
            self._untold = 0

    def refuse_often(self, now: Callable[[], float], peer: str) -> None:
        self.refuse(now(), peer, "too often")

    def hear(self, data: bytes) -> None:
        """From the parent: whose sessions have begun."""
        for own in data.decode("ascii", "replace").split():
            if (outer := self.unopened.pop(own, None)) is not None:
                outer.finish()

    def say(self, what: str, *words: str) -> None:
        """To the parent. A line for which its pipe has no room is left out."""
        with contextlib.suppress(OSError):
            os.write(self._tell, f"{what} {' '.join(words)}\n".encode())


class Outer(asyncio.Protocol):
    """A connection from outside."""

    def __init__(self, guard: Guard) -> None:
        self._guard = guard
        self._loop = asyncio.get_running_loop()
        self._records = Records()
        self._hello = b""
        self._inner: Inner | None = None
        self._is_counted = self.is_finished = self._has_data = False
        self._is_greeted = False  # Zenoh has answered its hello
        self._answered = 0  # bytes of Zenoh to the client's data
        self._own = ""
        self._opening: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.is_over = False
        self.peer = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Refuses a client at one of the limits; else waits HELLO_S for its hello."""
        self.transport = cast(asyncio.Transport, transport)
        peer = transport.get_extra_info("peername") or ("?", 0)
        host, port = str(peer[0]), peer[1]
        self.peer = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self.address = self._guard.addresses.of(host)
        why = self._guard.refusal(self.address, self._loop.time())
        if why:
            self.refuse(why)
            return
        self._is_counted = True
        self._guard.links[self] = None
        self._guard.unfinished += 1
        self.address.unfinished += 1
        self._arm(HELLO_S, partial(self._fail, "no TLS hello in time"))

    def data_received(self, data: bytes) -> None:
        """Passes bytes on to Zenoh, from the first whole hello of TLS on; what is not
        TLS ends the connection.
        """
        if self.is_over:
            return
        if not self.is_finished:
            if not self._records.feed(data):
                self._refuse_early("it does not use TLS")
                return
            if DATA in self._records.seen and not self._is_greeted:
                self._refuse_early("it sends data before the handshake")
                return
            if DATA in self._records.seen and not self._has_data:
                self._has_data = True
                self._arm(OLD_S, self.finish)
        if self._inner is not None:
            self._inner.transport.write(data)
            return
        self._hello += data
        if len(self._hello) > 4 * RECORD_MAX:
            self._fail("its hello is too long")
        elif self._records.whole and self._opening is None:
            self._opening = self._loop.create_task(self._open())

    async def _open(self) -> None:
        """Connects to Zenoh, which is to know who it is."""
        inner = socket.socket()
        try:
            inner.setblocking(False)
            inner.bind(("127.0.0.1", 0))
            self._own = f"127.0.0.1:{inner.getsockname()[1]}"
            self._guard.unopened[self._own] = self
            self._guard.say(CAME, self._own, self.peer)
            await self._loop.sock_connect(inner, self._guard.inner)
            if self.is_over:
                inner.close()
                return
            _, self._inner = await self._loop.create_connection(
                lambda: Inner(self), sock=inner
            )
        except OSError as error:
            inner.close()
            self._fail(error.strerror or "the daemon does not accept connections")
            return
        if self.is_over:
            self._inner.transport.abort()
            return
        self._inner.transport.write(self._hello)
        self._hello = b""
        if not self._has_data:
            self._arm(HANDSHAKE_S, partial(self._fail, "no handshake in time"))

    def _arm(self, seconds: float, then: Callable[[], None]) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_later(seconds, then)

    @property
    def is_waiting(self) -> bool:
        """Whether it is connected and has no session."""
        return not (self.is_finished or self.is_over)

    def finish(self) -> None:
        """Its session has begun."""
        if self.is_finished:
            return
        self.is_finished = True
        self.address.succeed()
        if self in self._guard.links:
            self._leave_unfinished()

    def _leave_unfinished(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._guard.unfinished -= 1
        self.address.unfinished -= 1

    def refuse(self, why: str) -> None:
        self.is_over = True
        self._guard.refuse(self._loop.time(), self.peer, why)
        self.transport.abort()

    def answer(self, data: bytes) -> None:
        """What Zenoh sends."""
        self._is_greeted = True
        self.transport.write(data)
        if self._has_data:
            self._answered += len(data)

    def end(self) -> None:
        """Zenoh has closed it, and reports a wrong password itself."""
        if not (self.is_over or self.is_finished or self._answered > ALERT_MAX):
            self.address.fail(self._loop.time())
            self._guard.refuse(self._loop.time(), self.peer, "its handshake failed")
            self.is_over = True
        self.transport.close()

    def _judge(self) -> None:
        """It has ended; nothing more will be heard of it."""
        self._guard.unopened.pop(self._own, None)
        if not self.is_finished:
            self.address.fail(self._loop.time())

    def _refuse_early(self, why: str) -> None:
        """It is no failure of its address if it never reached Zenoh: others may share
        that address, and it has cost nothing.
        """
        if self._opening is None:
            self.refuse(why)
        else:
            self._fail(why)

    def _fail(self, why: str) -> None:
        if not self.is_over:
            self.address.fail(self._loop.time())
            self.refuse(why)

    def pause_writing(self) -> None:
        if self._inner is not None:
            self._inner.transport.pause_reading()

    def resume_writing(self) -> None:
        if self._inner is not None:
            with contextlib.suppress(RuntimeError):
                self._inner.transport.resume_reading()

    def connection_lost(self, _: Exception | None) -> None:
        """Ends the connection to Zenoh; to leave without a session counts as a
        failure.
        """
        if self._is_counted:
            self._guard.links.pop(self, None)
            if not self.is_finished:
                self._leave_unfinished()
                if self._answered > ALERT_MAX and not self.is_over:
                    self._loop.call_later(LATE_S, self._judge)
                else:
                    self._guard.unopened.pop(self._own, None)
                    self._fail("it disconnected during the handshake")
        self.is_over = True
        if self._inner is not None:
            self._inner.transport.close()


class Inner(asyncio.Protocol):
    """Its connection to Zenoh."""

    def __init__(self, outer: Outer) -> None:
        self._outer = outer

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._outer.answer(data)

    def pause_writing(self) -> None:
        self._outer.transport.pause_reading()

    def resume_writing(self) -> None:
        with contextlib.suppress(RuntimeError):
            self._outer.transport.resume_reading()

    def connection_lost(self, _: Exception | None) -> None:
        self._outer.end()


async def _serve(inner: int, listening: list[ThrottledSocket]) -> None:
    """Until stdin ends: the parent is gone. It also says whose sessions have begun."""
    loop = asyncio.get_running_loop()
    guard = Guard(("127.0.0.1", inner), sys.stdout.fileno())
    throttle = Throttle(RATE, partial(guard.refuse_often, loop.time))
    for each in listening:
        each.throttle = throttle
    servers = [
        await loop.create_server(lambda: Outer(guard), sock=each) for each in listening
    ]
    ended = asyncio.Event()
    os.set_blocking(sys.stdout.fileno(), False)

    def read() -> None:
        data = os.read(sys.stdin.fileno(), 65536)
        guard.hear(data)
        if not data:
            loop.remove_reader(sys.stdin.fileno())
            ended.set()

    loop.add_reader(sys.stdin.fileno(), read)
    loop.set_exception_handler(lambda *_: None)  # out of files: asyncio tries again
    guard.say("ready")
    while not ended.is_set():
        guard.say(BEAT)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(ended.wait(), BEAT_S)
    for server in servers:
        server.close()


def main(arguments: list[str]) -> None:
    """`arguments`: Zenoh's own port, and the descriptors of the sockets to guard."""
    system.raise_files_limit()
    inner, *descriptors = map(int, arguments)
    asyncio.run(_serve(inner, [ThrottledSocket(fileno=each) for each in descriptors]))


if __name__ == "__main__":
    main(sys.argv[1:])
