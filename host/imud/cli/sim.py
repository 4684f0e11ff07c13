# SPDX-License-Identifier: MIT
"""Virtual probes: `imud sim nano` and the other boards; sim_leg.py has their leg."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli import sim_leg
from imud.cli.arguments import above_zero, add_command, finite, whole
from imud.defaults import PAGE
from imud.virtual.boards import BOARDS, VirtualBoard
from imud.virtual.sim import WIRE, default_link, run

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

# Options that name a file of the emulator; each board says which of them it has.
_FILES = {
    "faults": "faults to inject, and when (JSON)",
    "eeprom": "file with the contents of its {memory}, kept between runs",
    "summary": "write the figures of the run as JSON",
    "profile": "write the CPU cycles of each function as JSON",
    "card": "image of the SD card in its slot, created by imud card prepare",
    "radio": "put an RN-41 Bluetooth module, with its settings in FILE, between probe "
    "and wire",
}

# As imud.virtual.hands has them, which loads numpy.
HANDS = {
    "follow": "does what the page of imud run asks: poses of the guide, aiming",
    "follow-iron": "the same, next to a loudspeaker",
    "calibrate": "follows the guided calibration",
    "check": "follows imud check: poses and presses of the button",
    "turn": "turns it by 30 degrees on a plate, there and back: imud check --turn 30",
    "wedge": "the same, onto a wedge of 30 degrees",
    "lazy": "as calibrate, but tilts it by only about 20 degrees",
    "air": "never lays it down",
    "iron": "as calibrate, next to a loudspeaker",
    "dimple": "wobbles it with its tip in a dimple",
    "slip": "the same, but the tip slips by up to 1 mm",
    "soft": "the same, but the base yields by 4 %% of the motion",
    "stroke": "draws strokes of 20 cm back and forth, with rests between them",
    "button": "the same, and holds the button meanwhile (button_does = stroke)",
    "sheet": "with the button, repeatedly draws the outline of an A4 sheet",
    "circle": "with the button, draws a circle of 20 cm in eight strokes",
    "paper": "with the button, draws strokes of 10 cm, the tip on paper",
    "free": "the same, in free air",
}
STROKING = ("stroke", "button", "sheet", "circle", "paper", "free")

# Options that bend its clock and its wire, in real time.
_WIRE = {
    "clock-ppm": ("PPM", "its clock runs fast by this many parts per million"),
    "clock-drift": ("PPM", "and by this many more ppm each second"),
    "batch-ms": (
        "MS",
        "its bytes arrive only at multiples of this many milliseconds, as through a "
        "USB adapter",
    ),
    "burst-ms": ("MS", "once a second, nothing arrives for this many milliseconds"),
}


def add(commands: Commands) -> None:
    """Adds `imud sim` and its boards."""
    boards = add_command(
        commands,
        "sim",
        "run a virtual probe: the real firmware image in an emulator",
        f"imud sim nano --stream, and then: imud run {default_link(BOARDS['nano'])}",
    ).add_subparsers(metavar="BOARD", required=True)
    for board in BOARDS.values():
        parser = add_command(
            boards,
            board.name,
            board.what,
            f"imud sim {board.name} --motion turn.npz --stream --raw --fast "
            "--record turn.bin --summary turn.json",
            "Its UART is a serial port (a pty), in real time, or goes into a file. "
            "Without --motion, a simulated hand moves it: strokes, turns, rests.",
        )
        _add_motion(parser)
        _add_module(parser)
        _add_output(parser, board)
        _add_streams(parser, board)
        _add_hardware(parser, board)
        parser.set_defaults(run=_run, parser=parser, board=board)

    sim_leg.add(boards)


def _add_motion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--motion",
        metavar="FILE",
        type=Path,
        help="motion from this recording: a log or another file with raw samples, "
        "whose params the probe gets as well; .npz, .csv (docs/motions.md); -: "
        "stdin",
    )
    parser.add_argument(
        "--probe", metavar="PROBE", help="for a log of several probes: the one to use"
    )
    parser.add_argument(
        "--save-motion",
        metavar="FILE",
        type=Path,
        help="save the hand's motion with the true poses, as .npz; needs --seconds",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=whole(0, 2**32 - 1),
        default=1,
        help="random seed of hand and sensor noise (default: %(default)s)",
    )
    parser.add_argument(
        "--seconds",
        metavar="N",
        type=above_zero,
        help="stop after N seconds of device time (default: at the end of the "
        "recording, or never)",
    )
    parser.add_argument(
        "--fast", action="store_true", help="run as fast as possible, not in real time"
    )


def _add_module(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--module",
        metavar="MODULE",
        help="the errors of its sensor: shop (an MPU-9250 as bought, drawn by --seed), "
        "lsm6dsox (the pair by its data sheets), calibrated, or a file "
        "(docs/calibration.md)",
    )
    parser.add_argument(
        "--hand",
        metavar="HAND",
        choices=HANDS,
        help="a virtual hand that calibrates it, finds its tip or measures: "
        + "; ".join(f"{name}: {what}" for name, what in HANDS.items()),
    )
    parser.add_argument(
        "--page",
        metavar="URL",
        default=f"http://{PAGE}",
        help="the page that --hand follow reads (default: %(default)s)",
    )


def _add_output(parser: argparse.ArgumentParser, board: VirtualBoard) -> None:
    output = parser.add_mutually_exclusive_group()
    output.add_argument(
        "--link",
        metavar="PATH",
        type=Path,
        help=f"path of its serial port (default: {default_link(board)})",
    )
    output.add_argument(
        "--record", metavar="FILE", type=Path, help="write its UART bytes to a file"
    )


def _add_streams(parser: argparse.ArgumentParser, board: VirtualBoard) -> None:
    own_hz, others = board.sample_rate_hz, board.others
    named = (f"{each.sample_rate_hz} with {each.name}" for each in others)
    rates = " or ".join([str(own_hz), *named])
    parser.add_argument(
        "--stream",
        action="store_true",
        help="stream from the start, as if the button had been pressed",
    )
    parser.add_argument(
        "--raw",
        action="store_true",
        help=f"also send the raw samples, all {rates} per second",
    )
    parser.add_argument(
        "--rate",
        metavar="HZ",
        type=whole(1, max([own_hz, *(each.sample_rate_hz for each in others)])),
        help=f"poses per second, 1 to {rates} (default: 100)",
    )


def _add_hardware(parser: argparse.ArgumentParser, board: VirtualBoard) -> None:
    for name in board.files:
        parser.add_argument(
            f"--{name}",
            metavar="FILE",
            type=Path,
            help=_FILES[name].format(memory=board.memory),
        )
    if board.others:
        parser.add_argument(
            "--sensor",
            choices=[each.name for each in board.others],
            help="instead of its usual one: "
            + "; ".join(f"{each.name}: {each.what}" for each in board.others),
        )
    if board.wires:
        parser.add_argument(
            "--wire",
            choices=board.wires,
            default=board.wires[0],
            help="which of its ports the host uses (default: %(default)s)",
        )
    if board.has_ready_wire:
        parser.add_argument(
            "--ready",
            choices=("wire", "none"),
            default="wire",
            help="whether the data-ready pin is wired (default: %(default)s)",
        )
    if board.has_battery:
        parser.add_argument(
            "--battery",
            metavar="MV",
            type=whole(0, 5000),
            help="voltage of its battery, in millivolts",
        )
    for name in WIRE:
        unit, text = _WIRE[name]
        parser.add_argument(f"--{name}", metavar=unit, type=finite, help=text)
    sim_leg.add_programs(parser)


def _run(args: argparse.Namespace) -> int:
    if args.save_motion and (args.motion or not args.seconds):
        args.parser.error("--save-motion saves the hand's motion: needs --seconds N")
    if (args.module or args.hand) and args.save_motion:
        args.parser.error("--save-motion saves the usual hand's motion, without module")
    if args.hand and args.motion:
        args.parser.error("use --hand or --motion, not both")
    if args.hand in STROKING and args.board.name == "nano":
        args.parser.error(
            f"--hand {args.hand}: the Nano can't measure strokes; use mega or f405"
        )
    if args.record and not args.motion and not args.seconds:
        args.parser.error("--record needs --seconds N: the hand never stops")
    if args.probe and not args.motion:
        args.parser.error("--probe names one of --motion LOG")
    if getattr(args, "sensor", None):
        args.board = args.board.with_sensor(args.sensor)
    most_hz = args.board.sample_rate_hz
    if args.rate is not None and args.rate > most_hz:
        args.parser.error(f"argument --rate: {args.rate} is not in 1..{most_hz}")
    with contextlib.ExitStack() as stack:
        if args.motion:
            _take_motion(args, stack)
        return run(args)


def _take_motion(args: argparse.Namespace, stack: contextlib.ExitStack) -> None:
    """Reads the recording, and has the virtual board remember the params of a log."""
    from imud.recordings import motions
    from imud.recordings.source import local
    from imud.virtual.memory import memory_with

    file = args.motion
    found = motions.load(stack.enter_context(local(file)), args.probe)
    args.motion = found.motion
    if not found.probe:
        return
    params = ""
    if found.records and not args.eeprom:
        board: VirtualBoard = args.board
        if found.board == board.name:
            image = board.find_image(args.image)
            simulator = board.find_simulator(args.simulator)
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            args.eeprom = folder / "memory.bin"
            memory_with(
                *(image, simulator, found.records, args.eeprom, args.seed),
                sensor=board.sensor,
            )
            params = "; its params are active"
        else:
            params = f"; its params are those of a {found.board} and not used"
    sys.stderr.write(f"{motions.words_of(file, found)}{params}\n")
