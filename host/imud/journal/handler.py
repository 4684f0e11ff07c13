# SPDX-License-Identifier: MIT
"""Formats the daemon's lines on stderr: one line an event, whatever it contains.

    14:36:18 probe stylus found on /dev/ttyUSB0: nano, firmware 0.1.0, ...
    14:36:19 warning: probe stylus: 3 lost

Under systemd, which adds the time itself, a line begins with its level: sd-daemon(3).
"""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Mapping
from typing import TextIO

# Levels of syslog(3).
_LEVELS = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3}


class OneLine(logging.Formatter):
    """With the time, or else with a level as systemd reads it. Replaces what is not
    printable by `?`."""

    def __init__(self, *, has_time: bool) -> None:
        super().__init__()
        self._has_time = has_time

    def format(self, record: logging.LogRecord) -> str:
        text = "".join(c if c.isprintable() else "?" for c in record.getMessage())
        if not self._has_time:
            return f"<{_LEVELS.get(record.levelno, 6)}>{text}"
        clock = time.strftime("%H:%M:%S", time.localtime(record.created))
        is_plain = record.levelno == logging.INFO
        level = "" if is_plain else f"{record.levelname.lower()}: "
        return f"{clock} {level}{text}"


def is_systemds(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream goes to the journal of systemd, by $JOURNAL_STREAM."""
    try:
        file = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return environment.get("JOURNAL_STREAM") == f"{file.st_dev}:{file.st_ino}"


def handler() -> logging.Handler:
    """Writes to stderr in the format for its reader: a terminal or systemd."""
    out = logging.StreamHandler(sys.stderr)
    out.setFormatter(OneLine(has_time=not is_systemds(sys.stderr)))
    return out
