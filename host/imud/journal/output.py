# SPDX-License-Identifier: MIT
"""Writes the daemon's lines on stderr: one line an event, whatever it contains, and
only a few of one kind in a while. A thread of its own writes them, so that a terminal
or a pipe that nobody reads holds up nothing.

    14:36:18 probe stylus found on /dev/ttyUSB0: nano, firmware 0.1.0, ...
    14:36:19 warning: probe stylus: 3 lost

Under systemd, which adds the time itself, a line begins with its level: sd-daemon(3).
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import select
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping
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


# Lines that wait while nobody reads; the oldest of more are dropped.
LINES_MAX = 1000

# At the end, lines wait so long for their reader.
LAST_S = 0.5


class JournalStream(io.TextIOBase):
    """A text stream whose write() never waits: a thread writes to the descriptor."""

    def __init__(
        self, descriptor: int, encoding: str = "utf-8", lines_max: int = LINES_MAX
    ) -> None:
        self._descriptor = descriptor
        self._coding = encoding
        self._lines: deque[str] = deque()
        self._lines_max = lines_max
        self._untold = 0  # lines dropped since it was last told
        self._is_writing = False
        self.dropped = 0  # lines, in all
        self._changed = threading.Condition()
        # A daemon thread: a process ends, whoever does not read.
        threading.Thread(target=self._run, name="imud-journal", daemon=True).start()

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def write(self, text: str) -> int:
        with self._changed:
            self._lines.append(text)
            if len(self._lines) > self._lines_max:
                self._drop(self._lines.popleft())
            self._changed.notify_all()
        return len(text)

    def drain(self, patience_s: float) -> bool:
        """Waits until all is written; False if that takes too long."""
        with self._changed:
            return self._changed.wait_for(
                lambda: not self._lines and not self._is_writing, patience_s
            )

    def _drop(self, text: str) -> None:
        count = max(1, text.count("\n"))
        self.dropped += count
        self._untold += count

    def _run(self) -> None:
        while True:
            with self._changed:
                self._is_writing = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: bool(self._lines))
                text, untold = self._lines.popleft(), self._untold
                self._untold, self._is_writing = 0, True
            told = f"imud: {untold} lines dropped, as stderr took none\n"
            data = (told * bool(untold) + text).encode(self._coding, "backslashreplace")
            try:
                self._put(data)
            except OSError:  # its reader has ended, or its disk is full
                with self._changed:
                    self._untold += untold
                    self._drop(text)

    def _put(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:  # a terminal that another program set so
                select.select((), (self._descriptor,), ())


@contextlib.contextmanager
def journal_on_stderr(level: str) -> Iterator[JournalStream]:
    """Has the daemon's lines, and all else that Python writes to stderr meanwhile,
    written by a JournalStream. It stays in the place of stderr if that is stuck.
    """
    plain = sys.stderr
    stream = JournalStream(plain.fileno(), plain.encoding)
    out = logging.StreamHandler(stream)
    out.setFormatter(OneLine(has_time=not is_systemds(plain)))
    sys.stderr = stream
    logger.addHandler(out)
    logger.setLevel(level.upper())
    try:
        yield stream
    finally:
        logger.removeHandler(out)
        if stream.drain(LAST_S):
            sys.stderr = plain


# Of one kind of line, BURST are written in QUIET_S; the rest is counted.
BURST = 3
QUIET_S = 10.0

logger = logging.getLogger("imud")


class RateLimiter:
    """Lets `burst` lines of a kind through in `quiet_s` seconds; counts the others."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._quiet_s = quiet_s
        self._burst = burst
        self._spoken_s: dict[object, deque[float]] = {}
        self._withheld: Counter[object] = Counter()

    def configure(self, quiet_s: float, burst: int) -> None:
        self._quiet_s = quiet_s
        self._burst = burst

    def allow(self, kind: object, now_s: float) -> str | None:
        """The text to append to the line, or None to withhold it."""
        spoken = self._spoken_s.setdefault(kind, deque())
        while spoken and now_s - spoken[0] >= self._quiet_s:
            spoken.popleft()
        if len(spoken) >= self._burst:
            self._withheld[kind] += 1
            return None
        spoken.append(now_s)
        withheld = self._withheld.pop(kind, 0)
        return f" (and {withheld} like it before)" if withheld else ""


class Journal:
    """Writes lines to the journal, limited by kind. Not thread-safe."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._limiter = RateLimiter(quiet_s, burst)

    def configure(self, quiet_s: float, burst: int) -> None:
        self._limiter.configure(quiet_s, burst)

    def write(
        self,
        kind: object,
        text: str,
        *,
        is_warning: bool = False,
        is_total: bool = False,
    ) -> bool:
        """Writes the line unless there were too many of its kind; returns whether it
        did. The next one of the kind says how many were withheld; not with `is_total`,
        whose text has the total.
        """
        more = self._limiter.allow(kind, time.monotonic())
        if more is not None:
            level = logging.WARNING if is_warning else logging.INFO
            logger.log(level, "%s%s", text, "" if is_total else more)
        return more is not None
