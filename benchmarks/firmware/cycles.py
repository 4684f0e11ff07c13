# SPDX-License-Identifier: MIT
"""Where a board's cycles, flash and RAM go, beside the limits of its image.

Runs the board's image with all streams on, while a hand turns the probe any way up,
draws strokes, rests, and works beside magnets. Then it runs the image again while the
host restarts its filter or changes its params (commanded.py), and shows the slowest
sample of each run by function. An STM32F405 also logs to a card; its cycles are
counted as instructions, without wait states of flash, buses and exceptions.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.common import boards
from benchmarks.common import capture as captures
from benchmarks.common.boards import MEGA, NANO, Board
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed, build
from benchmarks.firmware import commanded
from benchmarks.harness import Figure, Report, Table
from imud.cli import main as imud
from imud.virtual import motion, sensors
from imud.virtual.sensors import Magnet, World

# So strong and so near that the field differs from the Earth's by tens of microtesla on
# some strokes and by little on others.
MAGNETS = (
    Magnet((0.15, 0.05, 0.03), (0.0, 0.4, 0.1)),
    Magnet((-0.2, -0.1, 0.0), (0.5, 0.0, -0.3)),
)
# Offsets that the calibration at start-up removes, and one of the magnetometer.
ERRORS = sensors.SensorErrors(mag_offset_ut=3.0)
F405 = boards.F405
FAST = replace(
    F405, environment="stm32f405_760", chip=replace(F405.chip, rate_hz=760.0)
)
BOARDS = {"nano": NANO, "mega": MEGA, "f405": F405, "f405-760": FAST}
KIB = 1024


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of an image: a share of the time of a sample, and bytes."""

    time: float
    flash: int
    ram: int  # of the variables
    stack: int
    both: int


LIMITS = {
    # On old Nanos the bootloader takes 2 kB of the flash. 256 bytes of RAM are a
    # reserve for stack that no run has needed.
    NANO.name: Limits(0.9, 30 * KIB, 2 * KIB, 2 * KIB, 2 * KIB - 256),
    # The bootloader takes 8 kB of the flash. A sample's work ends before the next one.
    MEGA.name: Limits(1.0, 248 * KIB, 8 * KIB, 8 * KIB, 8 * KIB - 256),
    # Half of the time, because an instruction may take more than a cycle. Data sheet,
    # "Memory mapping"; the last two sectors of flash are for settings, and the stack is
    # in 8 KiB of its own (firmware/stm32/stm32f405.ld).
    F405.name: Limits(0.5, 768 * KIB, 128 * KIB, 8 * KIB, 136 * KIB),
}
LISTED = 20  # functions of a slowest sample
CARD_BYTES_A_SECOND = 120_000  # more than raw and pose take at 760 Hz
BITS_A_BYTE = 10  # on the wire, with a start and a stop bit
BAUD = {NANO.name: 500_000, MEGA.name: 500_000, F405.name: 921_600}


@dataclass(frozen=True, slots=True)
class Line:
    """A figure of an image, as it is shown, and its limit, if it has one."""

    name: str
    value: float
    shown: str = ",.0f"
    limit: float | None = None


@dataclass(frozen=True, slots=True)
class Measured:
    """An image's capture and its profile, as the emulator wrote it."""

    capture: Capture
    profile: dict[str, Any]


def measure(
    board: Board, image: Path, hand: Path, seed: int, options: Sequence[str] = ()
) -> Measured:
    """Run an image on a motion with all streams on, and profile it."""
    rate_hz = int(board.chip.rate_hz)
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "profile.json"
        words = ["--seed", str(seed), *options, "--profile", str(profile)]
        if board.name == F405.name:
            words += ["--card", str(prepared(Path(folder), motion.load(hand).seconds))]
        capture = captures.run(
            board.name,
            hand,
            words,
            image=image,
            sample_rate_hz=rate_hz,
            pose_rate_hz=rate_hz,
        )
        return Measured(capture, json.loads(profile.read_text()))


def prepared(folder: Path, seconds: float) -> Path:
    """A card image with room for a log of this many seconds."""
    path = folder / "card.img"
    size = 48 + int(seconds * CARD_BYTES_A_SECOND) // 2**20
    with contextlib.redirect_stdout(io.StringIO()):
        if imud(["card", "prepare", str(path), "--size", f"{size}M"]):
            raise RunFailed("no card could be prepared")
    return path


