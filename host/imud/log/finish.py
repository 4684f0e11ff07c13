# SPDX-License-Identifier: MIT
"""Finishes the daemon's logs that a crash or a power cut has cut off, so that they are
complete logs like all others.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from imud.errors import FileError
from imud.log.copy import copy_good
from imud.log.parts import has_end
from imud.log.writer import CHUNK_MAX
from imud.machine import system

# After each part of a log, so that poses never wait for this.
PAUSE_S = 0.001

# What is without a message and longer than a torn first chunk is not thrown away.
BLANK_MAX = CHUNK_MAX


@dataclass(frozen=True, slots=True)
class Finished:
    """A log that was cut off, and how many messages it has. `fault`: why it stays as it
    is; empty: it has its end, or had nothing in it and is removed.
    """

    path: Path
    messages: int = 0
    fault: str = ""


def finish_all(paths: Iterable[Path], floor_bytes: int = 0) -> Iterator[Finished]:
    """Finishes those that no process writes, in place of the file; a copy is made
    first, where the disk keeps `floor_bytes` free. The time of the file stays.
    """
    for path in sorted(paths):
        try:
            found = _finish(path, floor_bytes)
        except FileNotFoundError:
            continue
        except (OSError, FileError) as error:
            why = error.strerror if isinstance(error, OSError) else str(error)
            found = Finished(path, fault=f"can't finish {path}: {why}")
        if found is not None:
            yield found


def _finish(path: Path, floor_bytes: int) -> Finished | None:
    """None: it has its end, or is being written."""
    part = path.with_name(f"{path.name}.part")  # may be left of an earlier attempt
    with path.open("rb") as file:
        if has_end(file):
            part.unlink(missing_ok=True)
            return None
    # For a lock of a network's file system it has to be open for writing.
    with path.open("r+b") as file:
        about = os.fstat(file.fileno())
        if not system.try_lock(file) or not os.path.samestat(about, path.stat()):
            return None
        size = about.st_size
        if size and system.free_bytes(path.parent) < floor_bytes + 2 * size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        messages = 0
        try:
            if size:
                messages = _copy(path, part, about)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    if messages:
        part.replace(path)
    else:
        part.unlink(missing_ok=True)
        path.unlink()
    return Finished(path, messages)


def _copy(path: Path, part: Path, about: os.stat_result) -> int:
    """The number of its messages; FileError where a copy would leave out some."""
    copy = copy_good(path, part, lambda _: time.sleep(PAUSE_S))
    is_blank = not copy.messages and sum(each.size for each in copy.damages) > BLANK_MAX
    if copy.unknown or is_blank:
        raise FileError("it is damaged; imud recover saves what is good")
    os.utime(part, ns=(about.st_atime_ns, about.st_mtime_ns))
    part.chmod(about.st_mode & 0o777)
    return copy.messages
