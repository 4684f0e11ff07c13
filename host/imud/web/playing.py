# SPDX-License-Identifier: MIT
"""Plays a log for one browser, in the place of what is live."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from pathlib import Path

import msgspec

from imud.web import processes
from imud.web.browser import Browser
from imud.web.player import HEAD, SEEK

PLAYERS_MAX = 4  # of all browsers: each is a process


class Players:
    """Counts the logs that are played."""

    def __init__(self) -> None:
        self.count = 0

    @property
    def is_full(self) -> bool:
        """Whether no more can be played at a time."""
        return self.count >= PLAYERS_MAX


class Playing:
    """One log for one browser. Belongs to the server's loop."""

    def __init__(
        self, path: Path, speed: float, browser: Browser, players: Players
    ) -> None:
        self.name = path.name
        self._path, self._browser, self._players = path, browser, players
        self._speed = speed
        self._span_ms: list[float] = [0.0, 0.0]
        self._at_ns = self._left_out = 0
        self._error = ""  # why the player has ended
        self._early_ms: float | None = None  # wanted before the process is there
        self._process: processes.Process | None = None
        players.count += 1
        self._task = asyncio.get_running_loop().create_task(self._run())
        self._task.add_done_callback(self._ended)

    def set_speed(self, speed: float) -> None:
        """Continues at this multiple of real time; 0: paused."""
        self._speed = speed
        processes.write(self._process, str(speed).encode())

    def seek(self, t_ms: float) -> None:
        """Continues at that UTC, ms."""
        self._early_ms = t_ms if self._process is None else None
        processes.write(self._process, SEEK + str(round(t_ms * 1e6)).encode())

    async def stop(self) -> None:
        """Ends it."""
        self._task.cancel()
        await asyncio.wait([self._task])

    def _ended(self, _: object) -> None:
        self._players.count -= 1

    async def _run(self) -> None:
        speed = self._speed
        try:
            self._process = process = await processes.start(
                "imud.web.player", str(self._path), str(speed)
            )
            if speed != self._speed:
                self.set_speed(self._speed)
            if self._early_ms is not None:
                self.seek(self._early_ms)
            if process.stdout is not None:
                await self._receive_all(process.stdout)
            self._tell(is_over=True)
        finally:
            await processes.end(self._process)

    async def _receive_all(self, lines: asyncio.StreamReader) -> None:
        """Until the player ends."""
        failed = "the player ended; play the log again"
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                sizes = HEAD.unpack(await lines.readexactly(HEAD.size))
                probe, topic, payload = [await lines.readexactly(n) for n in sizes]
                if topic == b"failed":
                    failed = payload.decode()
                else:
                    self._receive(probe.decode(), topic.decode(), payload)
        self._error = failed

    def _receive(self, probe: str, topic: str, payload: bytes) -> None:
        if probe:
            self._browser.put({(probe, topic): deque((payload,))}, is_played=True)
        elif topic == "marks":
            self._browser.say(msgspec.json.decode(payload))
        elif topic == "span":
            self._span_ms = [int(each) / 1e6 for each in payload.split()]
        else:
            self._at_ns, self._left_out = map(int, payload.split())
            self._tell(is_over=topic == "over")

    def _tell(self, *, is_over: bool) -> None:
        first_ms, last_ms = self._span_ms
        self._browser.say(
            {
                "type": "played",
                "t_ms": self._at_ns / 1e6,
                "first_ms": first_ms,
                "last_ms": last_ms,
                "over": is_over,
                "left_out": self._left_out,
                "error": self._error,
            }
        )
