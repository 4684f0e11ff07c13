# SPDX-License-Identifier: MIT
"""Files that commands read: one on this disk, or stdin."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

STDIN = Path("-")


@contextlib.contextmanager
def local(path: Path) -> Iterator[Path]:
    """The file at `path`. What `-` names is read from stdin to its end first, into a
    file of its own, since some readers go to and fro in theirs.
    """
    if path != STDIN:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="imud-") as folder:
        copy = Path(folder) / "stdin"
        with copy.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        yield copy
