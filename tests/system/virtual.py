# SPDX-License-Identifier: MIT
"""Runs of the virtual probe: the image as flashed, in its emulator."""

from __future__ import annotations

import dataclasses
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud.recordings import decode
from imud.virtual import motion, sensors
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, encode
from imud.wire.messages import decode as decode_content
from length import choose
from programs import ran


@dataclass(frozen=True, slots=True)
class Board:
    """The properties of one board, for tests of all boards."""

    name: str
    rate_hz: int  # samples
    clock_hz: int
    flash: int  # bytes that an image may take
    ram: int  # bytes, the stack's included
    stack: int | None  # bytes of its own; None: what variables leave of the RAM
    # Of the wait for the instant that is due: a sample at most, where the rate of poses
    # does not divide that of samples.
    unevenness_us: int
    ready_us: int  # set-up of the sensor is over, in a start without settings
    # Of the transactions on the sensor's bus: some of set-up; one while it streams; its
    # bytes, and those that the chip acknowledges: addresses and registers.
    setup_transactions: tuple[int, ...]
    transaction: int
    transaction_bytes: int
    acknowledged: tuple[int, ...]
    no_mag: str  # the fault
    has_relatives: bool  # chips of other identities run as well
    # Registers of the sensor with a value that is not the firmware's, as a fault.
    kept_registers: tuple[dict[str, int], ...]
    write_us: int  # a power cut so long after a write began is in its midst
    options: tuple[str, ...] = ()  # of its emulator
    brown_out: str = "brown_out"  # how it tells one


NANO = Board(
    name="nano",
    rate_hz=200,
    clock_hz=16_000_000,
    flash=30 * 1024,  # what the old bootloader leaves
    ram=2048,
    stack=None,
    unevenness_us=20,
    ready_us=690_000,
    setup_transactions=(2, 20, 55, 70),
    transaction=500,
    transaction_bytes=25,  # one burst of 22
    acknowledged=(0, 1, 2),
    no_mag="no_ak8963",
    has_relatives=True,
    kept_registers=({"reg": 26, "value": 0}, {"reg": 28, "value": 0}),
    write_us=900,
)
F405 = Board(
    name="f405",
    rate_hz=380,
    clock_hz=168_000_000,
    flash=768 * 1024,  # what the settings leave
    ram=192 * 1024,
    stack=8 * 1024,
    unevenness_us=1_000_000 // 380 + 30,
    ready_us=1_200_000,
    setup_transactions=(2, 20, 60, 100, 139),
    transaction=500,
    transaction_bytes=32,  # three bursts, of 7, 7 and 9, with no STOP between them
    acknowledged=(0, 1, 2, 10, 11, 12, 20, 21, 22),
    no_mag="no_mag",
    has_relatives=False,
    kept_registers=(
        {"die": 1, "reg": 0x23, "value": 0},
        {"die": 2, "reg": 0x21, "value": 0},
    ),
    write_us=8,
)
PICO = dataclasses.replace(
    NANO,  # with the same sensor
    name="pico",
    clock_hz=125_000_000,
    flash=(2048 - 64) * 1024,  # what the settings leave
    ram=264 * 1024,
    stack=4 * 1024,
    ready_us=712_000,
    write_us=100,
    brown_out="power_on",  # which the chip tells from it no more
    options=("--wire", "uart"),  # which has all that is said before a host is there
)
MEGA = dataclasses.replace(
    NANO,  # the same with more memory
    name="mega",
    flash=(256 - 8) * 1024,  # what the bootloader leaves
    ram=8 * 1024,
)
BOARDS = {board.name: board for board in (NANO, F405)}
# Of the one the emulator is slower, and needs what `make demo` does not install; the
# other is the Nano again.
BOARDS |= choose(everyday={}, long={board.name: board for board in (PICO, MEGA)})

ALL_BOARDS = BOARDS | {board.name: board for board in (PICO, MEGA)}
every_board = pytest.mark.parametrize("stub", [*BOARDS], indirect=True)


@dataclass(frozen=True, slots=True)
class Stub:
    """Where a run's files are and what the simulator needs to start."""

    board: Board
    simulator: Path
    image: Path
    folder: Path

    @property
    def raw_too(self) -> tuple[str, ...]:
        """Options that have all raw samples sent, too."""
        rate = send("rate", 1, self.board.rate_hz, token=6)
        return ("--send", f"320000:{FIELDS_ALL}", "--send", f"330000:{rate}")

    def stack_room(self, summary: Mapping[str, Any]) -> int:
        """Bytes that the stack may take."""
        return self.board.stack or self.board.ram - int(summary["ram"])


