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

from imud.errors import ImudError

if TYPE_CHECKING:
    from imud.client import Client

# Loopback only; 7447 is Zenoh's own port.
ENDPOINT = "tcp/127.0.0.1:7447"

PREFIX = "imud"


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


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0 < seconds < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return seconds


def build_parser() -> argparse.ArgumentParser:
    from imud import schema, sim

    parser = argparse.ArgumentParser(
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
        help="serial port of a probe; the rate is 500000 (Nano) unless told otherwise: "
        "921600 for an STM32F405",
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
        "--twin",
        action="store_true",
        help="compute each pose again from raw messages and tell the first that "
        "differs; whenever a probe streams, its calibration at rest and its origin "
        "begin anew",
    )
    run.set_defaults(run=_run)

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
    _network(listing)
    listing.set_defaults(run=_list)

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

    _card(commands)
    return parser


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
    from imud import config, daemon

    settings = config.load(
        args.config,
        ports=args.ports,
        listen=args.listen,
        log_dir=args.log,
        is_logging=not args.no_log,
        is_twin=args.twin,
    )
    return daemon.run(settings)


def _client(args: argparse.Namespace) -> Client:
    from imud.client import Client

    return Client(args.connect, args.prefix)


def _listen(args: argparse.Namespace) -> int:
    from imud import view

    with _client(args) as client:
        return view.listen(client, args.probe, args.seconds, as_json=args.json)


def _list(args: argparse.Namespace) -> int:
    from imud import view

    with _client(args) as client:
        return view.show_probes(client, as_json=args.json)


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
    from imud import decode

    return decode.run(args.file, as_json=args.json)


def _card_prepare(args: argparse.Namespace) -> int:
    from imud import card

    return card.prepare(
        args.path, size=args.size, log_size=args.log_size, is_agreed=args.yes
    )


def _card_read(args: argparse.Namespace) -> int:
    from imud import card

    return card.read(
        args.path,
        to=args.to,
        prefix=args.prefix,
        number=args.recording,
        started_ns=args.started,
    )


def _card_list(args: argparse.Namespace) -> int:
    from imud import card

    return card.show(args.path)


def main(argv: Sequence[str] | None = None) -> int:
    args = build_parser().parse_args(argv)
    try:
        status: int = args.run(args)
        sys.stdout.flush()
    except ImudError as error:
        sys.stderr.write(f"imud: {error}\n")
        return 1
    except BrokenPipeError:
        # The reader of a pipe has gone, as `head` does; its end is ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
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
    except Exception:  # noqa: BLE001 - told as the interpreter tells it
        traceback.print_exc()
        status = 1
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status)
