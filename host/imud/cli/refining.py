# SPDX-License-Identifier: MIT
"""Poses afterwards: `imud refine`, `imud audit`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, finite
from imud.cli.recordings import A_LOG

if TYPE_CHECKING:
    from imud.cli.arguments import Commands
    from imud.recordings.refining import How


def add(commands: Commands) -> None:
    refine = add_command(
        commands,
        "refine",
        "compute the best poses of a recording afterwards",
        "imud refine logs/imud-20260102T030405Z.mcap",
        "It needs all raw samples. The poses are in a copy of the log, as those of a "
        "probe NAME-refined beside NAME, with errors: docs/refine.md.",
    )
    _add_source(refine)
    refine.add_argument(
        "--to",
        metavar="LOG",
        type=Path,
        help="the new log (default: LOG-refined.mcap, beside LOG)",
    )
    refine.add_argument(
        "--params",
        metavar="FILE",
        type=Path,
        help="write the calibration that it found, as a file for imud params load",
    )
    refine.set_defaults(run=_refine)
    audit = add_command(
        commands,
        "audit",
        "compare a log's poses with the best ones afterwards",
        "imud audit logs/imud-20260102T030405Z.mcap --turn 90",
        "How far the poses were off that were computed on line, by minute and cause, "
        "and whether their stated errors held: docs/refine.md.",
    )
    _add_source(audit)
    audit.add_argument(
        "--to",
        metavar="HTML",
        type=Path,
        help="the page (default: LOG-audit.html, beside LOG)",
    )
    audit.add_argument(
        "--turn",
        metavar="DEG",
        type=finite,
        help="by how much you turned it from its first to its last rest, clockwise",
    )
    audit.add_argument(
        "--bearing",
        metavar="DEG",
        type=finite,
        help="where its x axis pointed at its first rest, clockwise from north",
    )
    audit.set_defaults(run=_audit)


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", type=Path, help=A_LOG)
    parser.add_argument(
        "--probe", metavar="PROBE", help="only this probe (default: all)"
    )
    parser.add_argument(
        "--module",
        action="store_true",
        help="the sensor is as shops sell it, whatever its params say",
    )
    parser.add_argument(
        "--method",
        choices=("all", "simple"),
        default="all",
        help="simple: the magnetometer at rest only, for a probe beside iron "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--north",
        metavar="WHERE",
        type=north,
        default="first-rest",
        help="where the magnetic field points at its first rest, on the average of the "
        "place, or so many seconds after its beginning (default: %(default)s)",
    )


def north(text: str) -> str | float:
    """A word, or a time in seconds."""
    if text in ("first-rest", "place"):
        return text
    return finite(text)


def how(args: argparse.Namespace) -> How:
    from imud.recordings.refining import How

    return How(args.module, args.method == "simple", args.north, args.probe)


def _refine(args: argparse.Namespace) -> int:
    from imud.recordings import refining
    from imud.recordings.source import log_of

    with log_of(args.log) as log:
        return refining.run(log, args.log, args.to, args.params, how(args))


def _audit(args: argparse.Namespace) -> int:
    from imud.recordings import audit
    from imud.recordings.source import log_of

    known = audit.Reference(args.turn, args.bearing)
    with log_of(args.log) as log:
        return audit.run(log, args.log, args.to, how(args), known)
