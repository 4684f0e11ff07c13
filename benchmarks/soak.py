# SPDX-License-Identifier: MIT
"""Hours of frames in minutes, with faults from a seed: what the ledger says is compared
with what was truly sent and truly arrived, to the frame.

Frames go through decoder, ledger, clock, hub and two sinks: one that counts, and the
log, with files that are taken away when they are complete.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import scoring
from mcap.reader import make_reader

from imud.daemon.hub import Hub
from imud.daemon.lane import QUEUE_MAX, Item, Lane
from imud.log.file import Settings
from imud.probes.ledger import totals
from imud.probes.record import Record, record_of
from imud.probes.session import Probe, Received, Session
from imud.progress import Progress
from imud.sinks.log import LogSink
from imud.wire import messages, schema
from imud.wire.frame import encode_frame

OUTPUT = scoring.PROJECT / "build" / "benchmarks" / "soak.json"

RATE_HZ = 200
CHUNK = 20  # frames a read: what a USB bridge hands over at once, and a round number
PERIOD_US = 1_000_000 // RATE_HZ
START_NS = 1_800_000_000_000_000_000
LOG_BYTES = 32 << 20  # a file
RSS_POINTS = 10

# Chunks of which one has that fault. In 12 h of 4 probes each comes thousands of times,
# but for those after which a probe has to be found again.
FAULTS = {"flip": 150, "cut": 400, "double": 300, "reset": 20_000, "unplug": 10_000}

# Chunks of sampled time without a port.
UNPLUGGED = 10

# The probes' clocks are fast by so much, one more than the other.
FAST_PPM = 60.0

# After a command was written, until a probe hears it: what a USB bridge takes.
HEARD_AFTER_NS = 700_000

# Poses whose stated bound their time may miss.
DISHONEST_MAX = 0.01

_HEAD = struct.Struct(schema.HEADER)
_IDS = {message.name: message.id for message in schema.MESSAGES}
_POSE: dict[str, Any] = {
    "q": (0.5, 0.5, -0.5, 0.5),
    "position": (0.1, -0.2, 0.3),
    "normal": None,
    "tilt_sigma": 0.37,
    "heading_sigma": 1.25,
    "pose_flags": (),
}
_HELLO: dict[str, Any] = {
    "protocol_version": schema.PROTOCOL_VERSION,
    "schema_fingerprint": schema.FINGERPRINT,
    "firmware": "soak",
    "board": "nano",
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 178, 166),
    "self_test": (),
    "sample_rate": RATE_HZ,
    "pose_rate": RATE_HZ,
    "raw_rate": 0,
    "acc_lsb": 0.004788403,
    "gyr_lsb": 0.001065264,
    "mag_lsb": 0.15,
    "reset_cause": ("power_on",),
    "filter": "fuse",
    "reset_address": 0,
}


class Source:
    """A probe at work: a hello each second, poses in between."""

    def __init__(self, number: int, fast_ppm: float = 0.0) -> None:
        self._pace = 1.0 + fast_ppm * 1e-6
        self.id = bytes([0xF0, 0, 0, 0, 0, 0, 0, number])
        self.name = self.id.hex()
        self.boot_count = 1
        self.sequence = 0
        self.sent = 0
        self._began_us = 0
        self._bodies: set[tuple[bool, bytes]] = set()
        self._prepare()

    def _prepare(self) -> None:
        # No two boots say the same under the same number.
        pose = _POSE | {"position": (0.1, -0.2, self.boot_count / 1000)}
        self._pose = messages.encode("pose", pose, 0, 0)[_HEAD.size :]
        hello = _HELLO | {"probe_id": self.id, "boot_count": self.boot_count}
        self._hello = messages.encode("hello", hello, 0, 0)[_HEAD.size :]
        self._bodies |= {(False, self._pose), (True, self._hello)}

    def has_said(self, content: bytes) -> bool:
        """Whether that is, to the bit, what it said under that number in some boot."""
        ident, sequence, time_us = _HEAD.unpack_from(content)
        is_hello = sequence % RATE_HZ == 0
        return (
            ident == _IDS["hello" if is_hello else "pose"]
            and time_us == self._device_us(sequence * PERIOD_US) & 0xFFFFFFFF
            and (is_hello, content[_HEAD.size :]) in self._bodies
        )

    def _device_us(self, since_us: int) -> int:
        return int(since_us * self._pace)

    def true_us(self, device_us: int) -> float:
        """When that was, of the boot that runs."""
        return self._began_us + device_us / self._pace

    def reset(self, now_us: int) -> None:
        self.boot_count += 1
        self.sequence = 0
        self._began_us = now_us
        self._prepare()

    def say(self, now_us: int) -> bytes:
        name = "pose" if self.sequence % RATE_HZ else "hello"
        body = self._pose if name == "pose" else self._hello
        time_us = self._device_us(now_us - self._began_us) & 0xFFFFFFFF
        content = _HEAD.pack(_IDS[name], self.sequence, time_us) + body
        self.sequence += 1
        self.sent += 1
        return encode_frame(content)


@dataclass(slots=True)
class Truth:
    """What was on one probe's wire, known by its bytes and by no CRC."""

    whole: int = 0  # frames that arrived as they were sent, copies included
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)  # of each boot
    unnamed: list[tuple[int, int]] = field(default_factory=list)  # boot, number
    rest: bytes = b""  # of the frame that the last read ended in
    known: dict[bytes, int] = field(default_factory=dict)  # frames to their numbers
    before: dict[bytes, int] = field(default_factory=dict)  # those of the chunk before

    def sent(self, frames: Sequence[bytes], first: int) -> None:
        self.before = self.known
        numbers = range(first, first + len(frames))
        self.known = {
            frame[:-1]: number for frame, number in zip(frames, numbers, strict=True)
        }

    def arrived(self, data: bytes, boot: int) -> None:
        *segments, self.rest = (self.rest + data).split(b"\0")
        for segment in segments:
            number = self.known.get(segment)
            if number is None:
                number = self.before.get(segment)
            if number is not None:
                self.whole += 1
                self.unnamed.append((boot, number))

    def name(self) -> None:
        """Whose frames they are is known."""
        for boot, number in self.unnamed:
            first, last = self.spans.get(boot, (number, number))
            self.spans[boot] = min(first, number), max(last, number)
        self.unnamed.clear()

    @property
    def accounted(self) -> int:
        """From the first to the last whole one of each boot."""
        return sum(last - first + 1 for first, last in self.spans.values())


