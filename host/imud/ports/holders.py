# SPDX-License-Identifier: MIT
"""Which programs have a port open: all programs that open a port share it, and each
gets some of the bytes. Opening it would also reset many boards.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

PROCESSES = Path("/proc")


@dataclass(frozen=True, slots=True)
class PortHolder:
    """A process that has a port open."""

    pid: int
    program: str

    def __str__(self) -> str:
        return f"{self.program} (process {self.pid})"


def holders_of(port: str) -> list[PortHolder]:
    """All but this process, as far as /proc tells: of other users' processes only root
    sees what they have open. Takes some milliseconds.
    """
    wanted = os.path.realpath(port)
    found = []
    for entry in PROCESSES.iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        # It may end meanwhile, or belong to another user.
        with contextlib.suppress(OSError):
            if any(_is(each, wanted) for each in (entry / "fd").iterdir()):
                program = (entry / "comm").read_text("utf-8", "replace").strip()
                found.append(PortHolder(int(entry.name), program))
    return sorted(found, key=lambda holder: holder.pid)


def _is(descriptor: Path, wanted: str) -> bool:
    try:
        return str(descriptor.readlink()) == wanted
    except OSError:
        return False
