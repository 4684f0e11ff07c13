# SPDX-License-Identifier: MIT
"""The command line. Each command imports what it needs when it runs."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from imud.defaults import ENDPOINT, PORT, PREFIX
from imud.errors import ConfigError, ImudError, described

if TYPE_CHECKING:
    from imud.client import Client

# Exit code of a fault of imud's own: EX_SOFTWARE of sysexits.h.
FAULT = 70


def _plain(text: str) -> str:
    """Words may repeat what was typed or what a file holds."""
    return "".join(c if c.isprintable() else "?" for c in text)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        super().error(_plain(message))


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from imud.version import version

        parser.exit(message=f"imud {version()}\n")


def _command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    text: str,
    example: str,
) -> argparse.ArgumentParser:
    return commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}.",
        epilog=f"example: {example}",
    )


def _probe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "probe",
        metavar="PROBE",
        nargs="?",
        help="its id or name; not needed where there is just one",
    )


def _network(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=ENDPOINT,
        help="where imud run listens (default: %(default)s)",
    )
    parser.add_argument(
        "--prefix",
        metavar="KEY",
        default=PREFIX,
        help="first part of its keys (default: %(default)s)",
    )
    parser.add_argument(
        "--keys",
        metavar="FILE",
        type=Path,
        help="who asks, and where the daemon is: clients/NAME.toml of imud keys",
    )


def _seconds(text: str) -> float:
    with contextlib.suppress(ValueError):
        seconds = float(text)
        if 0 < seconds < float("inf"):
            return seconds
    raise argparse.ArgumentTypeError(f"{text} is not a number above 0")


def build_parser() -> argparse.ArgumentParser:
    from imud.virtual import sim
    from imud.wire import schema

    parser: argparse.ArgumentParser = _Parser(
        prog="imud",
        description="Makes the pose of imu-probes a network service.",
        epilog="example: imud run /dev/ttyUSB0, and in another terminal: imud listen",
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="say which imud this is and exit"
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    run = _command(
        commands,
        "run",
        "read probes, publish what they say, and log it",
        "imud run /dev/ttyUSB0 --log logs",
    )
    run.add_argument(
        "ports",
        metavar="PORT[@BAUD]",
        nargs="*",
        help="serial port of a probe, at a rate that is found if it is not named "
        "(default: probes are found on all USB and Bluetooth ports)",
    )
    run.add_argument("--config", metavar="FILE", type=Path, help="settings as TOML")
    log = run.add_mutually_exclusive_group()
    log.add_argument(
        "--log", metavar="DIR", type=Path, help="where logs go (default: logs)"
    )
    log.add_argument("--no-log", action="store_true", help="keep no log")
    run.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"where subscribers connect to (default: {ENDPOINT})",
    )
    run.add_argument(
        "--keys",
        metavar="DIR",
        type=Path,
        help="let in only who has keys of this folder, which imud keys made",
    )
    run.add_argument(
        "--twin",
        action="store_true",
        help="compute each pose again from raw messages and tell the first that "
        "differs; whenever a probe streams, its calibration at rest and its origin "
        "begin anew",
    )
    run.add_argument(
        "--log-level",
        choices=["debug", "info", "warning", "error"],
        help="the least that is written on stderr (default: info)",
    )
    run.set_defaults(run=_run)

    settings = _command(
        commands,
        "config",
        "print all settings, each with its default and what it is for, or check a file",
        "imud config > imud.toml, and then: imud config --check imud.toml",
    )
    settings.add_argument(
        "--check", metavar="FILE", type=Path, help="tell each mistake of a file"
    )
    settings.set_defaults(run=_config)

    install = _command(
        commands,
        "install-service",
        "write a systemd unit, a udev rule and /etc/imud.toml, so that imud runs from "
        "the start of the machine",
        "sudo imud install-service",
    )
    install.add_argument(
        "--print", action="store_true", help="only show what would be written"
    )
    install.add_argument(
        "--user",
        metavar="NAME",
        default="imud",
        help="who it runs as (default: %(default)s)",
    )
    install.add_argument(
        "--prefix",
        metavar="DIR",
        type=Path,
        default=Path("/"),
        help="where etc/ is, for a package or an image (default: %(default)s)",
    )
    install.set_defaults(run=_install_service)

    sim.add_parser(commands)

    listen = _command(
        commands,
        "listen",
        "print poses as they come over the network: yaw from east to north, pitch x "
        "down, roll y up (docs/angles.md), sigmas, rate and flags",
        "imud listen --seconds 10",
    )
    _probe(listen)
    listen.add_argument(
        "--json", action="store_true", help="one JSON object a line, as published"
    )
    listen.add_argument("--seconds", metavar="N", type=_seconds, help="stop after N")
    _network(listen)
    listen.set_defaults(run=_listen)

    listing = _command(
        commands, "list", "show the probes and how they do", "imud list --json"
    )
    listing.add_argument(
        "--json", action="store_true", help="one status object a line, as published"
    )
    listing.add_argument(
        "--ledger",
        action="store_true",
        help="also the way of the data, from the sensor to each sink",
    )
    _network(listing)
    listing.set_defaults(run=_list)

    monitor = _command(
        commands, "monitor", "show all probes on one screen", "imud monitor"
    )
    monitor.add_argument("--seconds", metavar="N", type=_seconds, help="stop after N")
    _network(monitor)
    monitor.set_defaults(run=_monitor)

    for name, text in (
        ("start", "make a probe stream"),
        ("stop", "make a probe stop streaming"),
        ("tare", "take a probe's orientation as its origin"),
        (
            "restart",
            "begin a probe's calibration at rest, filter and origin anew; lay it still",
        ),
    ):
        command = _command(commands, name, text, f"imud {name}")
        _probe(command)
        if name == "tare":
            what = command.add_mutually_exclusive_group()
            what.add_argument(
                "--heading", action="store_true", help="only the heading; keep the tilt"
            )
            what.add_argument(
                "--undo", action="store_true", help="go back to east, north, up"
            )
        if name == "restart":
            command.add_argument(
                "--filter",
                choices=[each.name.lower() for each in schema.Filter if each],
                help="which filter is to run (default: the one that runs)",
            )
        _network(command)
        command.set_defaults(run=_order, command=name)

    decode = _command(
        commands,
        "decode",
        "print the messages of a capture of UART bytes, of a log or of a PROBE.LOG",
        "imud decode logs/imud-20260102T030405Z.mcap --json",
    )
    decode.add_argument("file", metavar="FILE", type=Path)
    decode.add_argument(
        "--json", action="store_true", help="one JSON object a line for each message"
    )
    decode.set_defaults(run=_decode)

    _logs(commands)
    _card(commands)
    _keys(commands)
    return parser


def _logs(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    info = _command(
        commands,
        "info",
        "say what logs hold, whether they are whole and what was lost on the way",
        "imud info logs/*.mcap",
    )
    info.add_argument("logs", metavar="LOG", nargs="+", type=Path)
    info.add_argument("--json", action="store_true", help="one JSON object a log")
    info.set_defaults(run=_info)

    recover = _command(
        commands,
        "recover",
        "save what is good in a log that was cut off or damaged, as a whole one",
        "imud recover logs/imud-20260102T030405Z.mcap",
    )
    recover.add_argument("log", metavar="LOG", type=Path)
    recover.add_argument(
        "--to",
        metavar="FILE",
        type=Path,
        help="where it goes (default: beside it, as LOG-recovered.mcap)",
    )
    recover.set_defaults(run=_recover)

    replay = _command(
        commands,
        "replay",
        "play a log as if its probes were there: each on a pty, or all over Zenoh",
        "imud replay logs/imud-20260102T030405Z.mcap --link /tmp/probe, and in another "
        "terminal: imud run /tmp/probe",
    )
    replay.add_argument(
        "logs",
        metavar="LOG",
        nargs="+",
        type=Path,
        help="of several, as rotated files are, the one that began first comes first",
    )
    replay.add_argument("--probe", metavar="PROBE", help="only this one (default: all)")
    replay.add_argument(
        "--speed",
        metavar="X",
        type=_speed,
        default=1.0,
        help="so many times as fast as it was; max or 0: as fast as it goes "
        "(default: 1)",
    )
    where = replay.add_mutually_exclusive_group()
    where.add_argument(
        "--link", metavar="PATH", type=Path, help="where its serial port appears"
    )
    where.add_argument(
        "--connect",
        metavar="ENDPOINT",
        nargs="?",
        const=ENDPOINT,
        help="publish on its keys into the Zenoh network there, no port "
        "(default: %(const)s)",
    )
    replay.add_argument(
        "--keys",
        metavar="FILE",
        type=Path,
        help="who publishes, and where: clients/NAME.toml of a user of role daemon",
    )
    replay.set_defaults(run=_replay)

    export = _command(
        commands,
        "export",
        "write logs as tables, a file for each log, probe and kind: pose, raw, event, "
        "status (its numbers), twin, clock, log",
        "imud export logs/imud-20260102T030405Z.mcap --to csv --out tables",
    )
    export.add_argument("logs", metavar="LOG", nargs="+", type=Path)
    export.add_argument("--to", choices=("csv", "parquet"), default="csv")
    export.add_argument(
        "--out", metavar="DIR", type=Path, help="where they go (default: beside it)"
    )
    export.set_defaults(run=_export)


def _speed(text: str) -> float | None:
    return None if text in ("max", "0") else _seconds(text)


def _card(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    card = _command(
        commands,
        "card",
        "prepare the card on which a probe logs, and read what it holds",
        "imud card prepare /dev/sdb, and later: imud card read /dev/sdb --to logs",
    ).add_subparsers(metavar="WHAT", required=True)

    prepare = _command(
        card,
        "prepare",
        "make a card ready for a probe (FAT32 with one file, PROBE.LOG); all that is "
        "on it is lost",
        "imud card prepare /dev/sdb",
    )
    prepare.add_argument(
        "path", metavar="DEVICE-OR-IMAGE", type=Path, help="a whole card, or a file"
    )
    prepare.add_argument(
        "--size", metavar="BYTES", type=_bytes, help="make an image of so many: 8G"
    )
    prepare.add_argument(
        "--log-size",
        metavar="BYTES",
        type=_bytes,
        help="how large the log is (default: what fits, up to 4 GiB)",
    )
    prepare.add_argument("--yes", action="store_true", help="overwrite without asking")
    prepare.set_defaults(run=_card_prepare)

    read = _command(
        card,
        "read",
        "write a log for each recording of a card",
        "imud card read /dev/sdb --recording 3 --started 2026-01-02T03:04:05Z",
    )
    listing = _command(
        card,
        "list",
        "show the recordings of a card",
        "imud card list /media/me/IMU-PROBE/PROBE.LOG",
    )
    for parser in (read, listing):
        parser.add_argument(
            "path",
            metavar="CARD",
            type=Path,
            help="a card, an image of one, or its PROBE.LOG, also a copy",
        )
    read.add_argument(
        "--to",
        metavar="DIR",
        type=Path,
        default=Path("logs"),
        help="where the logs go (default: %(default)s)",
    )
    read.add_argument(
        "--recording", metavar="N", type=int, help="only this one (default: all)"
    )
    read.add_argument(
        "--started",
        metavar="UTC",
        type=_time_ns,
        help="when the recording began: a probe has no calendar (default: times are "
        "the device's, from 1970 on)",
    )
    read.add_argument(
        "--prefix",
        metavar="KEY",
        default=PREFIX,
        help="first part of the channels' names (default: %(default)s)",
    )
    read.set_defaults(run=_card_read)
    listing.set_defaults(run=_card_list)


def _keys(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    from imud.net import access

    keys = _command(
        commands,
        "keys",
        "make what lets users in, each to what its role allows: certificates, "
        "passwords, a file for each user",
        "imud keys init keys --name probes.example.org",
    ).add_subparsers(metavar="WHAT", required=True)
    init = _command(
        keys,
        "init",
        "make an authority, the daemon's certificate and a first user of each role",
        "imud keys init keys --name probes.example.org",
    )
    init.add_argument("dir", metavar="DIR", type=Path)
    init.add_argument(
        "--name",
        metavar="HOST",
        action="append",
        default=[],
        help="name or address by which users reach the daemon; may be said again "
        "(default: this machine's name; localhost and 127.0.0.1 are always among them)",
    )
    init.add_argument(
        "--port", metavar="N", type=int, default=PORT, help="(default: %(default)s)"
    )
    init.set_defaults(run=_keys_init)
    add = _command(
        keys, "add", "let a user more in", "imud keys add keys operator anna"
    )
    add.add_argument("dir", metavar="DIR", type=Path)
    add.add_argument(
        "role",
        metavar="ROLE",
        choices=list(access.ROLES),
        help="; ".join(f"{role}: {what}" for role, what in access.ROLES.items()),
    )
    add.add_argument("user", metavar="NAME")
    add.set_defaults(run=_keys_add)
    remove = _command(
        keys, "remove", "let a user in no longer", "imud keys remove keys anna"
    )
    remove.add_argument("dir", metavar="DIR", type=Path)
    remove.add_argument("user", metavar="NAME")
    remove.set_defaults(run=_keys_remove)


def _bytes(text: str) -> int:
    units = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}
    number, unit = (text[:-1], units[text[-1:]]) if text[-1:] in units else (text, 1)
    if not number.isdecimal():
        raise argparse.ArgumentTypeError(
            f"{text} is not a number of bytes, as 512M or 8G (of 1024)"
        )
    return int(number) * unit


def _time_ns(text: str) -> int:
    from datetime import UTC, datetime

    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text} is not a time as 2026-01-02T03:04:05Z"
        ) from error
    since = time.replace(tzinfo=time.tzinfo or UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * 10**9 + since.microseconds * 1000


def _run(args: argparse.Namespace) -> int:
    from imud.config import reader
    from imud.daemon import daemon

    return daemon.run(
        lambda: reader.load(
            args.config,
            ports=args.ports,
            listen=args.listen,
            keys=args.keys,
            log_dir=args.log,
            is_logging=not args.no_log,
            is_twin=args.twin,
            level=args.log_level,
        )
    )


def _config(args: argparse.Namespace) -> int:
    from imud.config import reader
    from imud.config.settings import Config

    if args.check is None:
        sys.stdout.write(reader.as_toml(Config()))
        return 0
    found = reader.check(args.check)
    for line in found:
        sys.stderr.write(f"imud: {line}\n")
    if not found:
        sys.stdout.write(f"{args.check}: all of it can be\n")
    return 1 if found else 0


def _install_service(args: argparse.Namespace) -> int:
    from imud.daemon import install

    return install.run(args.prefix, args.user, is_shown=args.print)


def _client(args: argparse.Namespace) -> Client:
    from imud.client import Client

    return Client(args.connect, args.prefix, args.keys)


def _listen(args: argparse.Namespace) -> int:
    from imud.cli import view

    with _client(args) as client:
        return view.listen(client, args.probe, args.seconds, as_json=args.json)


def _list(args: argparse.Namespace) -> int:
    from imud.cli import view

    with _client(args) as client:
        return view.show_probes(client, as_json=args.json, has_ledger=args.ledger)


def _monitor(args: argparse.Namespace) -> int:
    from imud.cli import monitor

    return monitor.run(args.connect, args.prefix, keys=args.keys, seconds=args.seconds)


def _order(args: argparse.Namespace) -> int:
    arguments = {}
    if args.command == "tare" and args.heading:
        arguments["what"] = "heading"
    if args.command == "tare" and args.undo:
        arguments["what"] = "undo"
    if args.command == "restart" and args.filter:
        arguments["filter"] = args.filter
    with _client(args) as client:
        probe = client.only_probe(args.probe)
        client.command(probe, args.command, **arguments)
    sys.stdout.write(f"{probe}: {args.command} done\n")
    return 0


def _decode(args: argparse.Namespace) -> int:
    from imud.recordings import decode

    return decode.run(args.file, as_json=args.json)


def _info(args: argparse.Namespace) -> int:
    from imud.recordings import info

    return info.run(args.logs, as_json=args.json)


def _recover(args: argparse.Namespace) -> int:
    from imud.recordings import recover

    return recover.run(args.log, args.to)


def _replay(args: argparse.Namespace) -> int:
    from imud.recordings import replay

    if args.link is not None and args.keys is not None:
        raise ConfigError("--link is a port, which needs no --keys; leave one out")
    what = replay.recording(args.logs, args.probe)
    if args.connect is None and args.keys is None:
        return replay.to_ports(what, args.link, args.speed)
    with replay.connected(what, args.connect, args.keys) as client:
        return replay.to_network(what, client, args.speed)


def _export(args: argparse.Namespace) -> int:
    from imud.recordings import export

    return export.run(args.logs, args.to, args.out)


def _keys_init(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_init(args.dir, args.name, args.port)


def _keys_add(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_add(args.dir, args.role, args.user)


def _keys_remove(args: argparse.Namespace) -> int:
    from imud.net import keys

    return keys.run_remove(args.dir, args.user)


def _card_prepare(args: argparse.Namespace) -> int:
    from imud.card import prepare

    return prepare.prepare(
        args.path, size=args.size, log_size=args.log_size, is_agreed=args.yes
    )


def _card_read(args: argparse.Namespace) -> int:
    from imud.card import read

    return read.read(
        args.path,
        to=args.to,
        prefix=args.prefix,
        number=args.recording,
        started_ns=args.started,
    )


def _card_list(args: argparse.Namespace) -> int:
    from imud.card import listing

    return listing.show(args.path)


def main(argv: Sequence[str] | None = None) -> int:
    args = build_parser().parse_args(argv)
    try:
        status: int = args.run(args)
        sys.stdout.flush()
    except ImudError as error:
        sys.stderr.write(f"imud: {_plain(str(error))}\n")
        return 1
    except BrokenPipeError:
        # The reader of a pipe has gone, as `head` does; its end is ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.filename is None:
            raise
        # A name that no file can have, or a folder that may not be looked into.
        text = f"can't use {error.filename}: {error.strerror}"
        sys.stderr.write(f"imud: {_plain(text)}\n")
        return 1
    except KeyboardInterrupt:
        return 130  # 128 + SIGINT, as shells say it
    return status


def program() -> NoReturn:
    """`imud` as a process, which ends here and not with the interpreter's own end.

    That would unwind each daemon thread that wants to go on, and abort where it does so
    through native code: Zenoh wakes the threads of its callbacks when a session is
    closed. It would also wait for ever for a disk that is stuck.
    """
    try:
        status = main()
    except Exception as fault:  # noqa: BLE001 - a fault of imud's own, told on one line
        sys.stderr.write(f"imud: a fault of its own: {described(fault)}\n")
        if os.environ.get("IMUD_TRACEBACK"):
            traceback.print_exc()
        status = FAULT
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status)
