# SPDX-License-Identifier: MIT
"""Serial ports of this machine: `imud ports`, `imud ports adopt` and `release`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_json
from imud.machine import system

if TYPE_CHECKING:
    from imud.cli.arguments import Commands
    from imud.ports.adopted import AdoptedPorts
    from imud.ports.local import LocalPorts

# Settings of the service, used if this runs as root.
SERVICE_SETTINGS = Path("/etc/imud.toml")

ROOT = Path("/")

NONE = """\
no serial port; docs/connect.md lists the usual causes: a cable without data \
wires, brltty, a group
"""

RELOAD = """\
to tell ModemManager, and to create the links in /dev/imu-probe:
  udevadm control --reload && udevadm trigger --subsystem-match=tty
"""


def add(commands: Commands) -> None:
    """Adds `imud ports` and its commands."""
    ports = add_command(
        commands,
        "ports",
        "show the serial ports, which programs use them, and which ones imud opens",
        "imud ports, and then: imud ports adopt /dev/ttyUSB0",
        "imud does not open a port that may belong to another program until you "
        "adopt it or name it: imud run PORT.",
    )
    _add_config(ports)
    add_json(
        ports,
        "print one JSON object a port: port, kind, standing, is_opened, why, held_by",
    )
    ports.set_defaults(run=_list)
    actions = ports.add_subparsers(metavar="[adopt|release]")
    for name, text, run in (
        (
            "adopt",
            "let imud open this port from now on, as a probe is connected to it",
            _adopt,
        ),
        ("release", "stop imud from opening this port", _release),
    ):
        action = add_command(actions, name, text, f"imud ports {name} /dev/ttyUSB0")
        action.add_argument("port", metavar="PORT", help="such as /dev/ttyUSB0")
        _add_config(action, default=argparse.SUPPRESS)  # or what stands before
        action.set_defaults(run=run)


def _add_config(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    parser.add_argument(
        "--config",
        default=default,
        metavar="FILE",
        type=Path,
        help=f"settings of the daemon (default: none; for root {SERVICE_SETTINGS}, if "
        "it is there)",
    )


def _ports(args: argparse.Namespace) -> LocalPorts:
    from imud.config import reader
    from imud.ports.local import LocalPorts

    path = args.config
    if path is None and system.is_administrator() and SERVICE_SETTINGS.exists():
        path = SERVICE_SETTINGS
    return LocalPorts(reader.load(path).ports)


def _list(args: argparse.Namespace) -> int:
    import msgspec

    found = _ports(args).rows()
    if args.json:
        for row in found:
            sys.stdout.write(msgspec.json.encode(row).decode() + "\n")
        return 0
    if not found:
        sys.stdout.write(NONE)
    for row in found:
        sys.stdout.write(f"{row.port}  {row.kind}\n    {row.why}\n")
        for holder in row.held_by:
            sys.stdout.write(f"    open in {holder}\n")
    return 0


def _adopt(args: argparse.Namespace) -> int:
    ports = _ports(args)
    is_new = ports.adopt(args.port)
    what = "is ours from now on" if is_new else "was ours already"
    sys.stdout.write(f"{args.port} {what}: {ports.adopted.path}\n")
    _tell_service(ports.adopted)
    return 0


def _release(args: argparse.Namespace) -> int:
    ports = _ports(args)
    is_known = ports.release(args.port)
    what = "is left to other programs from now on" if is_known else "was not ours"
    sys.stdout.write(f"{args.port} {what}: {ports.adopted.path}\n")
    _tell_service(ports.adopted)
    return 0


def _tell_service(adopted: AdoptedPorts) -> None:
    """A service has a file of its own, which only root may write, and udev rules."""
    from imud.daemon.install import write
    from imud.ports import udev
    from imud.ports.adopted import SERVICE_FOLDER

    if not SERVICE_FOLDER.exists():
        return
    if adopted.path.parent != SERVICE_FOLDER:
        sys.stdout.write(
            "this applies to daemons that you run; the service has its own list: sudo "
            "imud ports\n"
        )
    elif (ROOT / udev.PLACE).exists():
        write(ROOT / udev.ADOPTED_PLACE, udev.adopted_rules(adopted.known))
        sys.stdout.write(RELOAD)
