# SPDX-License-Identifier: MIT
"""Shared by the commands' parsers: adding a command, common arguments, types.

A type raises argparse.ArgumentTypeError for text that it refuses, which ends the
program with exit code 2.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from imud.defaults import ENDPOINT, PREFIX

if TYPE_CHECKING:
    from imud.client import Client

    Commands = argparse._SubParsersAction[argparse.ArgumentParser]


def add_command(
    commands: Commands, name: str, text: str, example: str, details: str = ""
) -> argparse.ArgumentParser:
    """Adds a command. `text` is its line in the list of commands and, with `details`
    after it, the description in its own help.
    """
    return commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}. {details}".rstrip(),
        epilog=f"example: {example}",
    )


def add_probe(parser: argparse.ArgumentParser, *, is_needed: bool = False) -> None:
    text = "name or id of the probe"
    if not is_needed:
        text += "; may be left out if there is only one"
    nargs = None if is_needed else "?"
    parser.add_argument("probe", metavar="PROBE", nargs=nargs, help=text)


def add_json(parser: argparse.ArgumentParser, text: str) -> None:
    """--json: for programs; `text` says what it prints."""
    parser.add_argument("--json", action="store_true", help=text)


def add_seconds(parser: argparse.ArgumentParser) -> None:
    """--seconds: after which a command that goes on ends."""
    parser.add_argument(
        "--seconds", metavar="N", type=above_zero, help="stop after N seconds"
    )


def add_network(parser: argparse.ArgumentParser) -> None:
    """--connect, --prefix and --keys: how to reach a daemon; see client_of()."""
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=ENDPOINT,
        help="where the daemon (imud run) listens (default: %(default)s)",
    )
    parser.add_argument(
        "--prefix",
        metavar="KEY",
        default=PREFIX,
        help="first part of the daemon's Zenoh keys (default: %(default)s)",
    )
    parser.add_argument(
        "--keys",
        metavar="FILE",
        type=Path,
        help="your credentials, if the daemon requires them: the file "
        "clients/NAME.toml from imud keys; it also has the daemon's address",
    )


def client_of(args: argparse.Namespace) -> Client:
    """A client of the daemon that the arguments of add_network() name."""
    from imud.client import Client

    return Client(args.connect, args.prefix, args.keys)


def above_zero(text: str) -> float:
    """A finite number above 0."""
    with contextlib.suppress(ValueError):
        number = float(text)
        if 0 < number < float("inf"):
            return number
    raise argparse.ArgumentTypeError(f"{text} is not a number above 0")


def finite(text: str) -> float:
    """A finite number."""
    with contextlib.suppress(ValueError):
        number = float(text)
        if abs(number) < float("inf"):
            return number
    raise argparse.ArgumentTypeError(f"{text} is not a finite number")


def whole(low: int, high: int) -> Callable[[str], int]:
    """The type of whole numbers in low..high."""

    def number(text: str) -> int:
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not in {low}..{high}")
        return value

    return number
