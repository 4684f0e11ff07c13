# SPDX-License-Identifier: MIT
"""The source of information about the probe for a flash: a client of the daemon, or the
page of the daemon that has started `imud flash` beside itself, by lines of JSON on
stdin and stdout.

To the page: `{"ask": "status"}`, "params" or "command", each answered by a line with
`value` or `error`; `{"share": 0.4}`, how much is written; `{"error": "..."}`, why it
has ended. Lines of anything else are words for people.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from typing import Any, BinaryIO, Protocol

import msgspec

from imud.errors import CommandRefused, LinkError
from imud.progress import Progress

SHARE_S = 0.1  # between two lines of progress


class FlashClient(Protocol):
    """The part of imud.client.Client that a flash needs."""

    def statuses(self, probe: str | None = None) -> list[dict[str, Any]]: ...
    def command(self, probe: str, name: str, **arguments: str) -> dict[str, Any]: ...
    def params(self, probe: str) -> dict[str, Any]: ...
    def change_params(self, probe: str, records: bytes) -> dict[str, Any]: ...


class FlashBar(Protocol):
    def update(self, done: float) -> None: ...
    def end(self) -> None: ...


class PageAnswer(msgspec.Struct, frozen=True):
    value: Any = None
    error: str = ""


class PageClient:
    """The page that has started this program, for the one probe that it is about."""

    def __init__(self, lines: BinaryIO, out: BinaryIO) -> None:
        self._lines, self._out = lines, out

    def statuses(self, probe: str | None = None) -> list[dict[str, Any]]:
        status = self._ask("status")
        is_it = status is not None and probe in (None, status["probe"])
        return [status] if is_it else []

    def command(self, probe: str, name: str, **arguments: str) -> dict[str, Any]:
        del probe  # the page has begun this for one
        found: dict[str, Any] = self._ask("command", command=name, parameters=arguments)
        return found

    def params(self, probe: str) -> dict[str, Any]:
        found = self._ask("params")
        if not found:
            raise CommandRefused(f"the params of {probe} are unknown")
        return dict(found)

    def change_params(self, probe: str, records: bytes) -> dict[str, Any]:
        return self.command(probe, "params", records=records.hex())

    def tell(self, **fields: Any) -> None:
        with contextlib.suppress(OSError):  # it may have ended: written on
            self._out.write(msgspec.json.encode(fields) + b"\n")
            self._out.flush()

    def _ask(self, what: str, **fields: Any) -> Any:
        self.tell(ask=what, **fields)
        line = self._lines.readline()
        if not line:
            raise LinkError("the page is closed")
        answer = msgspec.json.decode(line, type=PageAnswer)
        if answer.error:
            raise CommandRefused(answer.error)
        return answer.value


class PageBar:
    """Tells the page how much is written."""

    def __init__(self, client: PageClient) -> None:
        self._client = client
        self._told_s = float("-inf")

    def update(self, done: float) -> None:
        now_s = time.monotonic()
        if now_s - self._told_s >= SHARE_S:
            self._told_s = now_s
            self._client.tell(share=round(done, 3))

    def end(self) -> None:
        self._client.tell(share=None)


def page_client() -> PageClient:
    """On this program's stdin and stdout. From now on the page alone ends it: a signal
    for the daemon's whole group would leave a board half written.
    """
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_IGN)
    return PageClient(sys.stdin.buffer, sys.stdout.buffer)


def bar_for(client: FlashClient | None) -> FlashBar:
    """A bar in the terminal, or on the page."""
    return (
        PageBar(client) if isinstance(client, PageClient) else Progress("writing", 1.0)
    )
