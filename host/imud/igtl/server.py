# SPDX-License-Identifier: MIT
"""Sends messages to all clients over TCP, in a thread of its own.

A client that is too slow gets the newest message of each name. What clients send is
read and left at that.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable
from typing import cast

from imud.serving import ServerThread, listen
from imud.throttle import Rate, Throttle

CLIENTS_MAX = 16
TELL_EVERY = 1000  # refused clients
RATE = Rate(at_once=64, a_second=5.0)  # a client stays
REASONS = {
    "clients": f"there are {CLIENTS_MAX}",
    "rate": f"more than {RATE.a_second:.0f} a second from its address",
}

# Limit for each client: with the system's own buffers, a client that is too slow would
# lag behind by minutes. Half a second of a probe's messages at 200 Hz.
BUFFER_BYTES = 16 * 1024

logger = logging.getLogger("imud")

Named = tuple[str, bytes]  # a message by its device name


class Server:
    """send() may be called in any thread."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._clients: set[_Client] = set()
        self.refused = Counter[str]()  # by reason
        self._thread = ServerThread("imud-igtl", self._serve)

    @property
    def port(self) -> int:
        """The port in use, which the system chose if 0 was asked for."""
        return self._thread.port or self._address[1]

    @property
    def is_heard(self) -> bool:
        """Whether a client is connected."""
        return bool(self._clients)

    def start(self) -> None:
        """Listens, then serves in a thread; ListenFailed where that is not possible."""
        throttle = Throttle(RATE, lambda _: self._refuse("rate"))
        self._thread.start(
            listen(
                *(self._address, "OpenIGTLink", "[openigtlink] listen"),
                *(CLIENTS_MAX, throttle),
            )
        )

    def send(self, messages: Iterable[Named]) -> None:
        """Sends to the clients that are there."""
        if sent := tuple(messages):
            self._thread.call(self._deliver, sent)

    def close(self) -> None:
        self._thread.close()

    def _refuse(self, reason: str) -> None:
        self.refused[reason] += 1
        count = self.refused[reason]
        if count == 1 or count % TELL_EVERY == 0:
            logger.warning(
                "OpenIGTLink: refused a client: %s (%d so far)",
                *(REASONS[reason], count),
            )

    def _deliver(self, messages: Iterable[Named]) -> None:
        for client in self._clients:
            client.put(messages)

    @contextlib.asynccontextmanager
    async def _serve(self, listening: socket.socket) -> AsyncIterator[None]:
        loop = asyncio.get_running_loop()
        server = await loop.create_server(
            lambda: _Client(self._clients, self._refuse), sock=listening
        )
        yield
        server.close()
        for client in tuple(self._clients):
            client.abort()


class _Client(asyncio.Protocol):
    """One connection; all of it runs in the server's thread."""

    def __init__(self, clients: set[_Client], refuse: Callable[[str], None]) -> None:
        self._clients = clients
        self._refuse = refuse
        self._transport: asyncio.Transport | None = None
        self._is_full = False
        self._waiting: dict[str, bytes] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        if len(self._clients) >= CLIENTS_MAX:
            self._transport.abort()
            self._refuse("clients")
            return
        own: socket.socket = transport.get_extra_info("socket")
        own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._transport.set_write_buffer_limits(high=BUFFER_BYTES)
        self._clients.add(self)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._clients.discard(self)
        self._transport = None

    def pause_writing(self) -> None:
        self._is_full = True

    def resume_writing(self) -> None:
        self._is_full = False
        waiting, self._waiting = self._waiting, {}
        self.put(waiting.items())

    def put(self, messages: Iterable[Named]) -> None:
        """Sends messages, or keeps the newest of each name until there is room."""
        for name, data in messages:
            if self._transport is None:
                return
            if self._is_full:
                self._waiting[name] = data
            else:
                self._transport.write(data)

    def abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()
