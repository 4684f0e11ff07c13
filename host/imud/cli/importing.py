# SPDX-License-Identifier: MIT
"""Recordings of others as logs: `imud import`."""

from __future__ import annotations

import argparse
import sys
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import above_zero, add_command
from imud.errors import ConfigError, FileError

if TYPE_CHECKING:
    from imud.cli.arguments import Commands
    from imud.recordings.foreign_map import ForeignMap

NAMES = ("acc", "gyr", "mag", "time")


def add(commands: Commands) -> None:
    """Adds `imud import` and its options."""
    parser = add_command(
        commands,
        "import",
        "convert recordings of other programs to a log: CSV, .npz, .mat, Parquet, bags",
        "imud import walk.csv --map acc=ax,ay,az --unit gyr=deg/s --axes mag=y,x,-z",
        "Columns and units that you don't name are guessed from column names and "
        "plausible values, and shown: docs/logs.md. Commands that take a log also "
        "take such a file if it needs no options.",
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help=".csv, .tsv, .txt (also packed, .gz), .npz, .mat, .parquet, .bag, or the "
        "folder of a ROS 2 bag",
    )
    parser.add_argument(
        "--to", metavar="LOG", type=Path, help="the log (default: FILE.mcap beside it)"
    )
    for option, metavar, words in (
        (
            "map",
            "WHAT=COLUMNS",
            "names of the columns for acc, gyr, mag (three each) or time",
        ),
        (
            "unit",
            "WHAT=UNIT",
            "g, deg/s, uT, ms, ...; a number in front is the size of one count: "
            "0.061mg",
        ),
        (
            "axes",
            "WHAT=AXES",
            "directions of the columns in the body frame, such as y,x,-z",
        ),
        ("only", "COLUMN=VALUE", "rows of one device, where a table has several"),
        ("topic", "TOPIC", "of a bag, or struct of a .mat, with several of a kind"),
    ):
        parser.add_argument(
            f"--{option}", metavar=metavar, action="append", default=[], help=words
        )
    parser.add_argument(
        "--rate",
        metavar="HZ",
        type=above_zero,
        help="rows per second, for a table without times",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="show what would be read, and stop"
    )
    parser.set_defaults(run=_import)


def _import(args: argparse.Namespace) -> int:
    from imud.recordings import foreign_log

    parts = foreign_log.parts(args.file, _told(args))
    log = args.to or args.file.with_name(f"{args.file.stem}.mcap")
    if args.dry_run:
        (found,) = deque(parts, maxlen=1)
    elif log.exists():
        raise FileError(f"{log} already exists; choose another file with --to")
    else:
        probe, found = foreign_log.write(parts, args.file, log)
    for line in found.told.lines():
        sys.stdout.write(f"  {line}\n")
    sys.stdout.write(f"{args.file}: {found.words()}\n")
    if not args.dry_run:
        sys.stdout.write(f"{log}: probe {probe}; imud info {log}\n")
    found.check_complete(args.file)
    return 0


def _told(args: argparse.Namespace) -> ForeignMap:
    from imud.recordings.foreign_map import ForeignMap, unit_of

    told = ForeignMap(rate_hz=args.rate, topics=tuple(args.topic))
    for text in args.only:
        column, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"--only {text}: write a column, then = and its value")
        told.only[column] = value
    for name, text in _pairs(args.map, "map"):
        columns = tuple(column.strip() for column in text.split(","))
        wanted = 1 if name == "time" else 3
        if len(columns) != wanted:
            raise ConfigError(
                f"--map {name} needs {wanted}, not {len(columns)} columns"
            )
        told.columns[name] = columns
    for name, text in _pairs(args.unit, "unit"):
        told.units[name], told.named[name] = unit_of(name, text), text
    for name, text in _pairs(args.axes, "axes"):
        told.axes[name] = text
    return told


def _pairs(texts: list[str], option: str) -> list[tuple[str, str]]:
    found = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or name not in NAMES:
            raise ConfigError(f"--{option} {text}: write {' or '.join(NAMES)}, then =")
        found.append((name, value))
    return found
