# SPDX-License-Identifier: MIT
"""The surroundings of a Nano that runs in avr8js: the sensor's model in C, byte by byte
on the bus, its motion, the button, and the host on the UART.
"""

from __future__ import annotations

import contextlib
import math
import struct
import subprocess
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import native
from imud.wire.frame import FrameDecoder

ROOT = Path(__file__).resolve().parent.parent.parent
MODULES = ROOT / "build" / "web" / "node_modules"
NANO = Path(__file__).with_name("nano.js")

# As outside.js has them.
REQUEST = struct.Struct("<cBd")  # kind, argument, time in ns
REPLY = struct.Struct("<BBBd")  # value, flags, bytes that follow, next event in ns
DATA_READY, BUTTON, END = 1, 2, 4

MOTION_AFTER_NS = 100_000_000  # as in the other emulators
NEVER = 2**64 - 1
BYTES_AT_ONCE = 32  # the image has room for 64
PATIENCE_NS = 30e9  # simulated; a run of the tests takes half of it

CHIP = (
    *("sim/chips/i2c_slave.c", "sim/chips/chip_motion.c", "sim/run/motion.c"),
    *(
        str(path.relative_to(ROOT))
        for room in ("sensor", "mpu9250")
        for path in (ROOT / "sim" / "chips" / room).glob("*.c")
    ),
)
HEADERS = (
    *("sim/chips/chip_fault.h", "sim/chips/i2c_slave.h", "sim/chips/chip_motion.h"),
    *("sim/chips/sensor_chip.h", "sim/chips/mpu9250.h", "sim/run/motion.h"),
)


@dataclass(slots=True)
class Seen:
    """The transactions on the bus."""

    written: set[tuple[int, int]] = field(default_factory=set)  # register, value
    reads: Counter[int] = field(default_factory=Counter)  # by their bytes
    addresses: set[int] = field(default_factory=set)


class Chip:
    """The MPU-9250 with its AK8963, on I2C."""

    def __init__(self, motion: Path) -> None:
        self.ffi, self.lib = native.load(CHIP, HEADERS)
        self.motion = self.ffi.new("struct motion *")
        problem = self.lib.motion_open(self.motion, str(motion).encode())
        assert problem == self.ffi.NULL, self.ffi.string(problem)
        self.lib.motion_begin(self.motion, MOTION_AFTER_NS)
        config = self.ffi.new("struct mpu9250_chip_config *")
        config[0] = self.lib.mpu9250_chip_defaults()
        config.sensor.motion = self.lib.motion_source(self.motion)
        self.chip = self.lib.mpu9250_chip_new(config)
        self.wire = self.lib.sensor_chip_wire(self.chip)
        self.seen = Seen()
        self._bytes: list[int] = []
        self._reads = 0

    def close(self) -> None:
        self.lib.sensor_chip_free(self.chip)
        self.lib.motion_close(self.motion)

    def pass_time(self, _: int, now_ns: int) -> int:
        self.lib.motion_is_over(self.motion, now_ns)  # reads on
        self.lib.sensor_chip_advance(self.chip, now_ns)
        return 0

    def address(self, byte: int, now_ns: int) -> int:
        self.seen.addresses.add(byte >> 1)
        self._bytes, self._reads = [], 0
        return int(self.lib.i2c_slave_start(self.wire, now_ns, byte >> 1, byte & 1))

    def write(self, byte: int, now_ns: int) -> int:
        self._bytes.append(byte)
        if len(self._bytes) > 1:
            register = self._bytes[0] + len(self._bytes) - 2
            self.seen.written.add((register, byte))
        return int(self.lib.i2c_slave_write(self.wire, now_ns, byte))

    def read(self, ack: int, now_ns: int) -> int:
        self._reads += 1
        return int(self.lib.i2c_slave_read(self.wire, now_ns, ack))

    def stop(self, _: int, now_ns: int) -> int:
        self.seen.reads[self._reads] += 1
        self.lib.i2c_slave_stop(self.wire, now_ns)
        return 0

    @property
    def is_ready(self) -> bool:
        """The level of its INT pin."""
        return bool(self.lib.sensor_chip_pin_is_high(self.chip, 0))

    @property
    def next_ns(self) -> float:
        """The time of the next event."""
        event = self.lib.sensor_chip_next_event(self.chip)
        return math.inf if event == NEVER else float(event)

    @property
    def complaint(self) -> str | None:
        """The host's first violation of the chip's documents."""
        text = self.lib.sensor_chip_complaint(self.chip)
        return None if text == self.ffi.NULL else self.ffi.string(text).decode()


class Around:
    """Answers the board. `hear` is called with each good frame's content; `line` is for
    bytes that go to the board.
    """

    def __init__(self, chip: Chip, hear: Callable[[bytes], None]) -> None:
        self.chip = chip
        self.line: deque[int] = deque()
        self.release_ns = 0  # the button is down until then
        self.is_over = False
        self.now_ns = 0
        self.decoder = FrameDecoder()
        self._hear = hear
        self._heard = bytearray()
        self._kinds: dict[bytes, Callable[[int, int], int]] = {
            b"T": chip.pass_time,
            b"A": chip.address,
            b"W": chip.write,
            b"R": chip.read,
            b"P": chip.stop,
        }

    def press(self, ns: int) -> None:
        """Hold the button down for so long."""
        self.release_ns = self.now_ns + ns

    def run(self, image: Path) -> None:
        """Runs the image, an Intel HEX file, until it is over."""
        command = ["node", NANO, MODULES, image]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
            assert process.stdin and process.stdout and process.stderr
            try:
                # Where node fails it says so on stderr.
                with contextlib.suppress(BrokenPipeError):
                    while len(request := process.stdout.read(REQUEST.size)) > 0:
                        process.stdin.write(self._answer(*REQUEST.unpack(request)))
                        process.stdin.flush()
                error = process.stderr.read().decode()
                assert process.wait() == 0, error
            finally:
                process.kill()
        assert self.is_over, f"avr8js ended after {self.now_ns / 1e9:.3f} s"

    def _answer(self, kind: bytes, argument: int, ns: float) -> bytes:
        self.now_ns = int(ns)
        if kind == b"U":
            self._heard.append(argument)
            if argument == 0:
                self._decode()
            return b""
        value = self._kinds[kind](argument, self.now_ns)
        assert ns < PATIENCE_NS, "it takes too long"
        flags = self.chip.is_ready * DATA_READY
        flags |= (ns < self.release_ns) * BUTTON | self.is_over * END
        count = min(len(self.line), BYTES_AT_ONCE) if kind == b"T" else 0
        output = bytes(self.line.popleft() for _ in range(count))
        return REPLY.pack(value, flags, count, self.chip.next_ns) + output

    def _decode(self) -> None:
        for content in self.decoder.feed(bytes(self._heard)):
            self._hear(content)
        self._heard.clear()
