# SPDX-License-Identifier: MIT
"""Small files in which the daemon remembers what people have said: JSON, read whole and
written all or not at all.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

import msgspec

from imud.errors import FileError

Kept = TypeVar("Kept")

# More than these is no file of ours.
SIZE_MAX = 1_000_000


def read(path: Path, kind: type[Kept], cure: str, missing: Kept | None = None) -> Kept:
    """The contents of a file; `missing` if there is none. FileError if it can't be
    read, or is none of ours: `cure` is the remedy in its message.
    """
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_MAX)
        return msgspec.json.decode(data, type=kind)
    except OSError as error:
        if isinstance(error, FileNotFoundError) and missing is not None:
            return missing
        raise FileError(f"can't read {path}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(f"{path} is damaged ({error}); {cure}") from error


def write(path: Path, value: object) -> os.stat_result:
    """Returns what the system says of the file then. FileError if it can't be made."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        data = msgspec.json.encode(value)
        beside.write_bytes(msgspec.json.format(data, indent=2) + b"\n")
        beside.replace(path)
        return path.stat()
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
