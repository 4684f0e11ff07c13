# SPDX-License-Identifier: MIT
"""The module imuprobe as a file, in MicroPython on boards of qemu: whether its poses
are the host's, instructions for a sample, and the heap that it takes.

qemu counts instructions, not cycles. A Cortex-M3 runs the code for the Pico's
Cortex-M0+.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import harness
from benchmarks.common.images import RunFailed
from benchmarks.common.paths import PROJECT
from benchmarks.harness import Figure, Report, Table
from imud.stages.twin import Twin
from imud.virtual import sensors
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

HERE = Path(__file__).parent
PORTS = PROJECT / "build" / "micropython"
MODULES = PROJECT / "build" / "mpy"
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


class Board(NamedTuple):
    """Of qemu. `ticks`: the address of a counter, which counts down if `sign` is -1, of
    so many instructions each.
    """

    port: str
    machine: tuple[str, ...]
    memory: int
    ticks: int
    sign: int
    tick: int
    set_up: str = ""


RISC_V = ("-bios", "none", "-machine", "virt")
ARM = ("-semihosting", "-machine")
# Arm's CMSDK APB timer has to be started, and so has a Cortex-M4's FPU.
TIMER = """import machine
machine.mem32[0x40000008] = 0xFFFFFFFF; machine.mem32[0x40000000] = 1
"""
FPU = ("-device", "loader,addr=0xE000ED88,data=0xF00000,data-len=4,cpu-num=0")
ARM_AT = (0x21000000, 0x40000004, -1, 40)
RISC_V_AT = (0x84000000, 0x0200BFF8, 1, 100)  # SiFive's CLINT
BOARDS = {
    "rv32imc": Board("riscv", ("riscv32", *RISC_V), *RISC_V_AT),
    "armv6m": Board("arm", ("arm", *ARM, "mps2-an385"), *ARM_AT, TIMER),
    "armv7emsp": Board("arm-fpu", ("arm", *ARM, "mps2-an386", *FPU), *ARM_AT, TIMER),
}
APART = 0x100000  # of the files in memory


PLAY = """
import gc
gc.collect()
before = gc.mem_free()
import imuprobe
gc.collect()
after = gc.mem_free()
made = imuprobe.Probe(None, id=b"host", firmware="test", time_us=0, mhz=TICK)
print("HEAP", before - after, after - gc.mem_free())
other = imuprobe.Probe(None, id=b"host", firmware="test", time_us=0)
begun = Time.ticks_us()
for _ in range(1000):
    other.edge(None)
middle = Time.ticks_us()
for _ in range(1000):
    other.wants_reset()
