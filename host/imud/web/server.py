# SPDX-License-Identifier: MIT
"""Serves the page over HTTP and its live data over a WebSocket, in a thread of its own;
programs get the same on a WebSocket for them.

Browsers get what Feed gathers; their commands go to `on_ask`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import socket
from collections.abc import AsyncIterator, Collection, Iterable, Mapping
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any, cast

import msgspec
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from imud.flash.firmware import Firmware
from imud.serving import ServerThread, faults, listen
from imud.throttle import Throttle
from imud.version import version
from imud.web import connections, responses
from imud.web.browser import Browser
from imud.web.connections import Connection, Connections, OnNotice
from imud.web.feed import CALIBRATION, UPDATE, Feed, Key
from imud.web.files import Files
from imud.web.guide import GuideError, Guides
from imud.web.limbs import FindDaemon, Limbs
from imud.web.logs import LogFolder
from imud.web.playing import Players
from imud.web.session import BrowserSession, OnAsk, PortControl, SessionContext
from imud.web.updater import Updates
from imud.web.users import Everybody, Users
from imud.web.virtual import VirtualProbe
from imud.wire import schema

MESSAGE_MAX = 16 * 1024  # bytes from a browser: a command with its parameters
HANDSHAKE_S = 5.0
CLOSE_S = 0.5
PATIENCE_S = 2.0  # to wait for the thread to start
WRITING_S = 30.0  # to wait for its end: a board may be half written

# The user named for the commands of a guided calibration, and of an update.
BY_GUIDE = "page"

# The version changes with what would break a program: docs/subscribe.md.
STREAM_VERSION = 1
STREAM_HEAD = msgspec.json.encode(
    {
        "type": "stream",
        "version": STREAM_VERSION,
        "imud": version(),
        "schema": f"{schema.FINGERPRINT:#010x}",
    }
)


class Page:
    """The server. take() and flush() may be called in any thread."""

    def __init__(
        self,
        address: tuple[str, int],
        on_ask: OnAsk,
        *,
        users: Users | None = None,
        about: Mapping[str, Any] | None = None,
        logs: LogFolder | None = None,
        ports: PortControl | None = None,
        firmware: tuple[Firmware, ...] | None = None,
        virtual: tuple[str, ...] = (),
        limbs: tuple[Path, FindDaemon] | None = None,
        origins: Collection[str] = (),
        on_notice: OnNotice = lambda *_: None,
    ) -> None:
        """`firmware`: the images for the boards of this machine; None: of another.
        `virtual`: the command of the virtual probe that is offered; empty: none is.
        `limbs`: their folder, and how `imud body` finds the daemon; None: none here.
        `origins`: sites whose pages may open the stream, as https://example.org."""
        self._address = address
        self._origins = frozenset(origins)
        self._feed = Feed()
        self._connections = Connections(on_notice)
        page = {"type": "page", "imud": version(), **(about or {})}
        users = users or Everybody()
        self._guides = Guides(self._feed, self._ask, partial(self._tell, CALIBRATION))
        self._updates = None
        if firmware is not None:
            told = partial(self._tell, UPDATE)
            self._updates = Updates(firmware, self._feed, self._ask, told)
        self._virtual = VirtualProbe(virtual, self._describe)
        self._limbs = Limbs(*limbs, self._describe) if limbs is not None else None
        self._context = SessionContext(
            *(self._connections, self._feed, users, on_ask, page),
            *(self._guides, Players(), self._has_room, self._virtual),
            *(logs, ports, self._updates, self._limbs),
        )
        self._on_ask = on_ask
        self._files = Files()
        self._sessions: set[BrowserSession] = set()
        self._numbers = itertools.count(1)  # of browsers since the start
        self._thread = ServerThread("imud-page", self._serve, PATIENCE_S)

    @property
    def url(self) -> str:
        """Its address, with the port that the system chose if 0 was asked for."""
        host, port = self._address[0], self._thread.port or self._address[1]
        return f"http://{f'[{host}]' if ':' in host else host}:{port}"

    @property
    def is_watched(self) -> bool:
        """Whether a browser is connected."""
        return self._feed.is_watched

    @property
    def refused(self) -> Mapping[str, int]:
        """How many requests and messages were refused so far, by reason."""
        return self._connections.refused

    def start(self) -> None:
        """Listens, then serves in a thread; ListenFailed where that is not possible."""
        throttle = Throttle(
            connections.RATE, partial(self._connections.refuse_peer, "rate")
        )
        self._thread.start(
            listen(
                *(self._address, "the page", "--page or [web] listen"),
                *(connections.CONNECTIONS_MAX, throttle),
            )
        )

    def close(self) -> None:
        self._thread.close(WRITING_S)

    def publish(self, payloads: Iterable[tuple[Key, bytes]]) -> None:
        """Adds published messages, by probe and topic: JSON on one line."""
        self._feed.add(payloads)

    def forget(self) -> None:
        """Probes may have other names from now on: the first lines for new browsers are
        made again.
        """
        self._feed.forget()

    def flush(self) -> None:
        """Has the browsers served with what was taken."""
        if self._feed.is_watched:
            self._thread.call(self._deliver)

    def _deliver(self) -> None:
        fresh = self._feed.swap()
        if fresh:
            self._guides.pass_on(fresh)
            for session in self._sessions:
                session.browser.put(fresh)

    @contextlib.asynccontextmanager
    async def _serve(self, listening: socket.socket) -> AsyncIterator[None]:
        async with serve(
            self._talk,
            sock=listening,
            process_request=self._request,
            # A class to the library, which only calls it.
            create_connection=cast(
                type[ServerConnection], self._connections.connection
            ),
            compression=None,
            server_header=None,
            open_timeout=HANDSHAKE_S,
            close_timeout=CLOSE_S,
            max_size=MESSAGE_MAX,
            logger=connections.quiet,
        ):
            yield
            await self._virtual.end()
            if self._limbs is not None:
                await self._limbs.end()
            await self._guides.close()
            if self._updates is not None:
                await self._updates.close()

    def _describe(self) -> None:
        """What the browsers may do has changed."""
        for session in self._sessions:
            if session.is_admitted:
                session.describe()

    @property
    def _is_seen(self) -> bool:
        """Whether a browser is there, and no program alone."""
        return any(not each.browser.is_program for each in self._sessions)

    def _tell(self, topic: str, probe: str, state: bytes) -> None:
        """How a calibration or an update does."""
        self._feed.add([((probe, topic), state)])
        self._deliver()

    async def _ask(
        self, probe: str, command: str, parameters: Mapping[str, str]
    ) -> Any:
        """Has a command carried out; GuideError with the reason if it is not."""
        loop = asyncio.get_running_loop()
        done: asyncio.Future[bytes] = loop.create_future()

        def settle(payload: bytes, error: str) -> None:
            if done.cancelled():
                return
            if error:
                done.set_exception(GuideError(error))
            else:
                done.set_result(payload)

        def answer(payload: bytes, error: str) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(settle, payload, error)

        self._on_ask(probe, command, dict(parameters), answer, BY_GUIDE)
        return await done

    def _request(
        self, connection: ServerConnection, request: Request
    ) -> Response | None:
        """The answer to a request; None lets the WebSocket's handshake continue."""
        if isinstance(connection, Connection):
            connection.is_answered = True
        if (found := responses.refusal(request, self._origins)) is not None:
            return self._refused(connection, *found)
        path = responses.path_of(request)
        if path in (responses.SOCKET, responses.STREAM):
            if self._has_room():
                return None
            busy = HTTPStatus.SERVICE_UNAVAILABLE
            return self._refused(connection, "browsers", busy)
        file = self._files.get(path)
        if file is None:
            return self._refused(connection, "path", HTTPStatus.NOT_FOUND)
        return responses.file_response(request, file)

    def _has_room(self) -> bool:
        """For another browser whose user has logged in, if that is needed."""
        users = sum(each.is_admitted for each in self._sessions)
        return users < connections.BROWSERS_MAX

    def _refused(
        self, connection: ServerConnection, reason: str, status: HTTPStatus
    ) -> Response:
        self._connections.refuse(reason, connection)
        return responses.text_response(status, connections.REASONS[reason])

    def _admit(
        self,
        connection: ServerConnection,
        session: BrowserSession,
        limit: asyncio.Timeout,
    ) -> None:
        """Ends the time to log in once that is done."""
        if session.is_admitted and limit.when() is not None:
            limit.reschedule(None)
            if isinstance(connection, Connection):
                connection.is_admitted = True

    async def _talk(self, connection: ServerConnection) -> None:
        """Serves one browser, or program, until it leaves."""
        request = connection.request
        if request is not None and responses.path_of(request) == responses.STREAM:
            with contextlib.suppress(ConnectionClosed):
                await connection.send(STREAM_HEAD, text=True)
            browser = Browser(window=None, ids=self._feed.ids)
            send = partial(connection.send, text=True)
        else:
            browser = Browser(ids=self._feed.ids)
            send = partial(connection.send, text=False)
        session = BrowserSession(
            self._context, connection, browser, next(self._numbers)
        )
        self._sessions.add(session)
        self._feed.is_watched = True
        self._virtual.leave(is_watched=self._is_seen)
        writing = asyncio.create_task(browser.write(send))
        try:
            async with asyncio.timeout(connections.LOGIN_S) as limit:
                self._admit(connection, session, limit)
                async for message in connection:
                    await session.handle(message)
                    self._admit(connection, session, limit)
        except TimeoutError:
            self._connections.refuse("silent", connection)
            await connection.close(CloseCode.POLICY_VIOLATION)
        except ConnectionClosed as closed:
            if (
                closed.sent is not None
                and closed.sent.code == CloseCode.MESSAGE_TOO_BIG
            ):
                self._connections.refuse("oversized", connection)
        except msgspec.MsgspecError:
            self._connections.refuse("malformed", connection)
            await connection.close(CloseCode.POLICY_VIOLATION)
        except Exception as fault:  # noqa: BLE001 - of ours: this browser's alone
            self._connections.refuse("fault", connection)
            faults.tell(fault)
            await connection.close(CloseCode.INTERNAL_ERROR)
        finally:
            writing.cancel()
            await asyncio.wait([writing])
            await session.close()
            self._sessions.discard(session)
            self._feed.is_watched = bool(self._sessions)
            self._virtual.leave(is_watched=self._is_seen)
