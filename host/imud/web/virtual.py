# SPDX-License-Identifier: MIT
"""The virtual probe that users of the page may start: one at a time, in a process
beside the daemon, which finds its port. It ends soon after the last browser has left.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable

from imud.web import processes

LEAVE_S = 10.0  # a browser that loads the page again is back by then


class VirtualProbe:
    """Belongs to the server's loop. `standing`: `offered`, `running`, or empty where it
    can't run.
    """

    def __init__(
        self,
        command: tuple[str, ...],
        on_change: Callable[[], None],
        leave_s: float = LEAVE_S,
    ) -> None:
        """`command`: a module and its arguments; empty: there are no emulators here."""
        self.standing = "offered" if command else ""
        self._command, self._on_change, self._leave_s = command, on_change, leave_s
        self._task: asyncio.Task[None] | None = None
        self._leaving: asyncio.TimerHandle | None = None
        self._says = ""

    async def begin(self) -> str:
        """Starts it, and returns why it does not run; empty: it does."""
        if self.standing != "offered":
            return "a virtual probe is running"
        ready = asyncio.Event()
        self._task = asyncio.get_running_loop().create_task(self._run(ready))
        self._stand("running")
        await ready.wait()
        return "" if self.standing == "running" else self._says

    async def end(self) -> str:
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        return ""

    def leave(self, *, is_watched: bool) -> None:
        """A browser has come or left; `is_watched`: one is there."""
        if self._leaving is not None:
            self._leaving.cancel()
        if not is_watched and self._task is not None:
            loop = asyncio.get_running_loop()
            self._leaving = loop.call_later(self._leave_s, self._task.cancel)

    def _stand(self, standing: str) -> None:
        self.standing = standing
        self._on_change()

    async def _run(self, ready: asyncio.Event) -> None:
        with_errors = asyncio.subprocess.PIPE
        process = await processes.start(*self._command, stderr=with_errors)
        try:
            while process.stderr and (line := await process.stderr.readline()):
                self._says = line.decode("utf-8", "replace").removeprefix("imud: ")
                if self._says.startswith("ready "):
                    ready.set()
        finally:
            # It has to end its emulator.
            await processes.end(process, signal.SIGTERM)
            self._stand("offered")
            ready.set()
