# SPDX-License-Identifier: MIT
"""The page's server with everything around it played by a test."""

from __future__ import annotations

import contextlib
import http.client
import json
from collections import deque
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Self

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from fakes import PATIENCE_S
from imud.flash.firmware import Firmware
from imud.web.limbs import FindDaemon
from imud.web.logs import LogFolder
from imud.web.server import Page
from imud.web.session import PortControl
from imud.web.users import Users
from streaming import until

WRONG = "wrong"


class Asked:
    """Records commands and answers them: at once, or one that waits when released."""

    def __init__(self) -> None:
        self.all: list[tuple[str, str, dict[str, str]]] = []
        self.waits = ""
        self.release: Callable[[], None] | None = None

    def __call__(
        self, probe: str, command: str, parameters: Any, answer: Any, _by: str
    ) -> None:
        self.all.append((probe, command, parameters))
        if command == self.waits:
            self.waits, self.release = "", lambda: answer(b'{"ok":true}', "")
            return
        answer(b'{"ok":true}', "" if command != "fly" else "probes can't fly")


class Served:
    """A page, what it was asked, and what it told the journal."""

    def __init__(
        self,
        users: Users | None = None,
        logs: LogFolder | None = None,
        origins: Collection[str] = (),
        ports: PortControl | None = None,
        firmware: tuple[Firmware, ...] | None = None,
        virtual: tuple[str, ...] = (),
        limbs: tuple[Path, FindDaemon] | None = None,
    ) -> None:
        self.asked = Asked()
        self.notices: list[str] = []
        self.page = Page(
            ("127.0.0.1", 0),
            self.asked,
            users=users,
            logs=logs,
            ports=ports,
            firmware=firmware,
            virtual=virtual,
            limbs=limbs,
            origins=origins,
            on_notice=lambda _, text, __: self.notices.append(text),
        )
        self.page.start()
        self.host = self.page.url.removeprefix("http://")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()

    def get(self, path: str, **headers: str) -> http.client.HTTPResponse:
        host, _, port = self.host.partition(":")
        connection = http.client.HTTPConnection(host, int(port), timeout=PATIENCE_S)
        connection.putrequest(
            "GET", path, skip_host="Host" in headers, skip_accept_encoding=True
        )
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection.getresponse()

    @contextlib.contextmanager
    def live(self, origin: str | None = None) -> Iterator[Live]:
        origin = self.page.url if origin is None else origin
        url = f"ws://{self.host}/live"
        with connect(url, origin=origin, compression=None, max_size=None) as connection:
            yield Live(connection)

    def say(self, number: int, topic: str = "pose", probe: str = "stylus") -> None:
        record = {"type": topic, "probe": probe, "number": number}
        self.page.publish([((probe, topic), json.dumps(record).encode())])
        self.page.flush()

    def until_refused(self, reason: str, count: int = 1) -> None:
        until(lambda: self.page.refused[reason] >= count)


class Live:
    """A browser's connection. Every message that it reads is reported as drawn."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._come: deque[dict[str, Any]] = deque()
        self.head: dict[str, Any] = {}

    def say(self, **fields: Any) -> None:
        self._connection.send(json.dumps(fields))

    def send(self, data: bytes | str) -> None:
        self._connection.send(data)

    def message(self, timeout_s: float = PATIENCE_S) -> list[dict[str, Any]]:
        """The lines of the next message."""
        data = self._connection.recv(timeout_s)
        assert isinstance(data, bytes)
        self.head, *found = map(json.loads, data.split(b"\n"))
        return found

    def next(self, kind: str) -> dict[str, Any]:
        """The next line of that type; those before it are left out."""
        while True:
            while self._come:
                line = self._come.popleft()
                if line["type"] == kind:
                    return line
            self._come.extend(self.message())
            self.say(do="seen", n=self.head["n"])

    def until_closed(self) -> None:
        with pytest.raises(ConnectionClosed):
            while True:
                self._connection.recv(PATIENCE_S)