def lines_of(
    board: Board, capture: Capture, slowest: Mapping[str, int]
) -> Iterable[Line]:
    """The figures of an image; `slowest`: cycles of a sample, by the commands sent."""
    limits, summary = LIMITS[board.name], capture.summary
    cycles = limits.time * board.clock_hz / board.chip.rate_hz
    both = summary["ram"] + summary["stack_max"]
    poses_s, samples_s = capture.pose_times_s, capture.feed.times_s
    bits = BITS_A_BYTE * summary["bytes"] / float(samples_s[-1] - samples_s[0])
    yield Line("cycles a sample, worst", summary["cycles_worst"], limit=cycles)
    for what, worst in slowest.items():
        yield Line(f"the same, with {what}", worst, limit=cycles)
    yield Line("cycles a sample, mean", summary["cycles_mean"], limit=cycles)
    yield Line("asleep", summary["idle"], ".1%")
    yield Line("share of the wire", bits / BAUD[board.name], ".1%")
    yield Line("samples", summary["samples"])
    yield Line("samples late", summary["late"], limit=0)
    lost = capture.lost + capture.log_dropped
    yield Line("samples or messages lost", lost, limit=0)
    poses_hz = (len(poses_s) - 1) / float(poses_s[-1] - poses_s[0])
    yield Line("poses a second", poses_hz, ".1f")
    yield Line("flash, bytes", summary["flash"], limit=limits.flash)
    yield Line("RAM: variables, bytes", summary["ram"], limit=limits.ram)
    yield Line("RAM: deepest stack, bytes", summary["stack_max"], limit=limits.stack)
    yield Line("RAM: both, bytes", both, limit=limits.both)


def image_of(lines: Iterable[Line]) -> Table:
    """The figures of an image beside their limits."""
    rows = [
        (
            each.name,
            format(each.value, each.shown),
            "" if each.limit is None else f"{each.limit:,.0f}",
        )
        for each in lines
    ]
    return Table("image", {"": "", "measured": "", "limit": ""}, rows)


def slowest_of(what: str, profile: Mapping[str, Any]) -> Table:
    """The functions of a run's slowest sample: of their own, with what they call."""
    found = [
        (name, tally["self"]["in_worst"], tally["inclusive"]["in_worst"])
        for name, tally in profile["functions"].items()
        if tally["inclusive"]["in_worst"] > 0
    ]
    # What obeys a command has few cycles of its own, and calls those that have.
    by_all = sorted(found, key=lambda row: -row[2])[:LISTED]
    by_own = sorted(found, key=lambda row: -row[1])[:LISTED]
    columns = {"function": "", "own cycles": ",d", "with what it calls": ",d"}
    title = f"the slowest sample with {what}"
    return Table(what, columns, [*dict.fromkeys([*by_all, *by_own])], title)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--board", choices=BOARDS, default="nano")
    parser.add_argument("--seconds", type=float, default=120.0, help="of a motion")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--image", type=Path, help="ELF to measure (default: the board's, built)"
    )


def measured(args: argparse.Namespace) -> Report:
    """The image on the whole motion, then with each kind of commands on its begin."""
    board = BOARDS[args.board]
    image = args.image or build(board.environment)
    with tempfile.TemporaryDirectory() as folder:
        hand, begin = Path(folder) / "hand.npz", Path(folder) / "begin.npz"
        made = sensors.generate(
            args.seconds, args.seed, world=World(magnets=MAGNETS), errors=ERRORS
        )
        made.save(hand)
        made[: round(commanded.SECONDS * sensors.HAND_RATE_HZ)].save(begin)
        whole = measure(board, image, hand, args.seed)
        tables = [slowest_of("the whole motion", whole.profile)]
        slowest = {}
        for what, kind in commanded.KINDS.items():
            words = kind.options(1e6 / board.chip.rate_hz)
            found = measure(board, image, begin, args.seed, words)
            count = kind.obeyed(found.capture)
            slowest[f"{count} {what}"] = found.profile["total"]["worst"]
            tables.append(slowest_of(what, found.profile))
    lines = [*lines_of(board, whole.capture, slowest)]
    figures = [
        Figure(each.name, each.value, (0, each.limit), (0, each.limit))
        for each in lines
        if each.limit is not None
    ]
    data = {"summary": whole.capture.summary, "profile": whole.profile}
    return Report([image_of(lines), *tables], figures, data)


main = partial(harness.run, "cycles", __doc__, measured, options, variants=["board"])
