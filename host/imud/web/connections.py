# SPDX-License-Identifier: MIT
"""Counts connections, and every refusal by its reason."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection

from imud.throttle import Rate

# Gets lines for the journal: the kind, the text, whether it is a warning.
OnNotice = Callable[[object, str, bool], None]

# A browser fetches the files over at most 6 connections at a time. Of those that have
# not logged in, or asked for anything, the oldest makes room: of all, or of an address.
CONNECTIONS_MAX = 512
STRANGERS_OF_ONE = 256
BROWSERS_MAX = 64
LOGIN_S = 10.0  # from its connection until a browser has logged in

# The page has 75 files, and each is a connection: ten browsers may come at once. With
# 400 a second the daemon took 82 % of a core (benchmarks/host/attacks.py).
RATE = Rate(at_once=750, a_second=50.0)

REASONS = {
    "host": "the request names another host than this machine",
    "origin": "a page of another site tried to connect",
    "path": "there is no such file",
    "connections": f"{CONNECTIONS_MAX} connections, or {STRANGERS_OF_ONE} of its "
    "address that did not log in",
    "silent": f"it did not log in within {LOGIN_S:g} s",
    "rate": f"more than {RATE.a_second:.0f} connections a second from its address",
    "browsers": f"there are {BROWSERS_MAX} browsers",
    "unreadable": "it sent no valid HTTP request",
    "oversized": "its message was too long",
    "malformed": "its message was not one of the page's",
    "fault": "its message led to an internal error",
    "login": "wrong user or password",
    "role": "its role does not allow commands",
    "busy": "it sent too many commands at once",
}

# The library would log each broken handshake; they are counted here.
quiet = logging.getLogger("imud.web")
quiet.addHandler(logging.NullHandler())
quiet.propagate = False


class Connections:
    """The connections that are open, and what was refused since the start."""

    def __init__(self, on_notice: OnNotice) -> None:
        self._on_notice = on_notice
        self._open: dict[Connection, str] = {}  # the oldest first; its address
        self.refused: Counter[str] = Counter()

    def refuse(self, reason: str, connection: ServerConnection) -> None:
        """Counts a refusal, and tells the journal."""
        address = connection.remote_address
        self.refuse_peer(
            reason, f"{address[0]}:{address[1]}" if address else "unknown client"
        )

    def refuse_peer(self, reason: str, client: str) -> None:
        """The same for a client whose connection was not accepted."""
        self.refused[reason] += 1
        text = f"page: refused {client}: {REASONS[reason]}"
        self._on_notice(("page", reason), text, True)

    def add(self, connection: Connection) -> bool:
        """Whether there is room for another connection, or room can be made."""
        host = str((connection.remote_address or ("",))[0])
        strangers = [each for each in self._open if not each.is_admitted]
        own = [each for each in strangers if self._open[each] == host]
        if len(own) >= STRANGERS_OF_ONE:
            self._drop(own[0])
        elif len(self._open) >= CONNECTIONS_MAX and strangers:
            self._drop(strangers[0])
        elif len(self._open) >= CONNECTIONS_MAX:
            self.refuse("connections", connection)
            return False
        self._open[connection] = host
        return True

    def _drop(self, connection: Connection) -> None:
        self.refuse("connections", connection)
        del self._open[connection]
        connection.transport.abort()

    def remove(self, connection: Connection) -> None:
        if connection not in self._open:
            return
        del self._open[connection]
        # A browser may open a connection in advance, and never use it.
        if connection.has_spoken and not connection.is_answered:
            self.refuse("unreadable", connection)

    def connection(self, *arguments: Any, **named: Any) -> Connection:
        """Makes the object for a connection that was accepted."""
        return Connection(self, *arguments, **named)


class Connection(ServerConnection):
    """A connection that is counted."""

    def __init__(self, connections: Connections, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._connections = connections
        self.has_spoken = False
        self.is_answered = False  # its request was read
        self.is_admitted = False  # its user has logged in

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._connections.add(self):
            self.transport.abort()

    def data_received(self, data: bytes) -> None:
        self.has_spoken = True
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._connections.remove(self)
        super().connection_lost(exc)
