# SPDX-License-Identifier: MIT
"""Everything at work on one machine, without a board: `imud demo`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from imud.cli.arguments import above_zero, add_command
from imud.defaults import PORT

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

BOARDS = {"nano": ["nano"], "f405": ["f405"], "both": ["nano", "f405"]}
BOARDS |= {name: [name] for name in ("pico", "mega")}


def add(commands: Commands) -> None:
    """Adds `imud demo` and its options."""
    demo = add_command(
        commands,
        "demo",
        "run virtual probes, the daemon and a subscriber on this machine",
        "imud demo --board both",
        "The virtual probes run the real firmware images. Ctrl-C ends everything.",
    )
    demo.add_argument(
        "--board",
        default="nano",
        choices=BOARDS,
        help="which virtual probes (default: %(default)s)",
    )
    demo.add_argument(
        "--seconds", type=above_zero, help="stop after N seconds of poses"
    )
    demo.add_argument(
        "--port",
        type=int,
        help=f"Zenoh port on loopback (default: {PORT}, or any free one if that is "
        "taken)",
    )
    demo.set_defaults(run=_demo)


def _demo(args: argparse.Namespace) -> int:
    from imud.cli import demo_run

    return demo_run.run(BOARDS[args.board], args.seconds, args.port)
