# SPDX-License-Identifier: MIT
"""Writes `.mat` files of version 5, typed from the format's document."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

Held = Mapping[str, Any]
HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(name: str, value: Any) -> bytes:
    """Of an array, a text, or a struct as a mapping."""
    array = np.atleast_2d(np.asarray(0 if isinstance(value, Mapping | str) else value))
    kind = 2 if isinstance(value, Mapping) else 4 if isinstance(value, str) else 6
    inner = element(6, struct.pack("<II", kind, 0))
    inner += element(5, struct.pack("<2i", *array.shape))
    inner += element(1, name.encode())
    if isinstance(value, Mapping):
        inner += struct.pack("<HHI", 5, 4, 32)  # a number within its tag
        inner += element(1, b"".join(key.encode().ljust(32, b"\0") for key in value))
        inner += b"".join(matrix("", each) for each in value.values())
    elif isinstance(value, str):
        inner += element(4, value.encode("utf-16-le"))
    else:
        inner += element(9, array.astype("<f8").tobytes(order="F"))
    return element(14, inner)


def write(path: Path, variables: Held, *, is_packed: bool = True) -> Path:
    parts = [matrix(name, value) for name, value in variables.items()]
    if is_packed:
        parts = [zlib.compress(part) for part in parts]
        parts = [struct.pack("<II", 15, len(part)) + part for part in parts]
    path.write_bytes(HEAD + b"".join(parts))
    return path
