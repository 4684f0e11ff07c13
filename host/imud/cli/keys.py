# SPDX-License-Identifier: MIT
"""Users of a daemon over the network: `imud keys init`, `add` and `remove`;
and the keys of probes that send datagrams: `imud keys probe`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command
from imud.defaults import PORT

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


def add(commands: Commands) -> None:
    """Adds `imud keys` and its commands."""
    keys = add_command(
        commands,
        "keys",
        "create the keys that admit users to a daemon",
        "imud keys init keys --name probes.example.org",
        "Each user gets a file with a certificate and a password, and a role with "
        "its permissions.",
    ).add_subparsers(metavar="COMMAND", required=True)
    init = add_command(
        keys,
        "init",
        "create a certificate authority, the daemon's certificate and one user of "
        "each role",
        "imud keys init keys --name probes.example.org",
    )
    _add_dir(init)
    init.add_argument(
        "--name",
        metavar="HOST",
        action="append",
        default=[],
        help="host name or address of the daemon for its users; may be repeated "
        "(default: this machine's name; localhost and 127.0.0.1 are always included)",
    )
    init.add_argument(
        "--port",
        metavar="N",
        type=int,
        default=PORT,
        help="TCP port of the daemon (default: %(default)s)",
    )
    init.set_defaults(run=_init)
    _add_user(keys)
    renew = add_command(
        keys,
        "renew",
        "renew the daemon's certificate, before or after it expires",
        "imud keys renew keys",
        "The users' files stay valid.",
    )
    _add_dir(renew)
    renew.set_defaults(run=_renew)
    remove = add_command(keys, "remove", "remove a user", "imud keys remove keys anna")
    _add_dir(remove)
    remove.add_argument("user", metavar="NAME", help="user to remove")
    remove.set_defaults(run=_remove)
    _add_probe(keys)


def _add_user(keys: Commands) -> None:
    from imud.net import access

    more = add_command(keys, "add", "add a user", "imud keys add keys operator anna")
    _add_dir(more)
    more.add_argument(
        "role",
        metavar="ROLE",
        choices=list(access.ROLES),
        help="; ".join(f"{role}: {what}" for role, what in access.ROLES.items()),
    )
    more.add_argument(
        "user", metavar="NAME", help="user to add; the keys go to DIR/clients/NAME.toml"
    )
    more.set_defaults(run=_add)


def _add_probe(keys: Commands) -> None:
    probe = add_command(
        keys,
        "probe",
        "create a key for a probe that sends datagrams",
        "imud keys probe keys c65c26226523f231",
    )
    probe.add_argument(
        "dir", metavar="DIR", type=Path, help="folder of the keys, for ports.udp_keys"
    )
    probe.add_argument(
        "id", metavar="ID", help="id of the probe; the key goes to DIR/probes/ID.key"
    )
    probe.set_defaults(run=_probe)


def _add_dir(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "dir", metavar="DIR", type=Path, help="folder of the keys, for imud run --keys"
    )


def _init(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_init(args.dir, args.name, args.port)


def _add(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_add(args.dir, args.role, args.user)


def _renew(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_renew(args.dir)


def _remove(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_remove(args.dir, args.user)


def _probe(args: argparse.Namespace) -> int:
    from imud.net import probe_keys

    return probe_keys.run_make(args.dir, args.id)