class Line:
    """A probe, its wire with faults, and the session at its end."""

    def __init__(self, number: int, seed: int) -> None:
        self.source = Source(number, number * FAST_PPM)
        self.probe = Probe(self.source.name)
        self.truth = Truth()
        self.faults: Counter[str] = Counter()
        self.sessions: Counter[str] = Counter()
        self.wrong = 0  # passed on, and never sent like that
        self.received: Counter[str] = Counter()
        self.dated = Counter[bool]()  # with a bound; whether that was honest
        self._random = random.Random(f"{seed}/{number}")  # noqa: S311, no secrets
        self._session: Session | None = None
        self._away = 0

    def turn(self, now_us: int) -> Iterator[Record]:
        """One chunk: said, hurt, heard."""
        fault = self._fault()
        source, truth = self.source, self.truth
        first = source.sequence
        begin_us = now_us - CHUNK * PERIOD_US
        frames = [source.say(begin_us + i * PERIOD_US) for i in range(CHUNK)]
        truth.sent(frames, first)
        data = b"".join(frames)
        t_ns = START_NS + now_us * 1000
        if self._away > 0:
            self._away -= 1
            return
        if self._session is None:
            self._session = Session(lambda _: self.probe, t_ns)
            truth.rest = b""
            # Plugged in between any two bytes.
            data = data[self._random.randrange(len(data)) :]
        data = self._hurt(data, frames, fault)
        truth.arrived(data, source.boot_count)
        events = self._session.receive(data, t_ns)
        if self._session.probe is not None:
            truth.name()
        yield from self._hear(events)
        if fault == "reset":
            source.reset(now_us)
        if fault == "unplug":
            self.unplug()
            self._away = UNPLUGGED

    def _fault(self) -> str:
        for name, one_of in FAULTS.items():
            if self._random.randrange(one_of) == 0:
                self.faults[name] += 1
                return name
        return ""

    def _hurt(self, data: bytes, frames: Sequence[bytes], fault: str) -> bytes:
        at = self._random.randrange(len(data))
        if fault == "flip":
            bit = 1 << self._random.randrange(8)
            return data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :]
        if fault == "cut":
            return data[:at] + data[at + self._random.randrange(1, 200) :]
        if fault == "double":
            some = self._random.randrange(1, CHUNK + 1)
            return data + b"".join(frames[-some:])
        if fault in ("reset", "unplug"):
            return data[:at]
        return data

    def _hear(self, events: Sequence[Any]) -> Iterator[Record]:
        for event in events:
            if not isinstance(event, Received):
                continue
            self.wrong += not self.source.has_said(event.content)
            self.received[event.message.name] += 1
            self._date(event)
            yield record_of(
                event.message,
                event.content,
                self.source.name,
                event.stamp,
                event.probe.hello,
                event.probe.hello_content,
            )

    def _date(self, event: Received) -> None:
        """Looks at when it is said to have been; each hello answers a question."""
        stamp = event.stamp
        true_ns = START_NS + self.source.true_us(stamp.t_device_us) * 1000
        if stamp.t_ns is not None and stamp.t_bound_ns is not None:
            self.dated[abs(stamp.t_ns - true_ns) <= stamp.t_bound_ns] += 1
        if event.message.name == "hello":
            written_ns = round(true_ns) - HEARD_AFTER_NS
            self.probe.clock.heard(stamp.t_device_us, written_ns)

    def unplug(self) -> None:
        if self._session is None:
            return
        for _ in self._hear(self._session.close()):
            raise AssertionError("nothing becomes good at the end")
        counts = self._session.counts()
        for name in ("bytes", "frames", "corrupt", "partial", "unnamed"):
            self.sessions[name] += counts[name]
        self.sessions["headless"] += sum(counts["headless"].values())
        self.truth.unnamed.clear()
        self._session = None

    def end(self) -> dict[str, Any]:
        """What the ledger says, beside what was."""
        self.unplug()
        counts: Any = self.probe.account.counts()
        total = totals(counts)
        ledger = {
            "sent": total.sent,
            "received": total.received,
            "lost": total.lost,
            "duplicated": total.duplicated,
            "skewed": total.skewed.total(),
            "strays": counts["strays"],
            "unplaced": sum(counts["unplaced"].values()),
            "unnamed": self.sessions["unnamed"],
            "headless": self.sessions["headless"],
        }
        heard = sum(ledger.values()) - ledger["sent"] - ledger["lost"]
        return {
            "probe": self.source.name,
            "sent": self.source.sent,
            "accounted": self.truth.accounted,
            "whole": self.truth.whole,
            "wrong": self.wrong,
            "boots": [self.source.boot_count, counts["boots"]],
            "faults": dict(self.faults),
            "ledger": ledger,
            "corrupt": self.sessions["corrupt"],
            "partial": self.sessions["partial"],
            "heard": heard,
            "passed_on": self.received.total(),
            "dated": self.dated.total(),
            "outside_bound": self.dated[False],
            "adds_up": {
                "each boot": total.sent
                == total.received + total.skewed.total() + total.lost,
                "sent": total.sent == self.truth.accounted,
                "heard": heard == self.truth.whole,
                "received": total.received == self.received.total(),
                "none wrong": self.wrong == 0,
                "time": self.dated[False] <= DISHONEST_MAX * self.dated.total(),
            },
        }


