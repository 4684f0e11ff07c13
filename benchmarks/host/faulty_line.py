# SPDX-License-Identifier: MIT
"""A probe behind a wire with injected faults, its session, and what truly arrived."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.common.source import PERIOD_US, Source
from imud.probes.ledger import totals
from imud.probes.record import Record, record_of
from imud.probes.session import Probe, Received, Session

CHUNK = 20  # frames a read: about what a USB bridge delivers at once
START_NS = 1_800_000_000_000_000_000

# One chunk in this many has the fault. In 12 h of 4 probes each occurs thousands of
# times, except those after which a probe has to be found again.
FAULTS = {"flip": 150, "cut": 400, "double": 300, "reset": 20_000, "unplug": 10_000}

# Chunks that pass without a port.
UNPLUGGED = 10

# Probe number n has a clock that is fast by n times as much.
FAST_PPM = 60.0

# Delay of a USB bridge, from writing a command until a probe receives it.
HEARD_AFTER_NS = 700_000

# Share of messages whose time may be outside of its stated bound.
DISHONEST_MAX = 0.01


@dataclass(slots=True)
class Truth:
    """The messages that arrived from one probe, found by comparing bytes, not by any
    CRC."""

    whole: int = 0  # frames that arrived as they were sent, copies included
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)  # of each boot
    unnamed: list[tuple[int, int]] = field(default_factory=list)  # boot, number
    rest: bytes = b""  # start of a frame that the last read cut off
    known: dict[bytes, int] = field(default_factory=dict)  # frames to their numbers
    before: dict[bytes, int] = field(
        default_factory=dict
    )  # the same of the previous chunk

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
        """Attribute the frames so far to the probe, whose hello has arrived."""
        for boot, number in self.unnamed:
            first, last = self.spans.get(boot, (number, number))
            self.spans[boot] = min(first, number), max(last, number)
        self.unnamed.clear()

    @property
    def accounted(self) -> int:
        """Messages from the first to the last whole one, summed over the boots."""
        return sum(last - first + 1 for first, last in self.spans.values())


class Line:
    """A probe, its wire with faults, and the session at the wire's other end."""

    def __init__(self, number: int, seed: int) -> None:
        self.source = Source(number, number * FAST_PPM)
        self.probe = Probe(self.source.name)
        self.truth = Truth()
        self.faults: Counter[str] = Counter()
        self.sessions: Counter[str] = Counter()
        self.wrong = 0  # messages passed on that were never sent like that
        self.received: Counter[str] = Counter()
        self.dated = Counter[bool]()  # messages with a time, by whether its bound held
        self._random = random.Random(f"{seed}/{number}")  # noqa: S311, no secrets
        self._session: Session | None = None
        self._away = 0

    def turn(self, now_us: int) -> Iterator[Record]:
        """Send one chunk, inject its fault, and yield what the session passes on."""
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
            # The plug goes in between any two bytes.
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
            self.wrong += not self.source.has_sent(event.content)
            self.received[event.message.name] += 1
            self._date(event)
            yield record_of(
                event.message,
                event.content,
                self.source.name,
                event.stamp,
                event.scales,
            )

    def _date(self, event: Received) -> None:
        """Check a message's time against the truth. Hellos answer time requests."""
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
            raise AssertionError("no frame is valid at the end")
        counts = self._session.counts()
        for name in ("bytes", "frames", "corrupt", "partial", "unnamed"):
            self.sessions[name] += counts[name]
        self.sessions["headless"] += sum(counts["headless"].values())
        self.truth.unnamed.clear()
        self._session = None

    def end(self) -> dict[str, Any]:
        """The ledger's counts beside the true ones."""
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
