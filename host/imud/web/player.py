# SPDX-License-Identifier: MIT
"""Plays a log in a process of its own, so that the daemon has no work with it.
It writes probe, topic and what was published, when they are due; the times at which the
log begins and ends, and its marks; and where it is. Each comes after its length, since
a log may have any bytes in it. On its standard input it reads new speeds, and times to
go to.
"""

from __future__ import annotations

import os
import select
import struct
import sys
import time
from pathlib import Path
from typing import BinaryIO

import msgspec

from imud.errors import ImudError, described
from imud.log.marks import marks_of
from imud.log.reader import Logged
from imud.log.seekable import SeekableLog
from imud.net.access import BODY_STATE
from imud.probes.mark import MarkBook
from imud.web.feed import BODY

TOPICS = frozenset(
    {"pose", "raw", "status", "params", "event", "clock", "log", "twin", "stroke"}
    | {"path", "mark", "command", BODY_STATE}
)
BATCH_S = 1 / 60
# Payloads of one topic in a batch: of a log that is played fast, evenly chosen ones.
BATCH_MAX = 40
LATEST_ONLY = frozenset({"status", "params", "clock", "log", "twin"})
PAUSE_S = 0.2  # between two looks at the input while it stands still
SEEK = b"seek "  # begins a line with a time, UTC in ns
# A status comes once a second: so much before the time that is gone to shows how things
# stood then.
BEFORE_NS = 1_100_000_000
NEAR_NS = 1_000_000  # a time in ms is not exact
GAP_NS = 60_000_000_000  # a longer one between two messages is skipped
PAYLOAD_MAX = 1 << 20  # bytes; no message of ours has so many

HEAD = struct.Struct(">III")  # lengths of probe, topic and payload, which follow

Key = tuple[str, str]


class _Payload(msgspec.Struct):
    type: str
    probe: str = ""
    body: str = ""


_PAYLOAD = msgspec.json.Decoder(_Payload)


def line_of(probe: str, topic: str, payload: bytes) -> bytes | None:
    """The payload on one line; None: it is no JSON of that topic of that probe."""
    if len(payload) > PAYLOAD_MAX:
        return None
    try:
        found = _PAYLOAD.decode(payload)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return None
    if found.type != topic or (found.body if topic == BODY else found.probe) != probe:
        return None
    return msgspec.json.format(payload, indent=-1) if b"\n" in payload else payload


class Schedule:
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

    def restart(self) -> None:
        """The next message is due at once."""
        self._from_ns = None

    def change(self, speed: float, at_ns: int, now_s: float) -> None:
        """Continues from that message at another speed."""
        self._speed, self._from_ns, self._from_s = speed, at_ns, now_s


class Player:
    """Reads speeds and times from one file and writes what is due to another."""

    def __init__(self, lines: BinaryIO, out: BinaryIO, speed: float) -> None:
        self._lines, self._out = lines, out
        self._pace = Schedule(speed, time.monotonic())
        self._batch: dict[Key, list[bytes]] = {}
        self._sent_s = time.monotonic()
        self._at_ns = 0
        self._wanted_ns: int | None = None  # where to continue
        self._left_out = 0  # payloads that can't be shown

    def play(self, path: Path) -> None:
        """Until the input ends. At its end the log stands still."""
        log = SeekableLog(path)
        first_ns, last_ns = log.times_ns
        self._say("span", f"{first_ns} {last_ns}")
        self._say_marks(log)
        from_ns = 0
        while True:
            self._play_from(log, from_ns)
            if self._at_ns > last_ns:  # it is still written
                last_ns = self._at_ns
                self._say("span", f"{first_ns} {last_ns}")
            if self._wanted_ns is None:
                self._send(is_over=True)
            while self._wanted_ns is None:
                self._look(None, self._at_ns)
            is_end = self._wanted_ns > last_ns - NEAR_NS
            from_ns = last_ns + 1 if is_end else self._wanted_ns
            self._wanted_ns = None

    def _play_from(self, log: SeekableLog, from_ns: int) -> None:
        """From that time on, until its end or until another time is wanted."""
        self._batch.clear()
        self._pace.restart()
        is_there = from_ns == 0
        for item in log.read(max(0, from_ns - BEFORE_NS) if from_ns else 0):
            if (
                not isinstance(item, Logged)
                or item.topic not in TOPICS
                or not item.t_ns
            ):
                continue
            topic = BODY if item.topic == BODY_STATE else item.topic
            key = (item.probe, topic)
            payload = line_of(*key, item.data)
            if payload is None:
                self._left_out += 1
                continue
            if item.t_ns < from_ns:
                self._batch[key] = [payload]  # how things stood
                self._at_ns = item.t_ns
                continue
            if not is_there:
                is_there, self._at_ns = True, from_ns
                self._send()
            if item.t_ns - self._at_ns > GAP_NS:
                self._pace.restart()
            self._hold(item)
            if self._wanted_ns is not None:
                return
            self._at_ns = item.t_ns
            self._batch.setdefault(key, []).append(payload)

    def _hold(self, item: Logged) -> None:
        """Waits until a message is due, or another time is wanted."""
        while self._wanted_ns is None:
            wait_s = self._pace.wait_s(item.t_ns, time.monotonic())
            if wait_s > 0 or time.monotonic() - self._sent_s > BATCH_S:
                self._send()
                self._look(max(0.0, min(wait_s, PAUSE_S)), item.t_ns)
            if wait_s <= 0:
                return

    def _look(self, patience_s: float | None, at_ns: int) -> None:
        """Takes a line, if there is one within that time (None: waits for it)."""
        if select.select([self._lines], [], [], patience_s)[0]:
            line = self._lines.readline()
            if not line:
                sys.exit(0)
            if line.startswith(SEEK):
                self._wanted_ns = int(line.removeprefix(SEEK))
            else:
                self._pace.change(float(line), at_ns, time.monotonic())

    def _send(self, *, is_over: bool = False) -> None:
        self._sent_s = time.monotonic()
        for (probe, topic), payloads in self._batch.items():
            most = 1 if topic in LATEST_ONLY else BATCH_MAX
            step = max(1, -(-len(payloads) // most))
            for payload in payloads[::-1][::step][::-1]:
                self._write(probe, topic, payload)
        self._batch.clear()
        self._say("over" if is_over else "at", f"{self._at_ns} {self._left_out}")

    def _say_marks(self, log: SeekableLog) -> None:
        """All of them: they say where to go."""
        book, probes = MarkBook(), set()
        for mark in marks_of(log):
            probes.add(mark["probe"])
            book.take({**mark, "probe_id": mark["probe"]})
        for probe in probes:
            told = {"type": "marks", "probe": probe, "marks": book.of(probe)}
            self._say("marks", msgspec.json.encode(told).decode())

    def _say(self, what: str, value: str) -> None:
        self._write("", what, value.encode())
        self._out.flush()

    def _write(self, probe: str, topic: str, payload: bytes) -> None:
        parts = probe.encode(errors="replace"), topic.encode(), payload
        self._out.write(HEAD.pack(*map(len, parts)) + b"".join(parts))

    def fail(self, fault: Exception) -> None:
        """Tells why it ends."""
        why = str(fault) if isinstance(fault, ImudError) else described(fault)
        self._say("failed", why)


def main() -> int:
    path, speed = Path(sys.argv[1]), float(sys.argv[2])
    # Unbuffered, so that select() knows of every line.
    with os.fdopen(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as lines:
        player = Player(lines, sys.stdout.buffer, speed)
        try:
            player.play(path)
        except Exception as fault:  # noqa: BLE001 - told to who watches
            player.fail(fault)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
