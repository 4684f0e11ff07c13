# SPDX-License-Identifier: MIT
"""Which old logs are removed, so that a folder of them does not grow for ever.

Their order is that of a number which each log of a machine begins with: clocks are set,
and some begin at 1970. Times only tell an age, and where logs of other machines belong.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import re
import socket
import stat
import time
from calendar import timegm
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

from imud.log.parts import first_metadata, has_end
from imud.machine import system

# As the daemon names them: nothing else in the folder is touched.
OURS = re.compile(r"imud-(\d{8}T\d{6}Z)(_\d{3,})?\.mcap")
STAMP = "%Y%m%dT%H%M%SZ"

DAY_S = 86_400.0

# 2026-01-01: no imud has written a log before. A clock that says so was never set.
BORN_S = 1_767_225_600.0

MACHINE_ID = Path("/etc/machine-id")


@dataclass(frozen=True, slots=True)
class KeptLogs:
    """The files that a sweep has kept and removed."""

    files: int = 0
    bytes: int = 0
    unfinished: int = 0  # of these files: being written, or cut off
    removed: int = 0
    removed_bytes: int = 0
    excess: int = 0  # bytes above the bound
    fault: str = ""  # why one could not be removed


@dataclass(frozen=True, slots=True)
class _Log:
    path: Path
    size: int
    machine: str  # that wrote it; empty: it does not say
    number: int  # of that machine's logs; 0: it does not say
    claimed_s: float  # UTC when it ended, as far as its times can be; else infinity
    is_dated: bool  # that clock followed UTC
    is_finished: bool
    is_free: bool  # surely no process writes it


@dataclass(frozen=True, slots=True)
class Retention:
    """How much is kept. 0: all."""

    days: float = 0.0
    bytes: int = 0

    def __bool__(self) -> bool:
        return self.days > 0.0 or self.bytes > 0

    def sweep(
        self, folder: Path, now_s: float | None = None, *, is_dated: bool = True
    ) -> KeptLogs:
        """Removes the oldest logs until the rest is within both limits; `now_s` UTC,
        `is_dated`: that is known. The newest log stays, and the newest finished one.

        A log that can't be removed is kept beside the limit: it costs no other.
        """
        now_s = time.time() if now_s is None else now_s
        logs = _in_order(_logs_of(folder, now_s))
        free = [log for log, _ in logs if log.is_free]
        newest = [*free[-1:], *[log for log in free if log.is_finished][-1:]]
        total = counted = sum(log.size for log, _ in logs)
        kept: list[_Log] = []
        fault = ""
        for log, ended_s in logs:
            is_old = is_dated and 0.0 < self.days * DAY_S < now_s - ended_s
            if not is_old and not 0 < self.bytes < counted:
                kept.append(log)
                continue
            counted -= log.size  # also where it has to stay: it costs no newer one
            try:
                if log.is_free and log not in newest:
                    log.path.unlink(missing_ok=True)
                    continue
            except OSError as error:
                fault = f"{log.path.name}: {error.strerror}"
            kept.append(log)
        size = sum(log.size for log in kept)
        return KeptLogs(
            files=len(kept),
            bytes=size,
            unfinished=sum(not log.is_finished for log in kept),
            removed=len(logs) - len(kept),
            removed_bytes=total - size,
            excess=max(0, size - self.bytes) if self.bytes else 0,
            fault=fault,
        )


KEEP_ALL = Retention()


def this_machine() -> str:
    """Tells machines apart; it can't be turned back into what it is made of."""
    try:
        name = MACHINE_ID.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError):
        name = ""
    return hashlib.sha256(f"imud {name or socket.gethostname()}".encode()).hexdigest()[
        :16
    ]


def origin(folder: Path, stamp: str, *, is_dated: bool) -> dict[str, str]:
    """What a log begins with, so that its place among all is known: it comes after all
    that are in the folder.
    """
    numbers = [log.number for log in _logs_of(folder, math.inf)]
    return {
        "machine": this_machine(),
        "number": str(max(numbers, default=0) + 1),
        "began": stamp,
        "clock": "utc" if is_dated else "unknown",
    }


def ours_in(folder: Path) -> Iterator[tuple[Path, int]]:
    """The daemon's logs in a folder and their sizes: regular files, no links."""
    for path in folder.iterdir():
        # Others may remove files meanwhile.
        with contextlib.suppress(OSError):
            about = path.lstat()
            if OURS.fullmatch(path.name) and stat.S_ISREG(about.st_mode):
                yield path, about.st_size


def _logs_of(folder: Path, now_s: float) -> Iterator[_Log]:
    for path, size in ours_in(folder):
        with contextlib.suppress(OSError), path.open("rb") as file:
            first = first_metadata(file)
            is_free = is_finished = has_end(file)
            # A file system without locks tells nothing about one without an end, and an
            # empty one may be about to be locked.
            with contextlib.suppress(OSError):
                is_free = size > 0 and system.try_lock(file, is_shared=True)
            name = OURS.fullmatch(path.name)
            stamps = (first.get("began", ""), name[1] if name else "")
            times = (path.stat().st_mtime, *map(_seconds, stamps))
            latest_s = now_s + DAY_S if now_s >= BORN_S else math.inf
            possible = [each for each in times if BORN_S <= each <= latest_s]
            number = first.get("number", "")
            yield _Log(
                path,
                size,
                first.get("machine", ""),
                int(number) if number.isdecimal() else 0,
                max(possible, default=math.inf),
                first.get("clock") == "utc" and bool(possible),
                is_finished,
                is_free,
            )


def _in_order(logs: Iterator[_Log]) -> list[tuple[_Log, float]]:
    """The oldest first, each with a time that it ended before: its own where that is
    dated, or else that of the next of its machine which is; infinity: there is none.
    """
    here = this_machine()
    places: dict[str, float] = {}  # of the next log of each machine
    placed: list[tuple[float, _Log, float]] = []
    order = attrgetter("number", "claimed_s", "path.name")
    for log in sorted(logs, key=order, reverse=True):
        # Those of versions without numbers are the oldest of this machine.
        who = log.machine or here
        dated_s = log.claimed_s if log.is_dated else math.inf
        # Never after the next: a clock that was ahead for a while is no age.
        places[who] = place_s = min(places.get(who, math.inf), dated_s)
        placed.append((place_s, log, log.claimed_s if log.is_dated else place_s))
    placed.sort(key=lambda entry: (entry[0], order(entry[1])))
    return [(log, ended_s) for _, log, ended_s in placed]


def _seconds(stamp: str) -> float:
    """UTC; 0: it is no time."""
    try:
        return float(timegm(time.strptime(stamp, STAMP)))
    except ValueError:
        return 0.0
