# SPDX-License-Identifier: MIT
"""Contents of messages as numpy rows with a column for each field, in wire numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from imud.wire import schema

Rows = npt.NDArray[Any]

_HEADER = ("sequence", "time_us")


def _message(name: str) -> schema.MessageType:
    return next(message for message in schema.MESSAGES if message.name == name)


def row_type(name: str) -> np.dtype[Any]:
    """The dtype of a message's content: id, header, then each field after its tag."""
    codes = ["<" + code for code in schema.HEADER[1:]]
    columns: list[tuple[str, str] | tuple[str, str, tuple[int]]] = [
        *zip(("id", *_HEADER), codes, strict=True)
    ]
    for field in _message(name).fields:
        columns.append((f"tag of {field.name}", "u1"))
        kind = "<" + schema.CODES[field.type]
        columns.append((field.name, kind, (field.count,)))
    return np.dtype(columns)


def empty_rows(name: str, count: int) -> Rows:
    """Rows with ids and tags set, all else zero."""
    message = _message(name)
    rows = np.zeros(count, row_type(name))
    rows["id"] = message.id
    for field in message.fields:
        rows[f"tag of {field.name}"] = field.tag
    return rows


def to_rows(name: str, contents: Sequence[bytes]) -> Rows:
    """Rows from contents of one message type, as the decoder passes them on."""
    kind = row_type(name)
    rows = np.empty(0, kind)
    if all(len(content) == kind.itemsize for content in contents):
        rows = np.frombuffer(b"".join(contents), kind)
    if len(rows) != len(contents) or (rows["id"] != _message(name).id).any():
        raise ValueError(f"not all of these are {name} messages")
    return rows


def to_contents(rows: Rows) -> list[bytes]:
    """The bytes of each row."""
    size = rows.dtype.itemsize
    data = rows.tobytes()
    return [data[start : start + size] for start in range(0, len(data), size)]
