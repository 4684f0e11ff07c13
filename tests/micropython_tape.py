# SPDX-License-Identifier: MIT
"""Samples and commands for the module imuprobe, as tests/micropython/feed.py reads
them, and what it makes of them in a MicroPython on this machine."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

from benchmarks.firmware.micropython import ABOUT, ALL, MAG_NULL, RATE_HZ, Tape, hand
from imud.wire import schema
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode

__all__ = ("ABOUT", "ALL", "RATE_HZ", "Command", "Tape", "fed", "hand", "sent", "taped")

Command = tuple[str, ...]

FEED = Path(__file__).parent / "micropython" / "feed.py"


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
