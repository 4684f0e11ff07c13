# SPDX-License-Identifier: MIT
"""The params, which turn a probe's readings into poses: `imud params show PROBE`,
`save`, `load`, `clear` and `history`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_json, add_network, client_of

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


def add(commands: Commands) -> None:
    """Adds `imud params` and its commands."""
    params = add_command(
        commands,
        "params",
        "show, save or change a probe's params: calibration, tip and options",
        "imud params show stylus",
        "The params turn a probe's readings into poses; docs/params.md explains them.",
    )
    actions = params.add_subparsers(metavar="COMMAND", required=True)
    _add_show(actions)
    _add_save(actions)
    _add_load(actions)
    _add_clear(actions)
    _add_history(actions)


def _add_show(actions: Commands) -> None:
    show = add_command(
        actions,
        "show",
        "print the active params",
        "imud params show stylus --json",
    )
    _add_probe(show)
    add_json(show, "print one JSON object, as published")
    add_network(show)
    show.set_defaults(run=_show)


def _add_save(actions: Commands) -> None:
    save = add_command(
        actions,
        "save",
        "save the params to a readable file",
        "imud params save stylus stylus.toml",
    )
    _add_probe(save)
    save.add_argument("file", metavar="FILE", type=Path, help="TOML file to write")
    save.add_argument(
        "--force", action="store_true", help="replace the file if it exists"
    )
    add_network(save)
    save.set_defaults(run=_save)


def _add_load(actions: Commands) -> None:
    load = add_command(
        actions,
        "load",
        "load params from a file, all of them or none",
        "imud params load stylus stylus.toml --dry-run",
        "Prints what changes. The filter restarts if a calibration changes.",
    )
    _add_probe(load)
    load.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help="file that save wrote; or the digest of params in the history, or how it "
        "begins; or handle-nano, handle-pico or handle-pyboard: those in force, with "
        "the tip of a printed handle",
    )
    load.add_argument(
        "--force",
        action="store_true",
        help="load them even if they are from another probe",
    )
    load.add_argument(
        "--dry-run", action="store_true", help="print what would change, and stop"
    )
    add_network(load)
    load.set_defaults(run=_load)


def _add_clear(actions: Commands) -> None:
    clear = add_command(
        actions,
        "clear",
        "remove all params: readings are used uncorrected",
        "imud params clear stylus",
        "The history keeps the removed params.",
    )
    _add_probe(clear)
    add_network(clear)
    clear.set_defaults(run=_clear)


def _add_history(actions: Commands) -> None:
    history = add_command(
        actions,
        "history",
        "list all params that were active, the newest first",
        "imud params history stylus",
        "The daemon keeps them, in the folder [params] history of its settings.",
    )
    _add_probe(history)
    add_network(history)
    history.set_defaults(run=_history)


def _add_probe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("probe", metavar="PROBE", help="name or id of the probe")


def _show(args: argparse.Namespace) -> int:
    from imud.cli import params_text

    with client_of(args) as client:
        return params_text.show(client, args.probe, as_json=args.json)


def _save(args: argparse.Namespace) -> int:
    from imud.cli import params_text

    with client_of(args) as client:
        return params_text.save(client, args.probe, args.file, is_forced=args.force)


def _load(args: argparse.Namespace) -> int:
    from imud.cli import params_text

    wanted = params_text.of_file(args.file)
    with client_of(args) as client:
        if wanted is None:
            wanted = params_text.of_name(client, args.probe, str(args.file))
        return params_text.load(
            client, args.probe, wanted, is_forced=args.force, is_dry=args.dry_run
        )


def _clear(args: argparse.Namespace) -> int:
    from imud.cli import params_text

    with client_of(args) as client:
        return params_text.clear(client, args.probe)


def _history(args: argparse.Namespace) -> int:
    from imud.cli import params_text

    with client_of(args) as client:
        return params_text.history(client, args.probe)
