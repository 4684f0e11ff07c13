# SPDX-License-Identifier: MIT
"""The daemon: `imud run`, `imud config` and `imud install-service`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command
from imud.defaults import ENDPOINT, PAGE
from imud.errors import ConfigError, ImudError

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


# Exit code of `imud run` for settings that can't be: EX_CONFIG of sysexits.h. A service
# manager does not start it again.
MISCONFIGURED = 78


def add(commands: Commands) -> None:
    _add_run(commands)
    _add_config(commands)
    _add_install_service(commands)


def _add_run(commands: Commands) -> None:
    run = _run_command(commands)
    run.add_argument(
        "--twin",
        action="store_true",
        help="recompute each pose from the raw samples and report the first that "
        "differs; this restarts a probe's calibration at rest and its origin "
        "whenever it starts to stream",
    )
    run.add_argument(
        "--log-level",
        choices=["debug", "info", "warning", "error"],
        help="write messages of this level and above to stderr (default: info)",
    )
    run.add_argument(
        "--until-eof",
        action="store_true",
        help="exit when standard input closes, that is with the program that started "
        "imud",
    )
    run.set_defaults(run=_run)


def _run_command(commands: Commands) -> argparse.ArgumentParser:
    """With its ports, and where its data go."""
    run = add_command(
        commands,
        "run",
        "read the probes, publish their data on the network and log it",
        "imud run /dev/ttyUSB0 --log logs",
        "This is the daemon: it runs until Ctrl-C.",
    )
    run.add_argument(
        "ports",
        metavar="PORT[@BAUD]",
        nargs="*",
        help="serial port of a probe; its baud rate is detected unless given "
        "(default: the ports that imud ports lists as ours)",
    )
    run.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="TOML file of settings, as printed by imud config; arguments override it",
    )
    log = run.add_mutually_exclusive_group()
    log.add_argument(
        "--log", metavar="DIR", type=Path, help="folder for the logs (default: logs)"
    )
    log.add_argument("--no-log", action="store_true", help="do not write a log")
    run.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"address for subscribers (default: {ENDPOINT})",
    )
    run.add_argument(
        "--keys",
        metavar="DIR",
        type=Path,
        help="admit only users with keys from this folder, created by imud keys "
        "(default: no keys; it then listens on this machine only)",
    )
    page = run.add_mutually_exclusive_group()
    page.add_argument(
        "--page",
        metavar="HOST:PORT",
        help="address of the page on this machine; port 0: any free port (default: "
        f"{PAGE})",
    )
    page.add_argument("--no-page", action="store_true", help="do not serve the page")
    return run


def _add_config(commands: Commands) -> None:
    settings = add_command(
        commands,
        "config",
        "print all settings with their defaults and meanings, or check a file",
        "imud config > imud.toml, and then: imud config --check imud.toml",
    )
    what = settings.add_mutually_exclusive_group()
    what.add_argument(
        "--check", metavar="FILE", type=Path, help="print every mistake in this file"
    )
    what.add_argument(
        "--changed",
        metavar="FILE",
        type=Path,
        help="print only the settings in this file that differ from the defaults",
    )
    settings.set_defaults(run=_config)


def _add_install_service(commands: Commands) -> None:
    install = add_command(
        commands,
        "install-service",
        "start imud at boot, as a systemd service",
        "sudo imud install-service",
        "Writes a systemd unit, a udev rule and /etc/imud.toml.",
    )
    what = install.add_mutually_exclusive_group()
    what.add_argument(
        "--print", action="store_true", help="show what would be written, and stop"
    )
    what.add_argument(
        "--remove",
        action="store_true",
        help="remove the service's files; settings, logs and params stay",
    )
    install.add_argument(
        "--user",
        metavar="NAME",
        default="imud",
        help="user that the service runs as (default: %(default)s)",
    )
    install.add_argument(
        "--prefix",
        metavar="DIR",
        type=Path,
        default=Path("/"),
        help="folder that contains etc/, for packages and images (default: "
        "%(default)s)",
    )
    install.set_defaults(run=_install_service)


def _end_at_eof() -> None:
    """In a thread of its own."""
    while sys.stdin.buffer.read(1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def _run(args: argparse.Namespace) -> int:
    from imud.config import reader
    from imud.daemon import daemon
    from imud.daemon.systemd import Notifier

    load = partial(
        reader.load,
        args.config,
        ports=args.ports,
        listen=args.listen,
        keys=args.keys,
        log_dir=args.log,
        is_logging=not args.no_log,
        is_twin=args.twin,
        page=args.page,
        is_page=not args.no_page,
        level=args.log_level,
    )
    if args.until_eof:
        threading.Thread(target=_end_at_eof, daemon=True).start()
    try:
        return daemon.run(load)
    except ImudError as error:
        is_final = isinstance(error, ConfigError)
        mend = "; correct it, then: systemctl restart imu-probe" if is_final else ""
        Notifier().status(f"{error}{mend}")
        if not is_final:
            raise
        sys.stderr.write(f"imud: {error}\n")
        return MISCONFIGURED


def _config(args: argparse.Namespace) -> int:
    from imud.config import reader
    from imud.config.settings import Config

    if args.changed is not None:
        sys.stdout.write(reader.changed_in(args.changed))
        return 0
    if args.check is None:
        sys.stdout.write(reader.as_toml(Config()))
        return 0
    found = reader.check(args.check)
    for line in found:
        sys.stderr.write(f"imud: {line}\n")
    if not found:
        sys.stdout.write(f"{args.check}: no mistakes\n")
    return 1 if found else 0


def _install_service(args: argparse.Namespace) -> int:
    from imud.daemon import install

    if args.remove:
        return install.remove(args.prefix)
    return install.run(args.prefix, args.user, is_shown=args.print)
