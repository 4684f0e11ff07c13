# SPDX-License-Identifier: MIT
"""TCP servers on an asyncio loop, each in a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Any

from imud.errors import ListenFailed, described
from imud.throttle import Throttle, ThrottledSocket

# A fault in a loop is told so often at most.
TELL_S = 60.0

logger = logging.getLogger("imud")

# Serves what connects to a socket that listens, until it is left.
Serve = Callable[[socket.socket], AbstractAsyncContextManager[object]]


def listen(
    address: tuple[str, int],
    what: str,
    setting: str,
    backlog: int = 1,
    throttle: Throttle | None = None,
) -> ThrottledSocket:
    """A socket that listens on that host and port; port 0: the system chooses one.
    ListenFailed names the service, and the setting to change.
    """
    host, port = address
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        made = socket.create_server((host, port), family=family, backlog=backlog)
    except (OSError, UnicodeError) as error:
        # The system's numbers are above 0, those of names that are not found below.
        number = getattr(error, "errno", None) or 0
        reason = os.strerror(number) if number > 0 else "not an address"
        raise ListenFailed(
            f"can't serve {what} on {host}:{port}: {reason}; choose another address "
            f"with {setting}"
        ) from error
    listening = ThrottledSocket(fileno=made.detach())
    listening.throttle = throttle
    return listening


class Faults:
    """Counts what goes wrong in the loops of servers, and tells of it now and then: an
    attacker, or a machine out of files, would fill the journal.
    """

    def __init__(self) -> None:
        self.count = 0
        self._told = 0
        self._again_s = 0.0
        self._lock = threading.Lock()

    def handle(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Exception handler for a loop outside the daemon."""
        del loop
        fault = context.get("exception")
        self.tell(fault if isinstance(fault, Exception) else context["message"])

    def tell(self, fault: Exception | str) -> None:
        """Counts a fault, and writes it to the journal if TELL_S have passed since the
        last.
        """
        with self._lock:
            self.count += 1
            if time.monotonic() < self._again_s:
                return
            self._again_s = time.monotonic() + TELL_S
            more = self.count - self._told - 1
            self._told = self.count
        words = described(fault) if isinstance(fault, Exception) else fault
        also = f" (and {more} before)" if more else ""
        name = threading.current_thread().name
        logger.warning("%s: internal error: %s%s", name, words, also)


faults = Faults()


class ServerThread:
    """Runs `serve` in a thread of that name. It waits up to `patience_s` for the thread
    to start, and to end.
    """

    def __init__(self, name: str, serve: Serve, patience_s: float = 0.5) -> None:
        self._serve = serve
        self._patience_s = patience_s
        self._socket: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._is_up = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def port(self) -> int | None:
        """The port in use; None before the start."""
        return int(self._socket.getsockname()[1]) if self._socket else None

    def start(self, listening: socket.socket) -> None:
        """Serves on that socket, which is closed at the end."""
        self._socket = listening
        self._thread.start()
        self._is_up.wait(self._patience_s)

    def call(self, function: Callable[..., object], *arguments: Any) -> None:
        """Calls a function in the loop; not if that has not begun or has ended."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(function, *arguments)

    def close(self, patience_s: float | None = None) -> None:
        """Ends it; waits so long that what it serves ends well, by default as long as
        for its start.
        """
        if self._thread.is_alive():
            self.call(self._stop.set)
            self._thread.join(self._patience_s if patience_s is None else patience_s)
        if self._socket is not None:
            self._socket.close()

    def _run(self) -> None:
        asyncio.run(self._until_stopped())

    async def _until_stopped(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(faults.handle)
        if self._socket is not None:
            async with self._serve(self._socket):
                self._is_up.set()
                await self._stop.wait()
