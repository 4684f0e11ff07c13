# SPDX-License-Identifier: MIT
"""Python programs beside the server, each for one piece of work: it reads lines and
writes lines.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys

LINE_MAX = 1 << 20

Process = asyncio.subprocess.Process


async def start(module: str, *arguments: str, stderr: int | None = None) -> Process:
    """Runs a module. `stderr`: as of asyncio; None: the daemon's own."""
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", module, *arguments),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=stderr,
        limit=LINE_MAX,
    )


KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


def kill(process: Process, number: int = KILL) -> None:
    """Ends it at once; its output then ends as well."""
    if process.returncode is None:
        # Its own kill() would take its exit code from asyncio, which complains.
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)


async def end(process: Process | None, number: int = KILL) -> None:
    """Ends it by that signal, and closes what leads to it, also if that is cancelled
    meanwhile.
    """
    if process is not None:
        kill(process, number)
        ending = asyncio.create_task(process.communicate())
        while not ending.done():
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.wait([ending])


def write(process: Process | None, lines: bytes) -> None:
    """Hands it lines, if it is there."""
    if process is not None and process.returncode is None and process.stdin:
        process.stdin.write(lines + b"\n")
