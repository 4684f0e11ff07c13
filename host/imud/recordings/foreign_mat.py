# SPDX-License-Identifier: MIT
"""Arrays of a `.mat` file of MATLAB's versions 5 to 7 (MAT-File Format, MathWorks):
elements of a tag and bytes, packed or not, that hold arrays, structs and cells.

A file may be hostile: what it unpacks to, its elements and their depth have limits.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import FileError

ROOM = 200_000_000  # bytes of a file, of all that is unpacked, and of all numbers
ELEMENTS_MAX = 200_000
DEPTH_MAX = 16
HEAD = 128  # bytes, with the version and the order of bytes at their end

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8",
         12: "i8", 13: "u8"}  # fmt: skip
MATRIX, PACKED = 14, 15
CELL, STRUCT, OPAQUE = 1, 2, 17
NUMBERS = range(6, 16)
COMPLEX = 0x800

Array = np.ndarray[Any, np.dtype[Any]]

# What comes of elements that end early, are empty, or are no numbers of their kind.
DAMAGED = (
    *(StopIteration, struct.error, zlib.error),
    *(ValueError, IndexError, OverflowError),
)


def arrays_of(path: Path) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Real arrays by their names, such as `walk.acc` of a struct or `walk2.acc` of the
    second of several, vectors of shape (n,); and the names of all else. FileError with
    what to do; OSError.
    """
    if path.stat().st_size > ROOM:
        raise FileError(f"{path}: over {ROOM / 1e6:.0f} MB: save fewer variables in it")
    raw = memoryview(path.read_bytes())
    order = {b"IM": "<", b"MI": ">"}.get(bytes(raw[HEAD - 2 : HEAD]))
    version = order and struct.unpack_from(f"{order}H", raw, HEAD - 4)[0]
    if version != 0x0100:
        raise FileError(
            f"{path} is not of MATLAB's versions 5 to 7: save it again there with "
            "save('FILE.mat', '-v7')"
        )
    reader = _Reader(str(order))
    try:
        reader.read(raw[HEAD:])
    except DAMAGED as error:
        why = str(error) if type(error) is ValueError else "an element is cut short"
        raise FileError(
            f"{path} is a damaged .mat file: {why}; save it again"
        ) from error
    return reader.arrays, tuple(reader.others)


class _Reader:
    def __init__(self, order: str) -> None:
        self._order = order
        self._room, self._left = ROOM, ELEMENTS_MAX
        self.arrays: dict[str, Array] = {}
        self.others: list[str] = []

    def read(self, data: memoryview) -> None:
        for kind, content in self._elements(data):
            if kind == PACKED:
                unpack = zlib.decompressobj()
                whole = unpack.decompress(content, self._room)
                self._take(len(whole) + len(unpack.unconsumed_tail))
                for inner, array in self._elements(memoryview(whole)):
                    self._matrix(inner, array, "", 0)
            else:
                self._matrix(kind, content, "", 0)

    def _take(self, size: int) -> None:
        self._room -= size
        if self._room <= 0:
            raise ValueError(f"over {ROOM / 1e6:.0f} MB: save fewer variables in it")

    def _elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        at = 0
        while at < len(data):
            kind, size = struct.unpack_from(f"{self._order}II", data, at)
            at += 8
            end = at + size
            if kind >> 16:  # up to four bytes within the tag
                size, kind = kind >> 16, kind & 0xFFFF
                at, end = at - 4, at - 4 + min(size, 4)
            self._left -= 1
            if end > len(data) or self._left < 0:
                raise ValueError("an element is cut short, or there are too many")
            yield kind, data[at:end]
            at = end if kind == PACKED else end + -end % 8

    def _numbers(self, kind: int, data: memoryview) -> Array:
        if kind not in TYPES:
            raise ValueError(f"numbers of type {kind}")
        return np.frombuffer(data, f"{self._order}{TYPES[kind]}")

    def _matrix(self, kind: int, data: memoryview, name: str, depth: int) -> None:
        """An array, or all that a struct or a cell holds."""
        if kind != MATRIX or not data:
            return
        parts = self._elements(data)
        flags = int(self._numbers(*next(parts))[0])
        kind = flags & 0xFF
        shape = () if kind == OPAQUE else tuple(self._numbers(*next(parts)).tolist())
        name = name or bytes(next(parts)[1]).decode("latin-1")
        if kind in (CELL, STRUCT):
            if depth == DEPTH_MAX:
                raise ValueError("its structs are too deep")
            if depth:
                next(parts)  # its own name, which is empty
            self._inner(parts, kind, math.prod(shape), name, depth + 1)
        elif kind in NUMBERS and not flags & COMPLEX and len(shape) == 2 and name:
            if depth:
                next(parts)
            if min(shape) < 0:
                raise ValueError("an array of a negative size")
            self._take(8 * math.prod(shape))
            values = self._numbers(*next(parts)).astype(float)
            values = values.reshape(shape, order="F")
            self.arrays[name] = values.ravel() if 1 in shape else values
        elif name:
            self.others.append(name)

    def _inner(
        self,
        parts: Iterator[tuple[int, memoryview]],
        kind: int,
        count: int,
        name: str,
        depth: int,
    ) -> None:
        fields = [""]
        if kind == STRUCT:
            width = int(self._numbers(*next(parts))[0])
            texts = bytes(next(parts)[1])
            if width <= 0 or not texts:
                return  # a struct without fields
            each = [texts[at : at + width] for at in range(0, len(texts), width)]
            fields = ["." + text.partition(b"\0")[0].decode("latin-1") for text in each]
        for at, (inner, content) in enumerate(parts):
            number, field = divmod(at, len(fields))
            of_several = str(1 + number) if count > 1 or kind == CELL else ""
            self._matrix(inner, content, f"{name}{of_several}{fields[field]}", depth)