print("CLOCK", (2 * middle - begun - Time.ticks_us()) * TICK // 1000)
play(made, TAPE, send)
print("DONE")
"""


class Played(NamedTuple):
    contents: list[bytes]
    heap: tuple[int, int]  # bytes of the import, and of a Probe
    clock: int  # instructions of the clock, which a sample asks once


def played(arch: str, tape: bytes) -> Played:
    """What the module sends on a board, for a tape."""
    lines = run(arch, (HERE / "tape_player.py").read_text(), PLAY, tape=tape)
    sent = bytes.fromhex("".join(x[5:] for x in lines if x.startswith("SENT ")))
    (heap,) = (line.split()[1:] for line in lines if line.startswith("HEAP "))
    (clock,) = (line.split()[1] for line in lines if line.startswith("CLOCK "))
    contents = FrameDecoder().feed(sent)
    return Played(contents, (int(heap[0]), int(heap[1])), int(clock))


def run(arch: str, *texts: str, tape: bytes = b" ") -> list[str]:
    """What a program prints on a board, whose last line is DONE. RunFailed with what
    it printed instead.
    """
    board = BOARDS[arch]
    module = MODULES / f"imuprobe-{arch}.mpy"
    places = [board.memory + APART * number for number in range(3)]
    head = f"MPY_AT = {places[0]}, {module.stat().st_size}\n"
    head += f"TAPE_AT = {places[1]}, {len(tape)}\n"
    head += f"TICKS, SIGN, TICK = {board.ticks}, {board.sign}, {board.tick}\n"
    own = (HERE / "qemu_board.py").read_text()
    program = "\n".join([head, board.set_up, own, *texts]).encode()
    with tempfile.TemporaryDirectory() as room:
        files = [module, Path(room) / "tape", Path(room) / "program"]
        files[1].write_bytes(tape)
        files[2].write_bytes(program)
        words = [f"qemu-system-{board.machine[0]}", *board.machine[1:], "-nographic"]
        words += ["-monitor", "none", "-serial", "stdio"]
        words += ["-icount", "shift=0,sleep=off"]  # an instruction is a nanosecond
        words += ["-kernel", str(PORTS / board.port / "firmware.elf")]
        for file, place in zip(files, places, strict=True):
            words += ["-device", f"loader,file={file},addr={place},force-raw=on"]
        at = f"uctypes.bytearray_at({places[2]}, {len(program)})"
        return typed(words, f"import uctypes; exec(bytes({at}))")


def typed(words: list[str], line: str) -> list[str]:
    """What a board prints after its prompt got a line, up to DONE."""
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as qemu:
        assert qemu.stdin is not None
        assert qemu.stdout is not None
        while qemu.stdout.read(4) not in (">>> ", ""):
            qemu.stdout.readline()
        qemu.stdin.write(f"{line}\r\n")
        qemu.stdin.flush()
        lines: list[str] = []
        is_bad = False
        for said in qemu.stdout:
            lines.append(said.rstrip())
            is_bad = is_bad or lines[-1].startswith("Traceback")
            if lines[-1] == "DONE" or (is_bad and "Error" in lines[-1]):
                break
        qemu.kill()
    if not lines or lines[-1] != "DONE":
        raise RunFailed("\n".join(line[:99] for line in lines[-9:]))
    return lines


def followed(seconds: float, fields: int) -> bytes:
    """A hand, while its origin and its filter change."""
    tape = Tape()
    tape.command(1, "rate", 1, RATE_HZ)
    tape.command(2, "fields", fields)
    tape.command(3, "start")
    tape.sensor(4, *ABOUT)
    changes = {1000: ("tare", 1), 1500: ("restart", int(schema.Filter.FUSE))}
    for number, (time_us, values) in enumerate(hand(seconds)):
        tape.sample(time_us, values)
        if number in changes:
            tape.command(time_us + 100, *changes[number])
    return bytes(tape.data)


def figures_of(arch: str, seconds: float) -> dict[str, float]:
    poses, whole = (
        played(arch, followed(seconds, fields))
        for fields in (int(schema.StreamFlags.POSE), ALL)
    )
    twin = Twin()
    for content in whole.contents:
        message = decode(content)
        assert isinstance(message, Message)
        twin.on_message(message, content, b"")
    told = [decode(content) for content in poses.contents]
    costs = [
        [float(str(message.fields[name])) for name in ("cycles_mean", "cycles_worst")]
        for message in told
        if isinstance(message, Message) and message.fields.get("cycles_mean")
    ]
    return {
        "poses": twin.compared,
        "differ": twin.differed,
        "mean": float(np.mean(costs, axis=0)[0]) - poses.clock,
        "worst": float(np.max(costs, axis=0)[1]) - poses.clock,
        "file": (MODULES / f"imuprobe-{arch}.mpy").stat().st_size,
        "import": poses.heap[0],
        "probe": poses.heap[1],
    }


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=62.0, help="of each run")


# Instructions a sample: what must be, and the goal.
LIMITS = {"rv32imc": (7500, 7500), "armv6m": (14000, 14000), "armv7emsp": (6500, 6500)}
COLUMNS = {
    "processor": "",
    "poses": ",.0f",
    "differ": ",.0f",
    "instructions a sample": ",.0f",
    "at most": ",.0f",
    "file, bytes": ",.0f",
    "heap of the import": ",.0f",
    "heap of a `Probe`": ",.0f",
}


def build() -> None:
    ports = [board.port for board in BOARDS.values()]
    for tool, *words in (("mpy", *BOARDS), ("micropython_build", *ports)):
        program = PROJECT / "tools" / f"{tool}.py"
        subprocess.run([sys.executable, program, *words], check=True)


def measured(args: argparse.Namespace) -> Report:
    """All boards; no pose may differ."""
    build()
    runs = {arch: figures_of(arch, args.seconds) for arch in BOARDS}
    figures = [
        Figure(f"{arch}: {name}", run[key], (0, most), (0, goal))
        for arch, run in runs.items()
        for name, key, most, goal in (
            ("poses that differ", "differ", 0, 0),
            ("instructions a sample", "mean", *LIMITS[arch]),
        )
    ]
    rows = [(arch, *run.values()) for arch, run in runs.items()]
    return Report([Table("module", COLUMNS, rows)], figures, {"runs": runs})


main = partial(harness.run, "micropython", __doc__, measured, options)
