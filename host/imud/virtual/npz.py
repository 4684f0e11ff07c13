# SPDX-License-Identifier: MIT
"""Arrays of a `.npz` file, which may be hostile: some kilobytes of it can stand
for gigabytes of zeros, and an array's head for any shape.
"""

from __future__ import annotations

import math
import tokenize
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

# Bytes of all arrays, beside four times the file's.
SIZE_MAX = 32 << 20
HEAD_MAX = 10_000  # as NumPy has it, which first reads all of a longer one


def arrays_of(path: Path, keys: Iterable[str]) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of these names in the file. ValueError, EOFError or BadZipFile: it is
    not a .npz, or takes too much memory.
    """
    left = SIZE_MAX + 4 * path.stat().st_size
    found = {}
    with zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
        for key in keys:
            if (name := f"{key}.npy") not in names:
                continue
            with archive.open(name) as file:
                left -= _size(file)
            if left < 0:
                raise ValueError(f"{key} takes too much memory")
            with archive.open(name) as file:
                found[key] = np.lib.format.read_array(file, allow_pickle=False)
    return found


def _size(file: Any) -> int:
    """Bytes of the array, by its head, of a file in a zip."""
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read is None:
        raise ValueError(f"arrays of version {version}")
    length = file.peek(4)[: 2 * version[0]]
    if int.from_bytes(length, "little") > HEAD_MAX:
        raise ValueError("the head of an array is too long")
    try:
        shape, _, dtype = read(file)
    except (SyntaxError, tokenize.TokenError, RecursionError, MemoryError) as error:
        raise ValueError("the head of an array is not one") from error
    return math.prod(shape) * dtype.itemsize
