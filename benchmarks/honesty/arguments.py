# SPDX-License-Identifier: MIT
"""The command line that desk.py and grounds.py share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.boards import BOARDS, NANO
from benchmarks.common.figure import SETS
from benchmarks.common.paths import RESULTS


def parser_of(
    description: str | None,
    example: str,
    groups: Sequence[str],
    *,
    seeds: int,
    few: int,
) -> argparse.ArgumentParser:
    """Which board, groups, sets and seeds; `few` of these with --quick."""
    parser = argparse.ArgumentParser(description=description, epilog=example)
    parser.add_argument("--board", choices=BOARDS, default=NANO.name)
    for name, known in (("groups", tuple(groups)), ("sets", tuple(SETS))):
        parser.add_argument(
            f"--{name}",
            metavar="NAME",
            nargs="+",
            choices=known,
            default=list(known),
            help=f"of {', '.join(known)} (default: all)",
        )
    parser.add_argument("--seeds", type=int, default=seeds, help="of each set")
    parser.add_argument(
        "--quick",
        action="store_const",
        dest="seeds",
        const=few,
        help=f"{few} seeds of each set",
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="at a time")
    parser.add_argument("--output", metavar="FILE", type=Path)
    return parser


def output_of(args: argparse.Namespace, name: str) -> Path:
    """Where the results go, unless --output tells."""
    suffix = "" if args.board == NANO.name else f"-{args.board}"
    output: Path = args.output or RESULTS / f"honesty-{name}{suffix}.json"
    return output
