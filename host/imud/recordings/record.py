# SPDX-License-Identifier: MIT
"""`imud record`: writes the messages of daemons on any host to logs, and reports
sequence gaps. docs/fleet.md shows where it stands.
"""

from __future__ import annotations

import json
import signal
import struct
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from imud.client.client import Client, Delivery
from imud.client.missed import Followed, Missed, Series
from imud.errors import FileError
from imud.log.file import Settings
from imud.net.access import READS
from imud.probes.record import Record
from imud.published import WIRE, Numbered
from imud.sinks.log import FLUSH_S, LogSink
from imud.wire import schema
from imud.wire.frame import HELLO_ID

TOPICS = READS["recorder"]
GAP = "gap"  # topic of the recorder's own records: what is missing before a message

# Topics whose messages are numbered without gaps.
NUMBERED = frozenset(WIRE)

# Messages that may wait for the disk: 5 s of 64 probes at 200 Hz, poses and frames.
WAITING_MAX = 128_000

_HEADER = struct.Struct(schema.HEADER)

Arrival = tuple[str, Delivery, int]  # topic, message, UTC in ns


class Recorder:
    """Writes everything that a client hears, or everything of one probe. Deliveries
    come in threads of Zenoh; write() is called in one thread.
    """

    def __init__(
        self, client: Client, directory: Path, settings: Settings, probe: str | None
    ) -> None:
        for topic in TOPICS:
            client.check_may(topic)
        self._sink = LogSink(directory, settings)
        self._has_foxglove = settings.has_foxglove
        self._numbered = msgspec.json.Decoder(Numbered)
        self._encoder = msgspec.json.Encoder()
        self._lock = threading.Lock()
        self._waiting: deque[Arrival] = deque()
        self._series = Followed(probe)
        self._hellos: dict[str, bytes] = {}
        self._params: dict[str, bytes] = {}
        self.overflowed: Counter[str] = Counter()  # by probe: the disk was too slow
        self.unwritten: Counter[str] = Counter()  # by probe: the disk took none
        self.written: Counter[str] = Counter()  # by probe
        self.trouble = ""  # why nothing is written; empty: it is
        self._sink.open()
        for topic in TOPICS:
            client.listen(topic, probe, partial(self._put, topic))

    @property
    def path(self) -> Path | None:
        """The file that is written."""
        return self._sink.path

    def _put(self, topic: str, delivery: Delivery) -> None:
        with self._lock:
            if len(self._waiting) >= WAITING_MAX:
                self.overflowed[self._waiting.popleft()[1].probe] += 1
            self._waiting.append((topic, delivery, time.time_ns()))

    def write(self) -> None:
        """Hands the kernel what has arrived so far."""
        with self._lock:
            arrived, self._waiting = self._waiting, deque()
        for topic, delivery, t_ns in arrived:
            self._receive(topic, delivery, t_ns)
        self._attempt("", self._sink.flush)

    def close(self) -> None:
        self.write()
        self._attempt("", self._sink.close)

    def _attempt(self, probe: str, action: Callable[[], None]) -> None:
        try:
            action()
        except FileError as error:
            self.trouble = str(error)
            if probe:
                self.unwritten[probe] += 1
        else:
            if probe:
                self.trouble = ""
                self.written[probe] += 1

    def _receive(self, topic: str, delivery: Delivery, t_ns: int) -> None:
        probe, payload = delivery.probe, delivery.payload
        if topic == "frame":
            values: Mapping[str, Any] = {}
            if len(payload) < _HEADER.size:
                return
            ident, sequence, _ = _HEADER.unpack_from(payload)
            if ident == HELLO_ID:
                self._hellos[probe] = payload
            self._write(probe, topic, payload, b"", sequence, t_ns, t_ns, values)
            return
        sequence, sampled_ns, values = 0, t_ns, {}
        if topic in NUMBERED:
            try:
                message = self._numbered.decode(payload)
            except msgspec.DecodeError:
                self._of(delivery, topic).unreadable += 1
                return
            sequence = message.seq & 0xFFFFFFFF
            sampled_ns = t_ns if message.t_ns is None else message.t_ns
            if not self._count(topic, message, delivery, t_ns):
                return
            if topic == "pose" and self._has_foxglove:
                values = json.loads(payload)
        elif topic == "params":
            self._params[probe] = _records(payload)
        self._write(probe, topic, b"", payload, sequence, sampled_ns, t_ns, values)

    def _count(
        self, topic: str, message: Numbered, delivery: Delivery, t_ns: int
    ) -> bool:
        """Notes what is missing before this message; False for a duplicate."""
        series = self._of(delivery, topic)
        before, last = series.missed(), series.last
        if not series.count(message, delivery.source):
            return False
        missed = series.missed()
        if missed != before:
            gap = {
                "type": GAP,
                "probe": delivery.probe,
                "t_ns": t_ns,
                "topic": topic,
                "after": last,
                "before": message.number,
                "network": missed.network - before.network,
                "wire": missed.wire - before.wire,
                "daemon_restarts": missed.daemon_restarts - before.daemon_restarts,
            }
            payload = self._encoder.encode(gap)
            self._write(delivery.probe, GAP, b"", payload, 0, t_ns, t_ns, {})
        return True

    def _write(
        self,
        probe: str,
        topic: str,
        content: bytes,
        payload: bytes,
        sequence: int,
        t_ns: int,
        received_ns: int,
        values: Mapping[str, Any],
    ) -> None:
        record = Record(
            *(probe, topic, payload, content, sequence, t_ns, received_ns),
            hello=self._hellos.get(probe, b""),
            params=self._params.get(probe),
            values=values,
        )
        self._attempt(probe, lambda: self._sink.write(record))

    def _of(self, delivery: Delivery, topic: str) -> Series:
        return self._series.of(delivery.probe, delivery.probe_id, topic)

    def missed(self, probe: str | None = None) -> Missed:
        """Missing messages so far, of one probe or of all."""
        return self._series.missed(probe)

    def summary(self) -> dict[str, Any]:
        """Counts of each probe, as JSON values."""
        probes = sorted(self.written | self.unwritten | self.overflowed)
        return {
            probe: {
                "written": self.written[probe],
                "unwritten": self.unwritten[probe] + self.overflowed[probe],
                "missed": msgspec.to_builtins(self.missed(probe)),
                "last": self._series.last(probe),
            }
            for probe in probes
        }


