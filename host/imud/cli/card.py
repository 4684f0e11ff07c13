# SPDX-License-Identifier: MIT
"""The SD card on which a probe logs: `imud card prepare`, `read` and `list`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command
from imud.defaults import PREFIX

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


def add(commands: Commands) -> None:
    """Adds `imud card` and its commands."""
    card = add_command(
        commands,
        "card",
        "prepare an SD card for a probe to log on, or read its recordings",
        "imud card prepare /dev/sdb, and later: imud card read /dev/sdb --to logs",
    ).add_subparsers(metavar="COMMAND", required=True)
    _add_prepare(card)
    _add_read(card)
    _add_list(card)


def _add_prepare(card: Commands) -> None:
    prepare = add_command(
        card,
        "prepare",
        "format a card for a probe; this erases everything on it",
        "imud card prepare /dev/sdb",
        "The card gets a FAT32 file system with one file, PROBE.LOG.",
    )
    prepare.add_argument(
        "path",
        metavar="DEVICE-OR-IMAGE",
        type=Path,
        help="a whole card, such as /dev/sdb, or an image file",
    )
    prepare.add_argument(
        "--size",
        metavar="BYTES",
        type=_bytes,
        help="create an image file of this size, such as 512M or 8G",
    )
    prepare.add_argument(
        "--log-size",
        metavar="BYTES",
        type=_bytes,
        help="size of PROBE.LOG (default: what fits, up to 4 GiB)",
    )
    prepare.add_argument(
        "--yes", action="store_true", help="erase the card without asking"
    )
    prepare.set_defaults(run=_prepare)


def _add_read(card: Commands) -> None:
    read = add_command(
        card,
        "read",
        "write each recording on a card as a log",
        "imud card read /dev/sdb --recording 3 --started 2026-01-02T03:04:05Z",
    )
    _add_path(read)
    read.add_argument(
        "--to",
        metavar="DIR",
        type=Path,
        default=Path("logs"),
        help="folder for the logs (default: %(default)s)",
    )
    read.add_argument(
        "--recording",
        metavar="N",
        type=int,
        help="read only recording N in the list of imud card list (default: all)",
    )
    read.add_argument(
        "--started",
        metavar="UTC",
        type=_time_ns,
        help="start time of the recording, as a probe has no calendar (default: "
        "device time, counted from 1970)",
    )
    read.add_argument(
        "--prefix",
        metavar="KEY",
        default=PREFIX,
        help="first part of the channel names in the logs (default: %(default)s)",
    )
    read.set_defaults(run=_read)


def _add_list(card: Commands) -> None:
    listing = add_command(
        card,
        "list",
        "list the recordings on a card",
        "imud card list /media/me/IMU-PROBE/PROBE.LOG",
    )
    _add_path(listing)
    listing.set_defaults(run=_list)


def _add_path(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "path",
        metavar="CARD",
        type=Path,
        help="a card, an image of one, or a PROBE.LOG (on the card or copied)",
    )


def _bytes(text: str) -> int:
    units = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}
    number, unit = (text[:-1], units[text[-1:]]) if text[-1:] in units else (text, 1)
    if not number.isdecimal():
        raise argparse.ArgumentTypeError(
            f"{text} is not a number of bytes, such as 512M or 8G (powers of 1024)"
        )
    return int(number) * unit


def _time_ns(text: str) -> int:
    """Nanoseconds since 1970 UTC of an ISO 8601 time, which is UTC by default."""
    from datetime import UTC, datetime

    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text} is not a time, such as 2026-01-02T03:04:05Z"
        ) from error
    since = time.replace(tzinfo=time.tzinfo or UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * 10**9 + since.microseconds * 1000


def _prepare(args: argparse.Namespace) -> int:
    from imud.card import prepare

    return prepare.prepare(
        args.path, size=args.size, log_size=args.log_size, is_agreed=args.yes
    )


def _read(args: argparse.Namespace) -> int:
    from imud.card import read

    return read.read(
        args.path,
        to=args.to,
        prefix=args.prefix,
        number=args.recording,
        started_ns=args.started,
    )


def _list(args: argparse.Namespace) -> int:
    from imud.card import listing

    return listing.show(args.path)
