# SPDX-License-Identifier: MIT
"""Makes the tables of a log for one browser, in processes of their own."""

from __future__ import annotations

import asyncio
import errno
import shutil
import tempfile
from pathlib import Path

from imud.web import processes
from imud.web.playing import Players


class Tables:
    """The CSV tables of one log, in a zip file that is removed with this. Belongs to
    the server's loop.
    """

    def __init__(self, log: Path, players: Players) -> None:
        """`players`: counts it while it is made."""
        self.name = f"{log.stem}-csv.zip"
        self._log, self._players = log, players
        self._folder: Path | None = None

    @property
    def path(self) -> Path | None:
        """The zip file, once it is made."""
        return self._folder / self.name if self._folder is not None else None

    async def make(self) -> int:
        """Returns the bytes of the zip file; OSError if there is none."""
        self._players.count += 1
        folder = Path(tempfile.mkdtemp(prefix="imud-tables-"))
        try:
            made = folder / "made"
            said = await _run("imud", "export", str(self._log), "--out", str(made))
            files = sorted(map(str, made.glob("*.csv")))
            if not files:
                raise OSError(errno.ENODATA, said or "it has nothing for a table")
            path = folder / self.name
            said = await _run("zipfile", "-c", str(path), *files)
            size = path.stat().st_size
            await asyncio.to_thread(shutil.rmtree, made)
            self._folder = folder
            return size
        finally:
            self._players.count -= 1
            if self._folder is None:
                shutil.rmtree(folder, ignore_errors=True)

    def remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


async def _run(module: str, *arguments: str) -> str:
    """Runs a program until it ends, and returns its last complaint."""
    process = await processes.start(module, *arguments, stderr=asyncio.subprocess.PIPE)
    try:
        _, said = await process.communicate()
    finally:
        await processes.end(process)
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].removeprefix("imud: ") if lines else ""
