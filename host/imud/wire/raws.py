# SPDX-License-Identifier: MIT
"""Raw messages in arrays: recordings hold millions of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from imud.wire import schema

Rows = npt.NDArray[Any]

ID, _FIELDS = next((m.id, m.fields) for m in schema.MESSAGES if m.name == "raw")
_KNOWN = sum(schema.SampleFlags)
NULL = next(field.null for field in _FIELDS if field.name == "mag")


def _kind(field: schema.Field) -> tuple[str, str] | tuple[str, str, int]:
    code = f"<{field.type[0]}{int(field.type[1:]) // 8}"
    return (field.name, code) if field.count == 1 else (field.name, code, field.count)


_HEAD = np.dtype([("id", "u1"), ("sequence", "<u4"), ("time_us", "<u4")])
# The content of a message as a row: header, and each field behind its tag.
ROW = np.dtype(
    _HEAD.descr
    + [each for f in _FIELDS for each in ((f"tag_{f.name}", "u1"), _kind(f))]
)
SIZE = ROW.itemsize


def blank(count: int) -> Rows:
    """Rows without a field, a temperature and flags; the rest is zeros."""
    rows = np.zeros(count, ROW)
    rows["id"], rows["mag"], rows["temperature"] = ID, NULL, NULL
    for field in _FIELDS:
        rows[f"tag_{field.name}"] = field.tag
    return rows


def heads_of(contents: Sequence[bytes]) -> Rows:
    """`sequence` and `time_us` of messages of any kind."""
    return np.frombuffer(b"".join([content[:9] for content in contents]), _HEAD)


def rows_of(contents: Sequence[bytes]) -> Rows | None:
    """The rows of contents; None: one of them is no good raw message."""
    if any(len(content) != SIZE for content in contents):
        return None
    rows = np.frombuffer(b"".join(contents), ROW)
    nulls = (rows["mag"] == NULL).sum(axis=1)
    is_good = (
        (rows["id"] == ID).all()
        and all((rows[f"tag_{field.name}"] == field.tag).all() for field in _FIELDS)
        and not (rows["sample_flags"] & ~np.uint8(_KNOWN)).any()
        and bool(((nulls == 0) | (nulls == 3)).all())
    )
    return rows if is_good else None