@dataclass(frozen=True)
class Run:
    """The results of a run."""

    record: Path
    summary: dict[str, Any]
    code: int

    @cached_property
    def contents(self) -> list[bytes]:
        """The good frames' contents, in order."""
        return FrameDecoder().feed(self.record.read_bytes())

    @cached_property
    def messages(self) -> list[Message]:
        """All messages; a skewed one fails the test."""
        decoded = [decode_content(content) for content in self.contents]
        assert all(isinstance(message, Message) for message in decoded)
        return [message for message in decoded if isinstance(message, Message)]

    def named(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]

    @cached_property
    def events(self) -> list[tuple[Any, Any]]:
        """Event and cause, in order."""
        return [(m.fields["event"], m.fields["cause"]) for m in self.named("event")]

    @property
    def last_status(self) -> Mapping[str, Any]:
        return self.named("status")[-1].fields

    @property
    def account(self) -> dict[str, Any]:
        tally = decode.Tally()
        for _ in decode.decode_file(self.record, tally):
            pass
        (probe,) = tally.probes.values()
        return probe.account.counts()


def send(name: str, first: int = 0, second: int = 0, token: int = 1) -> str:
    """A command for --send, in hex: after a zero, as a host sends it."""
    fields = {"command": name, "token": token, "arguments": (first, second)}
    return (b"\0" + encode_frame(encode("command", fields, token, 0))).hex()


FIELDS_ALL = send("fields", schema.StreamFlags.POSE | schema.StreamFlags.RAW, token=7)


def run(
    stub: Stub,
    seconds: float,
    *options: object,
    faults: Sequence[Mapping[str, Any]] = (),
    code: int = 0,
) -> Run:
    """Runs the image for some seconds, as fast as it goes."""
    number = len(list(stub.folder.glob("uart-*.bin")))
    record = stub.folder / f"uart-{number}.bin"
    summary = stub.folder / "summary.json"
    words = ["--image", stub.image, "--record", record, "--summary", summary]
    words += ["--fast", "--seconds", seconds, *stub.board.options, *options]
    if faults:
        listed = stub.folder / "faults.json"
        listed.write_text(json.dumps(list(faults)))
        words += ["--faults", listed]
    done = ran(stub.simulator, *map(str, words))
    assert done.returncode == code, done.stderr
    return Run(record, json.loads(summary.read_text()), done.returncode)


def damaged(stub: Stub, address: int, instruction: int) -> Stub:
    """The same image, of whose flash one instruction has gone bad."""
    elf = bytearray(stub.image.read_bytes())
    (table,) = struct.unpack_from("<I", elf, 28)  # e_phoff
    size, count = struct.unpack_from("<HH", elf, 42)
    for number in range(count):
        _, offset, begin, _, length = struct.unpack_from(
            "<5I", elf, table + number * size
        )
        if begin <= address < begin + length:
            struct.pack_into("<H", elf, offset + address - begin, instruction)
    image = stub.folder / "damaged.elf"
    image.write_bytes(elf)
    return dataclasses.replace(stub, image=image)


def write_hand(path: Path, seconds: float, seed: int = 3) -> Path:
    """A hand that moves the probe, as the simulator's stream."""
    hand = sensors.generate(seconds, seed=seed)
    with path.open("wb") as file:
        motion.write_stream(file, [hand], count=len(hand))
    return path


def write_rest(path: Path, seconds: float) -> Path:
    """At rest, with the noise of a sensor that lives, as the simulator's stream."""
    noise = np.random.default_rng(3).standard_normal((3, round(1000 * seconds), 3))
    still = motion.Motion(
        1000.0,
        gyr=np.deg2rad(0.1) * noise[0],
        acc=0.05 * noise[1] + [0.0, 0.0, 9.80665],
        mag=0.6 * noise[2] + [0.0, 20.0, -40.0],
    )
    with path.open("wb") as file:
        motion.write_stream(file, [still], count=len(still))
    return path


def assert_nothing_is_lost(done: Run) -> None:
    summary = done.summary
    assert not summary["crashed"]
    assert summary["firmware_complaint"] is None
    assert summary["sensor_complaint"] is None
    assert summary["late"] == 0
    assert done.last_status["overruns"] == 0
    assert done.last_status["messages_dropped"] == 0
    assert done.account["lost"] == 0
    assert len(done.contents) == summary["frames"]
