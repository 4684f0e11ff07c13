# SPDX-License-Identifier: MIT
"""Sends messages to all clients over TCP, in a thread of its own.

A client that is too slow gets the newest message of each name. What clients send is
read and left at that.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import threading
from collections.abc import Iterable
from typing import cast

from imud.errors import ListenFailed

CLIENTS_MAX = 16

# Of each client: with the system's own buffers, a client that is too slow would lag
# behind by minutes. Half a second of a probe's messages at 200 Hz.
BUFFER_BYTES = 16 * 1024

# To wait for the thread to start, and to end.
PATIENCE_S = 0.5

Named = tuple[str, bytes]  # a message by its device name


class Server:
    """send() may be called in any thread."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._clients: set[_Client] = set()
        self._socket: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._is_up = threading.Event()
        self._thread = threading.Thread(target=self._run, name="imud-igtl", daemon=True)

    @property
    def port(self) -> int:
        """The port in use, which the system chose if 0 was asked for."""
        return int(self._socket.getsockname()[1]) if self._socket else self._address[1]

    @property
    def is_heard(self) -> bool:
        """Whether a client is connected."""
        return bool(self._clients)

    def start(self) -> None:
        """Listens, then serves in a thread; ListenFailed where that is not possible."""
        host, port = self._address
        try:
            family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
            self._socket = socket.create_server(
                (host, port), family=family, backlog=CLIENTS_MAX
            )
        except (OSError, UnicodeError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else "not an address"
            raise ListenFailed(
                f"can't serve OpenIGTLink on {host}:{port}: {reason}; name another "
                "address with [openigtlink] listen"
            ) from error
        self._thread.start()
        self._is_up.wait(PATIENCE_S)

    def send(self, messages: Iterable[Named]) -> None:
        """Sends to the clients that are there."""
        sent = tuple(messages)
        if sent and self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._deliver, sent)

    def close(self) -> None:
        if self._loop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(PATIENCE_S)
        if self._socket is not None:
            self._socket.close()

    def _deliver(self, messages: Iterable[Named]) -> None:
        for client in self._clients:
            client.put(messages)

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = await self._loop.create_server(
            lambda: _Client(self._clients), sock=cast(socket.socket, self._socket)
        )
        self._is_up.set()
        await self._stop.wait()
        server.close()
        for client in tuple(self._clients):
            client.abort()


class _Client(asyncio.Protocol):
    """One connection; all of it runs in the server's thread."""

    def __init__(self, clients: set[_Client]) -> None:
        self._clients = clients
        self._transport: asyncio.Transport | None = None
        self._is_full = False
        self._waiting: dict[str, bytes] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        if len(self._clients) >= CLIENTS_MAX:
            self._transport.abort()
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
