# SPDX-License-Identifier: MIT
"""The module imuprobe in MicroPython on this machine: the probe of core/, in every
bit."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from bits.processors import replayed
from core.stroke_desk import measured
from imud.virtual import sensors
from imud.virtual.stroking import Plan
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode
from stroke_bench import feel
from system.virtual import F405, Stub, run, write_hand
from twin_bench import followed, message_of, named

pytestmark = pytest.mark.long

FEED = Path(__file__).with_name("feed.py")
RATE_HZ = 200
MAG_NULL = -32768
ABOUT = (int(schema.Sensor.MPU9250), RATE_HZ, 4788403, 1065264, 150000, 0x71)
LSB = (4788403e-9, 1065264e-9, 0.15)  # m/s2, rad/s and uT: the same
LSM9DS0 = (int(schema.Sensor.LSM9DS0), 380, 7178468, 1221730, 8000, 0xD4)
SECONDS = 62
STROKE = 0x14
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
    micropython: Path, tape: Tape, folder: Path, memory: Path | None = None
) -> list[bytes]:
    """The contents that the module sends for a tape."""
    samples, frames = folder / "samples", folder / "frames"
    samples.write_bytes(tape.data)
    words = [micropython, FEED, samples, frames, memory or folder / "memory"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    decoder = FrameDecoder()
    contents = decoder.feed(frames.read_bytes())
    assert len(contents) == frames.read_bytes().count(0)
    return contents


def sent(contents: Iterable[bytes], name: str) -> list[Message]:
    messages = [decode(content) for content in contents]
    return [m for m in messages if isinstance(m, Message) and m.name == name]


def test_its_poses_are_those_of_the_native_core(
    micropython: Path, tmp_path: Path
) -> None:
    tape = Tape()
    tape.command(1, "rate", 1, RATE_HZ)
    tape.command(2, "fields", ALL)
    tape.command(3, "start")
    tape.sensor(4, *ABOUT)
    for number, (time_us, values) in enumerate(hand(SECONDS)):
        tape.sample(time_us, values)
        if number == 1000:
            tape.command(time_us + 100, "tare", 1)
        if number == 1500:
            tape.command(time_us + 100, "restart", int(schema.Filter.MAHONY))
    contents = fed(micropython, tape, tmp_path)
    poses = [content for content in contents if content[0] == 0x06]
    assert len(poses) > 100 * (SECONDS - 1)
    assert poses == list(replayed(contents))
    status = sent(contents, "status")[-1].fields
    assert status["messages_dropped"] == 0
    assert status["samples_read"] == status["samples_fused"]


def test_it_takes_commands_in_any_pieces(micropython: Path, tmp_path: Path) -> None:
    runs = []
    for size in (99, 1, 7):
        tape = Tape()
        for number, name in enumerate(("start", "rate", "fields", "stop")):
            tape.command(100 + number, name, 1, 50, size)
        runs.append(fed(micropython, tape, tmp_path))
    replies = [reply.fields["result"] for reply in sent(runs[0], "reply")]
    assert replies == ["ok"] * 4
    assert runs[1] == runs[2] == runs[0]


def test_its_settings_survive_and_a_boot_is_counted(
    micropython: Path, tmp_path: Path
) -> None:
    memory = tmp_path / "settings"
    counts = []
    for _ in range(3):
        tape = Tape()
        tape.command(100, "rate", 0, 50)
        tape.sensor(101, *ABOUT)
        for time_us, values in hand(2):
            tape.sample(time_us, values)
        hellos = sent(fed(micropython, tape, tmp_path, memory), "hello")
        counts.append((hellos[0].fields["boot_count"], hellos[0].fields["pose_rate"]))
        assert {hello.fields["probe_id"] for hello in hellos} == {fnv(b"host")}
    assert counts == [(1, 100), (2, 50), (3, 50)]


def fnv(data: bytes) -> bytes:
    """FNV-1a of 64 bits, little endian."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value.to_bytes(8, "little")


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


def test_its_strokes_are_those_of_the_native_core(
    micropython: Path, tmp_path: Path
) -> None:
    scene = measured(Plan(strokes=2), 7)
    life = feel(followed(), scene.samples, scene.held() & False)
    about = message_of(life.contents[named(life.contents, "hello")[-1]]).fields
    scales = [round(about["acc_lsb"] * 1e9), round(about["gyr_lsb"] * 1e9)]
    scales += [round(about["mag_lsb"] * 1e6), ABOUT[-1]]
    raws = [message_of(life.contents[at]) for at in named(life.contents, "raw")]
    kind = int(schema.Sensor[str(about["sensor"]).upper()])
    contents = fed(micropython, taped(raws, (kind, RATE_HZ, *scales)), tmp_path)
    theirs, ours = (
        [content[5:] for content in each if content[0] == STROKE]
        for each in (life.contents, contents)
    )
    assert len(theirs) > 10
    assert ours == theirs


def test_the_samples_of_the_c_board_give_its_poses(
    micropython: Path, f405: Path, f405_image: Path, tmp_path: Path
) -> None:
    stub = Stub(F405, f405, f405_image, tmp_path)
    moved = write_hand(tmp_path / "hand", SECONDS)
    words = ("--motion", moved, "--press", "200000:300000", *stub.raw_too)
    done = run(stub, SECONDS, *words)
    tape = taped(done.named("raw"), LSM9DS0)
    contents = fed(micropython, tape, tmp_path)
    theirs, ours = (
        [content[5:] for content in each if content[0] == 0x06]  # but for their numbers
        for each in (done.contents, contents)
    )
    assert len(ours) > 100 * (SECONDS - 2)
    assert ours == theirs
