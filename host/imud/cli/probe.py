# SPDX-License-Identifier: MIT
"""Commands to a probe, through the daemon: `imud start`, `stop`, `tare`, `restart`."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_network, add_probe, client_of

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


def add(commands: Commands) -> None:
    from imud.wire import schema

    start = add_command(commands, "start", "make a probe stream", "imud start")
    stop = add_command(commands, "stop", "make a probe stop streaming", "imud stop")
    tare = add_command(
        commands,
        "tare",
        "make a probe's current orientation the origin",
        "imud tare --heading",
    )
    restart = add_command(
        commands,
        "restart",
        "restart a probe's calibration at rest, its filter and its origin",
        "imud restart --filter madgwick",
        "Lay the probe still first.",
    )
    what = tare.add_mutually_exclusive_group()
    what.add_argument(
        "--heading",
        action="store_true",
        help="only the heading becomes 0; pitch and roll still refer to the vertical",
    )
    what.add_argument(
        "--undo", action="store_true", help="go back to east, north and up"
    )
    restart.add_argument(
        "--filter",
        choices=[each.name.lower() for each in schema.Filter if each],
        help="filter to run from now on (default: the one that is running)",
    )
    restart.add_argument(
        "--forget",
        action="store_true",
        help="also forget the magnetic field of its own that the probe kept",
    )
    for name, parser in (
        ("start", start),
        ("stop", stop),
        ("tare", tare),
        ("restart", restart),
    ):
        add_probe(parser)
        add_network(parser)
        parser.set_defaults(run=_command, command=name)


def _command(args: argparse.Namespace) -> int:
    arguments = {}
    if args.command == "tare" and args.heading:
        arguments["what"] = "heading"
    if args.command == "tare" and args.undo:
        arguments["what"] = "undo"
    if args.command == "restart" and args.filter:
        arguments["filter"] = args.filter
    if args.command == "restart" and args.forget:
        arguments["forget"] = "1"
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        client.command(probe, args.command, **arguments)
    sys.stdout.write(f"{probe}: {args.command} done\n")
    return 0
