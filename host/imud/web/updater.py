# SPDX-License-Identifier: MIT
"""New firmware for probes, begun from the page: `imud flash` in a process beside the
daemon, which asks for what it needs on stdout. How it does is told on the topic
`update`.
"""

from __future__ import annotations

import asyncio
from typing import Any

import msgspec

from imud.flash.firmware import Firmware
from imud.web import processes
from imud.web.feed import UPDATE, Feed
from imud.web.guide import Ask, GuideError, Tell

SAID_MAX = 40  # lines that are told
TICK_S = 0.1

_encode = msgspec.json.Encoder().encode


class UpdateError(Exception):
    """An update can't begin: why."""


class FromFlash(msgspec.Struct, frozen=True):
    """A line of `imud flash`: a question, how much is written, or why it has ended."""

    ask: str = ""
    command: str = ""
    parameters: dict[str, str] = {}
    share: float | None = None
    error: str = ""


_decode = msgspec.json.Decoder(FromFlash).decode


class FirmwareUpdate:
    """One update. Belongs to the server's loop."""

    def __init__(self, probe: str, feed: Feed, ask: Ask, tell: Tell) -> None:
        self._probe = probe
        self._feed, self._ask, self._tell = feed, ask, tell
        self._said: list[str] = []
        self._share: float | None = None
        self._error = ""
        self._task = asyncio.get_running_loop().create_task(self._run())

    @property
    def is_over(self) -> bool:
        return self._task.done()

    async def close(self) -> None:
        """Gives it up, but never while a board is half written."""
        while self._share is not None and not self.is_over:
            await asyncio.sleep(TICK_S)
        self._task.cancel()
        await asyncio.wait([self._task])

    async def _run(self) -> None:
        self._say("running")
        process = None
        try:
            process = await processes.start("imud", "flash", self._probe, "--for-page")
            while process.stdout and (line := await process.stdout.readline()):
                await self._hear(process, line.rstrip(b"\n"))
            code = await process.wait()
        except OSError as error:
            self._error = error.strerror or "it can't be started"
        else:
            if code != 0 and not self._error:
                self._error = "it ended early; see the journal of imud"
        finally:
            await processes.end(process)
            self._share = None
        self._say("refused" if self._error else "done")

    async def _hear(self, process: processes.Process, line: bytes) -> None:
        if not line.startswith(b"{"):
            self._said = [*self._said, line.decode(errors="replace")][-SAID_MAX:]
            self._say("running")
            return
        message = _decode(line)
        if message.ask:
            processes.write(process, _encode(await self._answer(message)))
        elif message.error:
            self._error = message.error
        else:
            self._share = message.share
            self._say("running")

    async def _answer(self, message: FromFlash) -> dict[str, Any]:
        if message.ask != "command":
            payload = self._feed.known((self._probe, message.ask))
            return {"value": msgspec.Raw(payload) if payload is not None else None}
        try:
            found = await self._ask(self._probe, message.command, message.parameters)
        except GuideError as error:
            return {"error": str(error)}
        return {"value": msgspec.Raw(found)}

    def _say(self, phase: str) -> None:
        state = {
            "type": UPDATE,
            "probe": self._probe,
            "phase": phase,
            "share": self._share,
            "said": self._said,
            "why": self._error,
        }
        self._tell(self._probe, _encode(state))


class Updates:
    """All updates under way. Belongs to the server's loop."""

    def __init__(
        self, offered: tuple[Firmware, ...], feed: Feed, ask: Ask, tell: Tell
    ) -> None:
        self.offered = offered
        self._feed, self._ask, self._tell = feed, ask, tell
        self._all: dict[str, FirmwareUpdate] = {}

    def begin(self, probe: str) -> None:
        """Begins one; UpdateError if there is one of that probe, or no such probe."""
        if self._feed.known((probe, "status")) is None:
            raise UpdateError(f"there is no probe {probe}")
        before = self._all.get(probe)
        if before is not None and not before.is_over:
            raise UpdateError("this probe is being updated")
        self._all[probe] = FirmwareUpdate(probe, self._feed, self._ask, self._tell)

    async def close(self) -> None:
        for each in self._all.values():
            await each.close()
