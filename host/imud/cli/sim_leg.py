# SPDX-License-Identifier: MIT
"""`imud sim leg`: three virtual probes on a leg."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import above_zero, add_command, add_seconds, whole
from imud.virtual.boards import BOARDS

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


def add(boards: Commands) -> None:
    """Adds `imud sim leg` and its options."""
    parser = add_command(
        boards,
        "leg",
        "run three virtual probes on a leg that stands, squats, raises its knee and "
        "walks",
        "imud sim leg, then: imud run --config imud-leg/imud.toml, then: imud body "
        "imud-leg/leg.toml",
        "It writes the files of the daemon and of the body into a folder, and repeats "
        "its motion until Ctrl-C.",
    )
    parser.add_argument(
        "--board",
        choices=("nano", "f405", "mega"),
        default="nano",
        help="board of each probe (default: %(default)s)",
    )
    parser.add_argument(
        "--dir",
        metavar="DIR",
        type=Path,
        default=Path("imud-leg"),
        help="folder for its files and serial ports (default: %(default)s)",
    )
    parser.add_argument(
        "--walk",
        metavar="S",
        type=above_zero,
        default=30.0,
        help="duration of each walk, s (default: %(default)g)",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=whole(0, 2**24),
        default=1,
        help="random seed of the leg, and of the mounting and errors of its probes "
        "(default: %(default)s)",
    )
    add_seconds(parser)
    add_programs(parser)
    parser.set_defaults(run=_run)


def add_programs(parser: argparse.ArgumentParser) -> None:
    """Options for other programs than those built."""
    for name, metavar, what in (
        ("image", "ELF", "firmware image"),
        ("simulator", "PATH", "emulator"),
    ):
        parser.add_argument(
            f"--{name}",
            metavar=metavar,
            type=Path,
            help=f"{what} (default: the one built in this project)",
        )


def _run(args: argparse.Namespace) -> int:
    from imud.virtual import sim_leg

    args.board = BOARDS[args.board]
    return sim_leg.run(args)