class Counting:
    """A sink that counts, by probe and topic."""

    name = "count"
    period_s = 0.05
    patience_s = 60.0

    def __init__(self) -> None:
        self.taken: Counter[tuple[str, str]] = Counter()

    def open(self) -> None:
        """Nothing to open."""

    def take(self, record: Item) -> None:
        if isinstance(record, Record):
            self.taken[record.probe, record.topic] += 1

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing to close."""


@dataclass(slots=True)
class Pruned:
    """Log files that were complete, read back and taken away."""

    folder: Path
    files: int = 0
    bytes: int = 0
    frames: int = 0

    def prune(self, *, is_end: bool = False) -> None:
        files = sorted(self.folder.glob("*.mcap"), key=lambda path: path.stat().st_ino)
        files.sort(key=lambda path: path.stat().st_mtime_ns)
        for path in files if is_end else files[:-1]:
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            if summary is None or summary.statistics is None:
                continue  # not complete yet
            counts = summary.statistics.channel_message_counts
            self.frames += sum(
                counts.get(channel.id, 0)
                for channel in summary.channels.values()
                if channel.topic.endswith("/frame")
            )
            self.files += 1
            self.bytes += path.stat().st_size
            path.unlink()


def rss_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def wait_for(lanes: Sequence[Lane]) -> None:
    """Sinks are not outrun: here time is not the sensor's."""
    while any(lane.waiting > QUEUE_MAX // 4 for lane in lanes):
        time.sleep(0.002)


def soak(hours: float, probes: int, seed: int, folder: Path) -> dict[str, Any]:
    """Runs it all; `ok` says whether all of it adds up."""
    lines = [Line(number, seed) for number in range(probes)]
    counting = Counting()
    log = LogSink(folder, Settings(rotate_bytes=LOG_BYTES))
    hub, pruned = Hub(), Pruned(folder)
    lanes = [hub.add(counting), hub.add(log)]
    turns = max(1, round(hours * 3600 * RATE_HZ / CHUNK))
    points: list[dict[str, float]] = []
    progress = Progress("soak", turns)
    begin_s = time.monotonic()
    try:
        for turn in range(turns):
            now_us = (turn + 1) * CHUNK * PERIOD_US
            for line in lines:
                for record in line.turn(now_us):
                    hub.put(record)
            wait_for(lanes)
            if turn % 500 == 499:
                pruned.prune()
            if (turn + 1) * RSS_POINTS // turns > len(points):
                points.append({"hours": now_us / 3.6e9, "rss_mib": rss_mib()})
            progress.update(turn + 1)
    finally:
        progress.end()
        hub.close()
    pruned.prune(is_end=True)
    results = [line.end() for line in lines]
    passed_on = sum(result["passed_on"] for result in results)
    adds_up = {
        "counted": counting.taken.total() == passed_on,
        "logged": pruned.frames == passed_on,
        "dropped": not any(
            sum(hub.dropped(line.source.name).values()) for line in lines
        ),
    }
    seconds = time.monotonic() - begin_s
    return {
        "hours": hours,
        "seed": seed,
        "seconds": seconds,
        "frames_a_second": sum(result["sent"] for result in results) / seconds,
        "probes": results,
        "sinks": adds_up,
        "log": {"files": pruned.files, "bytes": pruned.bytes, "frames": pruned.frames},
        "memory": points,
        "ok": all(adds_up.values())
        and all(all(result["adds_up"].values()) for result in results),
    }


def tell(result: dict[str, Any]) -> None:
    """One table, and what does not add up."""
    heads = ("sent", "accounted", "received", "lost", "duplicated", "corrupt", "wrong")
    print(f"{'probe':18}" + "".join(f"{head:>12}" for head in heads))
    for each in result["probes"]:
        row = {**each, **{k: v for k, v in each["ledger"].items() if k != "sent"}}
        print(f"{each['probe']:18}" + "".join(f"{row[head]:12,}" for head in heads))
    faults: Counter[str] = Counter()
    for each in result["probes"]:
        faults.update(each["faults"])
    dated, outside = (
        sum(each[key] for each in result["probes"])
        for key in ("dated", "outside_bound")
    )
    print(f"dated: {dated:,}, {outside:,} of them outside of their bound")
    print("faults: " + ", ".join(f"{n:,} {name}" for name, n in sorted(faults.items())))
    log = result["log"]
    print(
        f"log: {log['files']} files, {log['bytes']:,} bytes, {log['frames']:,} frames"
    )
    rss = ", ".join(f"{point['rss_mib']:.0f}" for point in result["memory"])
    print(f"resident MiB along the way: {rss}")
    print(f"{result['frames_a_second']:,.0f} frames/s, {result['seconds']:.0f} s")
    for each in result["probes"]:
        for name, is_so in each["adds_up"].items():
            if not is_so:
                print(f"{each['probe']}: {name} does not add up: {each}")
    for name, is_so in result["sinks"].items():
        if not is_so:
            print(f"sinks: {name} does not add up")
    print("all adds up" if result["ok"] else "it does NOT add up")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument("--probes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        result = soak(options.hours, options.probes, options.seed, Path(folder))
    tell(result)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(result, indent=1) + "\n")
    return 0 if result["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
