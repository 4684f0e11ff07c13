# SPDX-License-Identifier: MIT
"""Plays a log for one browser, in the place of what is live."""

from __future__ import annotations

import asyncio
from collections import deque
from pathlib import Path

from imud.web import processes
from imud.web.browser import Browser
from imud.web.player import SEEK

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
            while process.stdout and (line := await process.stdout.readline()):
                self._receive(line.rstrip(b"\n"))
        finally:
            await processes.end(self._process)

    def _receive(self, line: bytes) -> None:
        probe, topic, payload = line.split(b"\t", 2)
        if topic == b"span":
            self._span_ms = [int(each) / 1e6 for each in payload.split()]
        elif probe:
            key = (probe.decode(), topic.decode())
            self._browser.put({key: deque((payload,))}, is_played=True)
        else:
            first_ms, last_ms = self._span_ms
            self._browser.say(
                {
                    "type": "played",
                    "t_ms": int(payload) / 1e6,
                    "first_ms": first_ms,
                    "last_ms": last_ms,
                    "over": topic == b"over",
                }
            )
