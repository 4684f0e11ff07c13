# SPDX-License-Identifier: MIT
"""New firmware for a board: `imud flash`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_network
from imud.commands import FILTERS

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

BOARDS = ("nano", "f405", "pico", "mega", "micropython")


def add(commands: Commands) -> None:
    """Adds `imud flash` and its options."""
    flash = add_command(
        commands,
        "flash",
        "write firmware into a board, and keep its params",
        "imud flash /dev/ttyUSB0",
        "It borrows the port from imud run if necessary, writes through the board's "
        "bootloader, verifies everything and waits for the probe: docs/flash.md.",
    )
    flash.add_argument(
        "port",
        metavar="PORT",
        nargs="?",
        help="port of the board, or name of the probe; may be left out if there is "
        "only one",
    )
    flash.add_argument(
        "--board",
        choices=BOARDS,
        help="board type, for a board without our firmware (default: from the "
        "probe's hello)",
    )
    flash.add_argument(
        "--image",
        metavar="FILE",
        type=Path,
        help="Intel HEX file, or UF2 for a Pico (default: from imu-probe-firmware, "
        "or from this checkout)",
    )
    flash.add_argument(
        "--filter",
        choices=FILTERS,
        help="filter of a Nano, which has room for one (default: its current one, or "
        "fuse)",
    )
    flash.add_argument(
        "--by",
        choices=("dfu", "serial"),
        help="way to flash an F405: dfu-util over its USB port, or a cable at its "
        "bootloader's pins (default: dfu if dfu-util is installed)",
    )
    flash.add_argument(
        "--dry-run", action="store_true", help="show what would be written, and stop"
    )
    flash.add_argument(
        "--force",
        action="store_true",
        help="also write an image that is older, the same, or has another schema; "
        "with MicroPython: replace the board's main.py",
    )
    _add_wifi(flash)
    # Its page has begun it, and answers on stdin: cli/flash_client.py.
    flash.add_argument("--for-page", action="store_true", help=argparse.SUPPRESS)
    add_network(flash)
    flash.set_defaults(run=_flash, parser=flash)


def _add_wifi(flash: argparse.ArgumentParser) -> None:
    wifi = flash.add_mutually_exclusive_group()
    wifi.add_argument(
        "--wifi",
        metavar="NAME",
        help="a board with MicroPython: also join it to this network, whose password "
        "is asked, and open the UDP port of imud run",
    )
    wifi.add_argument(
        "--forget-wifi",
        action="store_true",
        help="a board with MicroPython: delete network, password and key on it",
    )
    flash.add_argument(
        "--yes", action="store_true", help="with --wifi: open that port without asking"
    )
    flash.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        default=Path("imud.toml"),
        help="with --wifi: settings of imud run (default: %(default)s)",
    )


def _flash(args: argparse.Namespace) -> int:
    has_wifi = args.wifi is not None or args.forget_wifi
    if args.board == "micropython" or has_wifi:
        if args.board not in (None, "micropython"):
            args.parser.error(f"--board {args.board} is for a board without Wi-Fi")
        if args.wifi == "":
            args.parser.error("--wifi needs the name of a network")
        if args.image or args.filter or args.by:
            args.parser.error("--image, --filter, --by: not for micropython")
        from imud.cli import flash_micropython

        return flash_micropython.run(args)
    from imud.cli import flash_run

    return flash_run.run(args)