def _records(payload: bytes) -> bytes:
    """The records in a payload of the topic `params`; empty: it has none."""
    try:
        return bytes.fromhex(str(json.loads(payload)["bytes"]))
    except (ValueError, KeyError, TypeError):
        return b""


def run(
    client: Client,
    directory: Path,
    settings: Settings,
    probe: str | None,
    seconds: float | None,
    *,
    as_json: bool,
) -> int:
    """Records until SIGTERM, SIGINT or for `seconds`; then prints a summary."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    recorder = Recorder(client, directory, settings, probe)
    sys.stderr.write(f"records to {recorder.path or directory}\n")
    until_s = None if seconds is None else time.monotonic() + seconds
    trouble = ""
    while not stop.wait(FLUSH_S):
        recorder.write()
        if recorder.trouble != trouble:
            trouble = recorder.trouble
            sys.stderr.write(f"{trouble or 'records again'}\n")
        if until_s is not None and time.monotonic() >= until_s:
            break
    recorder.close()
    summary = recorder.summary()
    if as_json:
        sys.stdout.write(f"{json.dumps(summary)}\n")
        return 0
    for name, of in summary.items():
        missed = of["missed"]
        sys.stdout.write(
            f"{name}: {of['written']} messages written, {of['unwritten']} not; "
            f"missing {missed['network']} on the network, {missed['wire']} on the "
            "wire\n"
        )
    return 0
