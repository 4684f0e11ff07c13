# SPDX-License-Identifier: MIT
"""Commands to a probe, through the daemon: the rows of `imud/commands.py` that have an
example, as `imud start`, `stop`, `tare` and `restart`.
"""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_network, add_probe, client_of

if TYPE_CHECKING:
    from imud.cli.arguments import Commands
    from imud.commands import Argument


def add(commands: Commands) -> None:
    """Adds the commands for one probe: start, stop, tare, restart, name and mark."""
    from imud.commands import COMMANDS

    for row in COMMANDS.values():
        if row.example:
            parser = add_command(commands, row.name, row.help, row.example, row.details)
            for argument in row.arguments:
                _add_options(parser, argument)
            add_probe(parser)
            add_network(parser)
            parser.set_defaults(run=_command, command=row.name)
    _add_name(commands)
    _add_mark(commands)


def _add_name(commands: Commands) -> None:
    name = add_command(
        commands,
        "name",
        "give a probe a name",
        "imud name 00112233445566aa stylus",
        "The daemon keeps the name, on any port. Subscribers find the probe under "
        "its new name: imud/stylus/pose.",
    )
    name.add_argument("probe", metavar="PROBE", help="its current name or id")
    name.add_argument("name", metavar="NAME", help="the new name, without / and spaces")
    add_network(name)
    name.set_defaults(run=_name)


def _add_mark(commands: Commands) -> None:
    mark = add_command(
        commands,
        "mark",
        "put a value or a note into the log, with the position of the tip",
        "imud mark stylus 0.42 --note 'second press'",
        "The mark is published on imud/PROBE/mark with the current pose and its "
        "errors, logged, shown on the page, and exported as a table by imud export.",
    )
    mark.add_argument("probe", metavar="PROBE", help="name or id of the probe")
    mark.add_argument(
        "value", metavar="VALUE", nargs="?", help="a number measured there"
    )
    mark.add_argument("--note", metavar="TEXT", help="text of at most 200 characters")
    add_network(mark)
    mark.set_defaults(run=_mark)


def _mark(args: argparse.Namespace) -> int:
    given = {"value": args.value, "text": args.note}
    arguments = {name: value for name, value in given.items() if value is not None}
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        found = client.command(probe, "mark", **arguments)["value"]
    place, error = found["position_m"], found["position_sigma_m"]
    if found["q"] is None:
        where = "no pose at this moment; start the stream with imud start"
    elif place is None:
        where = "the position of its tip is unknown"
    else:
        mm = " ".join(f"{1000.0 * each:.1f}" for each in place)
        sure = "" if error is None else f" +-{1000.0 * error:.1f}"
        where = f"tip at {mm}{sure} mm"
    sys.stdout.write(f"{probe}: marked; {where}\n")
    return 0


def _name(args: argparse.Namespace) -> int:
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        reply = client.command(probe, "configure", rename=args.name)
    sys.stdout.write(f"{probe} is now called {args.name}\n")
    if not reply["value"]["is_kept"]:
        sys.stdout.write(
            "until the daemon restarts or reloads its configuration, which has "
            "another name for it\n"
        )
    return 0


def _add_options(parser: argparse.ArgumentParser, argument: Argument) -> None:
    """Adds the options that set an argument, of which only one may be given."""
    into: argparse._ActionsContainer = parser
    if len(argument.options) > 1:
        into = parser.add_mutually_exclusive_group()
    for option in argument.options:
        flag, dest = f"--{option.name}", argument.name
        if option.value is None:
            into.add_argument(
                flag, dest=dest, choices=list(argument.choices), help=option.help
            )
        else:
            into.add_argument(
                flag,
                dest=dest,
                action="store_const",
                const=option.value,
                help=option.help,
            )


def _command(args: argparse.Namespace) -> int:
    from imud.commands import COMMANDS

    given = {
        each: getattr(args, each) for each in COMMANDS[args.command].argument_names
    }
    arguments = {name: value for name, value in given.items() if value is not None}
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        client.command(probe, args.command, **arguments)
    sys.stdout.write(f"{probe}: {args.command} done\n")
    return 0
