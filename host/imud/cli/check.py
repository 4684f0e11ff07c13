# SPDX-License-Identifier: MIT
"""`imud check`: a minute with a new board that ends in a verdict."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import above_zero, add_command, add_json, add_network

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

SUFFIXES = (".json", ".md")


def add(commands: Commands) -> None:
    """Adds `imud check` and its options."""
    parser = add_command(
        commands,
        "check",
        "check a new board in a minute: what is good, what is not, and what to do",
        "imud check /dev/ttyUSB0 --report board.md",
        "It measures the board at rest, then asks you to turn it twice and to press "
        "its button. Without imud run it opens the port itself. docs/check.md explains "
        "the rows. The exit code is 1 if there is a fault.",
    )
    parser.add_argument(
        "probe",
        metavar="PROBE|PORT",
        nargs="?",
        help="name or id of the probe, or its serial port; may be left out if there is "
        "only one",
    )
    parser.add_argument(
        "--seconds",
        metavar="N",
        type=above_zero,
        default=30.0,
        help="seconds to measure at rest (default: %(default)g)",
    )
    parser.add_argument(
        "--no-poses", action="store_true", help="skip the poses on two sides"
    )
    parser.add_argument(
        "--no-button", action="store_true", help="skip the button and the LED"
    )
    _add_turn(parser)
    parser.add_argument(
        "--report",
        metavar="FILE",
        type=Path,
        help="write a report without names, for a bug report: .md or .json; without a "
        "suffix both",
    )
    add_json(parser, "print the report as JSON, no table")
    parser.add_argument(
        "--from",
        dest="source",
        metavar="FILE",
        type=Path,
        help="check the samples in a log or capture; no probe is needed",
    )
    add_network(parser)
    parser.set_defaults(run=_run, parser=parser)


def _add_turn(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--turn",
        metavar="DEG",
        type=_turn,
        help="instead of these checks, check whether the probe measures a turn by this "
        "angle about any axis (docs/check.md)",
    )
    parser.add_argument(
        "--laid",
        metavar="DEG",
        type=above_zero,
        default=0.2,
        help="with --turn: accuracy of your hand, one sigma (default: %(default)g)",
    )


def _turn(text: str) -> float:
    """1 to 180 degrees: a larger turn looks like the smaller one the other way."""
    with contextlib.suppress(ValueError):
        if 1.0 <= (number := float(text)) <= 180.0:
            return number
    raise argparse.ArgumentTypeError(f"{text} is not a turn of 1 to 180 degrees")


def _run(args: argparse.Namespace) -> int:
    if args.report is not None and args.report.suffix not in ("", *SUFFIXES):
        args.parser.error(f"--report FILE ends in .md or .json, not {args.report.name}")
    from imud.cli import check_run

    if args.turn is not None:
        from imud.cli import check_turn

        if args.source is not None:
            args.parser.error("--turn needs a probe, not --from FILE")
        return check_turn.live(args)
    if args.source is not None:
        return check_run.from_file(args)
    return check_run.live(args)
