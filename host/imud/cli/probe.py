# SPDX-License-Identifier: MIT
"""Commands to a probe, through the daemon: the rows of `imud/commands.py` that have an
example, as `imud start`, `tare` and `mark`.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

from imud.cli.arguments import add_command, add_network, add_probe, client_of

if TYPE_CHECKING:
    from imud.cli.arguments import Commands
    from imud.commands import Argument, ProbeCommand


def add(commands: Commands) -> None:
    """Adds the commands for one probe."""
    from imud.commands import COMMANDS

    for row in COMMANDS.values():
        if row.example:
            text = row.typed_help or row.help
            parser = add_command(commands, row.typed, text, row.example, row.details)
            options = [each for every in row.arguments for each in every.options]
            # A word after it would be taken for the probe.
            add_probe(parser, is_needed=any(each.is_word for each in options))
            for argument in row.arguments:
                _add_options(parser, argument)
            add_network(parser)
            parser.set_defaults(run=partial(_command, row))


def _add_options(parser: argparse.ArgumentParser, argument: Argument) -> None:
    """Adds the options that set an argument, of which only one may be given."""
    into: argparse._ActionsContainer = parser
    if len(argument.options) > 1:
        into = parser.add_mutually_exclusive_group()
    for option in argument.options:
        how: dict[str, Any] = {"help": option.help}
        if option.value is not None:
            how |= {"action": "store_const", "const": option.value}
        elif argument.choices:
            how["choices"] = [*argument.choices]
        else:
            how["metavar"] = option.name if option.is_word else argument.type.upper()
        if option.is_word:
            nargs = None if option.is_needed else "?"
            into.add_argument(argument.name, nargs=nargs, **how)
        else:
            into.add_argument(f"--{option.name}", dest=argument.name, **how)


def _command(row: ProbeCommand, args: argparse.Namespace) -> int:
    typed = {
        each.name: getattr(args, each.name) for each in row.arguments if each.options
    }
    given = {name: value for name, value in typed.items() if value is not None}
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        value = client.command(probe, row.name, **given)["value"]
    sys.stdout.write(f"{row.words(probe, given, value)}\n")
    return 0
