# SPDX-License-Identifier: MIT
"""The marks in logs: as they were made, corrected and taken back."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from imud.errors import FileError
from imud.log.retention import ours_in
from imud.log.seekable import SeekableLog
from imud.published import Mark

LATEST = 3  # logs: by default of an hour each
PAYLOAD_MAX = 8192  # bytes; no mark of ours has so many

logger = logging.getLogger("imud")


_MARK = msgspec.json.Decoder(Mark)


def marks_of(log: SeekableLog) -> Iterator[dict[str, Any]]:
    """Those of a log, in its order; what is no mark is left out. In older logs its time
    is its id.
    """
    for logged in log.of("mark"):
        if len(logged.data) > PAYLOAD_MAX:
            continue
        try:
            mark = _MARK.decode(logged.data)
        except (msgspec.MsgspecError, UnicodeError, RecursionError):
            continue
        if mark.probe == logged.probe:
            found: dict[str, Any] = msgspec.to_builtins(mark)
            absent = {"id": str(mark.t_ns), "state": "new", "probe_id": "", "unit": ""}
            yield found | {key: found[key] or other for key, other in absent.items()}


def marks_in(folder: Path) -> list[dict[str, Any]]:
    """Those of the latest logs of a folder, the oldest first. What can't be read is
    told and left out.
    """
    found: list[dict[str, Any]] = []
    left_out = "log: marks of earlier logs are left out: %s"
    try:
        # One that has just begun is empty.
        paths = [path for path, size in sorted(ours_in(folder)) if size][-LATEST:]
    except OSError as error:
        logger.warning(left_out, error)
        return found
    for path in paths:
        try:
            found += marks_of(SeekableLog(path))
        except (OSError, FileError) as error:
            logger.warning(left_out, error)
    return found
