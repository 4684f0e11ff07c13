# SPDX-License-Identifier: MIT
"""Which old logs are removed, so that a folder of them does not grow for ever."""

from __future__ import annotations

import contextlib
import re
import time
from dataclasses import dataclass
from pathlib import Path

from imud.log.reader import is_being_written
from imud.log.writer import MAGIC

# As the daemon names them: nothing else in the folder is touched.
OURS = re.compile(r"imud-\d{8}T\d{6}Z(_\d{3,})?\.mcap")

DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class KeptLogs:
    """The files that a sweep has kept and removed."""

    files: int = 0
    bytes: int = 0
    unfinished: int = 0  # of these files: they are never removed
    removed: int = 0
    removed_bytes: int = 0


@dataclass(frozen=True, slots=True)
class Retention:
    """How much is kept. 0: all."""

    days: float = 0.0
    bytes: int = 0

    def __bool__(self) -> bool:
        return self.days > 0.0 or self.bytes > 0

    def sweep(self, folder: Path, now_s: float | None = None) -> KeptLogs:
        """Removes the oldest logs until the rest is within both limits; `now_s` UTC. A
        truncated log, which is still being written or was cut off, is never removed,
        but its size counts.
        """
        now_s = time.time() if now_s is None else now_s
        found: list[tuple[float, str, int, Path]] = []
        total = unfinished = 0
        for path in folder.iterdir():
            # Others may remove files meanwhile.
            with contextlib.suppress(OSError):
                if not OURS.fullmatch(path.name):
                    continue
                stat = path.stat()
                total += stat.st_size
                if not _is_finished(path):
                    unfinished += 1
                    continue
                found.append((stat.st_mtime, path.name, stat.st_size, path))
        removed = removed_bytes = 0
        count = len(found) + unfinished
        for modified_s, _, size, path in sorted(found):
            is_old = self.days > 0.0 and now_s - modified_s > self.days * DAY_S
            if not is_old and not 0 < self.bytes < total:
                break
            with contextlib.suppress(OSError):
                path.unlink()
                total -= size
                removed += 1
                removed_bytes += size
        return KeptLogs(count - removed, total, unfinished, removed, removed_bytes)


KEEP_ALL = Retention()


def _is_finished(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-len(MAGIC), 2)
        return file.read() == MAGIC and not is_being_written(path)
