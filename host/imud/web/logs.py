# SPDX-License-Identifier: MIT
"""The daemon's log files, for who downloads them in the page."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

CHUNK_BYTES = 128 * 1024
LISTED_MAX = 200


class LogFolder:
    """Lists a folder's logs and reads parts of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def files(self) -> list[dict[str, Any]]:
        """Name, bytes and time of the last change of each, the newest first."""
        found: list[dict[str, Any]] = []
        for path in self._folder.glob("*.mcap"):
            try:
                about = path.stat()
            except OSError:
                continue  # it was removed meanwhile
            changed_ms = about.st_mtime_ns // 1_000_000
            found.append(
                {"name": path.name, "bytes": about.st_size, "changed_ms": changed_ms}
            )
        found.sort(key=lambda file: file["changed_ms"], reverse=True)
        return found[:LISTED_MAX]

    def path(self, name: str) -> Path:
        """The path of a log; OSError if there is no such file."""
        # Only a name that is listed, so that nothing else can be read.
        if name not in (file["name"] for file in self.files()):
            raise FileNotFoundError(errno.ENOENT, "there is no such log", name)
        return self._folder / name

    def read(self, name: str, offset: int) -> bytes:
        """A part of a log; OSError if there is no such file."""
        return part_of(self.path(name), offset)


def part_of(path: Path, offset: int) -> bytes:
    """At most CHUNK_BYTES of a file."""
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(CHUNK_BYTES)
