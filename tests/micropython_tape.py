# SPDX-License-Identifier: MIT
"""Samples and commands for the module imuprobe, as tests/micropython/feed.py reads
them, and what it makes of them in a MicroPython on this machine."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from imud.virtual import sensors
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

Command = tuple[str, ...]

FEED = Path(__file__).parent / "micropython" / "feed.py"
RATE_HZ = 200
MAG_NULL = -32768
ABOUT = (int(schema.Sensor.MPU9250), RATE_HZ, 4788403, 1065264, 150000, 0x71)
LSB = (4788403e-9, 1065264e-9, 0.15)  # m/s2, rad/s and uT: the same
ALL = int(schema.StreamFlags.POSE | schema.StreamFlags.RAW)


@dataclass
class Tape:
    """Samples and commands as feed.py reads them."""

    data: bytearray = field(default_factory=bytearray)
    tokens: int = 0

    def sample(self, time_us: int, values: Iterable[int]) -> None:
        self.data += struct.pack("<I11h", time_us, *values)

    def sensor(self, time_us: int, *about: int) -> None:
        """Kind, rate, lsb of acceleration, rate and field, WHO_AM_I."""
        self.data += struct.pack("<8I", 0xFFFFFFFE, *about, time_us)

    def command(
        self, time_us: int, name: str, first: int = 0, second: int = 0, size: int = 99
    ) -> None:
        """In pieces of `size` bytes."""
        self.tokens += 1
        fields = {
            "command": name,
            "token": self.tokens,
            "arguments": (first, second),
        }
        frame = encode_frame(encode("command", fields, self.tokens, 0))
        for at in range(0, len(frame), size):
            piece = frame[at : at + size]
            self.data += struct.pack("<III", 0xFFFFFFFF, time_us, len(piece)) + piece


def hand(seconds: float) -> list[tuple[int, tuple[int, ...]]]:
    """A hand's motion as samples: device time, us, and the values of a raw message."""
    moved = sensors.generate(seconds, seed=3)
    step = round(moved.rate_hz / RATE_HZ)
    kinds = zip((moved.acc, moved.gyr, moved.mag), LSB, strict=True)
    counts = np.hstack([np.rint(kind[::step] / lsb) for kind, lsb in kinds])
    rows = np.clip(counts, -32767, 32767).astype(int)
    found = []
    for number, row in enumerate(rows):
        acc_gyr, mag = tuple(row[:6]), tuple(row[6:])
        has_mag = number % 2 == 0
        values = (*acc_gyr, *(mag if has_mag else (MAG_NULL,) * 3), 2500, 0)
        found.append((1000 + number * 5000, values))
    return found


def fed(
    micropython: Command, tape: Tape, folder: Path, memory: Path | None = None
) -> list[bytes]:
    """The contents that the module sends for a tape."""
    samples, frames = folder / "samples", folder / "frames"
    samples.write_bytes(tape.data)
    words = [*micropython, FEED, samples, frames, memory or folder / "memory"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    decoder = FrameDecoder()
    contents = decoder.feed(frames.read_bytes())
    assert len(contents) == frames.read_bytes().count(0)
    return contents


def sent(contents: Iterable[bytes], name: str) -> list[Message]:
    messages = [decode(content) for content in contents]
    return [m for m in messages if isinstance(m, Message) and m.name == name]


def taped(raws: list[Message], about: tuple[int, ...]) -> Tape:
    """A stream of poses and raw samples, which are those of these messages."""
    tape = Tape()
    tape.command(1, "rate", 1, about[1])
    tape.command(2, "fields", ALL)
    tape.command(3, "start")
    tape.sensor(raws[0].time_us - 1000, *about)
    flags = {flag.name.lower(): flag for flag in schema.SampleFlags if flag.name}
    for raw in raws:
        told = raw.fields
        mag = told["mag"] or (MAG_NULL,) * 3
        cdeg = round(float(told["temperature"]) * 100)
        bits = sum(int(flags[name]) for name in told["sample_flags"])
        tape.sample(raw.time_us, (*told["acc"], *told["gyr"], *mag, cdeg, bits))
    return tape
