# SPDX-License-Identifier: MIT
"""Plays a log in a process of its own, so that the daemon has no work with it.
It writes lines: probe, topic and what was published, with tabs between, when they are
due; and where it is. On its standard input it reads new speeds.
"""

from __future__ import annotations

import os
import select
import sys
import time
from pathlib import Path
from typing import BinaryIO

from imud.log.reader import Logged, salvage

TOPICS = frozenset(
    {"pose", "raw", "status", "params", "event", "clock", "log", "twin", "stroke"}
)
BATCH_S = 1 / 60
# Payloads of one topic in a batch: of a log that is played fast, evenly chosen ones.
BATCH_MAX = 40
LATEST_ONLY = frozenset({"status", "params", "clock", "log", "twin"})
PAUSE_S = 0.2  # between two looks at the input while it stands still

Key = tuple[str, str]


class Pace:
    """When a message is due, at a speed that may change. 0: it stands still."""

    def __init__(self, speed: float, now_s: float) -> None:
        self._speed = speed
        self._from_ns: int | None = None
        self._from_s = now_s

    def wait_s(self, t_ns: int, now_s: float) -> float:
        """Seconds until a message of that time is due; the first one is at once."""
        if self._from_ns is None:
            self._from_ns, self._from_s = t_ns, now_s
        if self._speed == 0.0:
            return PAUSE_S
        due_s = self._from_s + (t_ns - self._from_ns) / 1e9 / self._speed
        return due_s - now_s

    def change(self, speed: float, at_ns: int, now_s: float) -> None:
        """Goes on from that message at another speed."""
        self._speed, self._from_ns, self._from_s = speed, at_ns, now_s


class Player:
    """Reads speeds from one file and writes what is due to another."""

    def __init__(self, speeds: BinaryIO, out: BinaryIO, speed: float) -> None:
        self._speeds, self._out = speeds, out
        self._pace = Pace(speed, time.monotonic())
        self._batch: dict[Key, list[bytes]] = {}
        self._sent_s = time.monotonic()
        self._at_ns = 0

    def play(self, path: Path) -> None:
        """Until the end of the log, or of the input."""
        for item in salvage(path):
            if isinstance(item, Logged) and item.topic in TOPICS and item.t_ns:
                self._hold(item)
                self._at_ns = item.t_ns
                key = (item.probe, item.topic)
                self._batch.setdefault(key, []).append(item.data)
        self._send(is_over=True)

    def _hold(self, item: Logged) -> None:
        """Waits until a message is due."""
        while True:
            wait_s = self._pace.wait_s(item.t_ns, time.monotonic())
            if wait_s > 0 or time.monotonic() - self._sent_s > BATCH_S:
                self._send()
                self._look(max(0.0, min(wait_s, PAUSE_S)), item.t_ns)
            if wait_s <= 0:
                return

    def _look(self, patience_s: float, at_ns: int) -> None:
        """Takes a new speed, if there is one within that time."""
        if select.select([self._speeds], [], [], patience_s)[0]:
            line = self._speeds.readline()
            if not line:
                sys.exit(0)
            self._pace.change(float(line), at_ns, time.monotonic())

    def _send(self, *, is_over: bool = False) -> None:
        self._sent_s = time.monotonic()
        for (probe, topic), payloads in self._batch.items():
            most = 1 if topic in LATEST_ONLY else BATCH_MAX
            step = max(1, -(-len(payloads) // most))
            for payload in payloads[::-1][::step][::-1]:
                head = f"{probe}\t{topic}\t".encode()
                self._out.write(head + payload + b"\n")
        self._batch.clear()
        self._out.write(f"\t{'over' if is_over else 'at'}\t{self._at_ns}\n".encode())
        self._out.flush()


def main() -> int:
    path, speed = Path(sys.argv[1]), float(sys.argv[2])
    # Unbuffered, so that select() knows of every line.
    with os.fdopen(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as speeds:
        Player(speeds, sys.stdout.buffer, speed).play(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
