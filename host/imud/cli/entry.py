# SPDX-License-Identifier: MIT
"""The command line: its parser, and how each command ends.

Commands import what they need when they run, so that `imud --help` answers at once.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from imud import checkout
from imud.cli import (
    body,
    bridge,
    calibrate,
    card,
    check,
    completion,
    daemon,
    demo,
    flash,
    importing,
    keys,
    params,
    ports,
    probe,
    recordings,
    refining,
    sim,
    watch,
)
from imud.cli.parser import GroupedParser, Parser, plain
from imud.errors import BuildFailed, ImudError, described, told

# Exit code of a fault of imud's own: EX_SOFTWARE of sysexits.h.
FAULT = 70

# The rooms by the titles under which the help lists their commands.
GROUPS = {
    "the daemon": (daemon, keys),
    "watch": (watch, body, bridge),
    "command": (probe,),
    "calibrate": (calibrate, params),
    "logs": (recordings, refining, importing, card),
    "set up and try": (demo, ports, flash, check, sim, completion),
}


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from imud.version import version

        sys.stdout.write(f"imud {version()}\n")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands. The arguments that it returns have `run`: the
    function that runs the command and returns its exit code.
    """
    parser = GroupedParser(
        prog="imud",
        description="Makes the pose of imu-probes a network service.",
        epilog="example: imud run /dev/ttyUSB0, and in another terminal: imud listen",
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="print the version of imud and exit"
    )
    parser.commands = parser.add_subparsers(
        metavar="COMMAND", required=True, parser_class=Parser
    )
    for title, rooms in GROUPS.items():
        before = len(parser.commands.choices)
        for room in rooms:
            room.add(parser.commands)
        parser.groups[title] = [*parser.commands.choices][before:]
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command (default: that of sys.argv) and returns its exit code: 1 after
    an error, which is one line on stderr. Wrong usage raises SystemExit with code 2.
    """
    try:
        args = build_parser().parse_args(argv)
        status: int = args.run(args)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of a pipe has ended, as `head` does: end without complaint.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ImudError, OSError, MemoryError, UnicodeEncodeError) as error:
        if isinstance(error, OSError) and error.errno is None:
            raise
        sys.stderr.write(f"imud: {plain(told(error))}\n")
        return 1
    except KeyboardInterrupt:
        return 130  # 128 + SIGINT, as shells say it
    return status


def _prepare_streams() -> None:
    """Gives a process that was started without them standard streams, and has those
    that know few characters show `?` for others.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # it gets its number: the lowest that is free
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115 - as long as the process
    for stream in (sys.stdout, sys.stderr):
        # A descriptor that another program has put in place may not seek.
        with contextlib.suppress(OSError):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")


def program() -> NoReturn:
    """`imud` as a process. It ends by os._exit(), without the interpreter's shutdown.

    The shutdown unwinds each daemon thread that is about to run, and aborts the process
    if that happens inside native code: Zenoh wakes the threads of its callbacks when a
    session is closed. It would also wait for ever for a disk that is stuck.
    """
    try:
        _prepare_streams()
        checkout.refresh_core()
        status = main()
    except BuildFailed as error:
        sys.stderr.write(f"imud: {error}\n")
        status = 1
    except Exception as fault:  # noqa: BLE001 - a fault of imud's own, told on one line
        sys.stderr.write(f"imud: internal error: {described(fault)}\n")
        if os.environ.get("IMUD_TRACEBACK"):
            traceback.print_exc()
        status = FAULT
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status)
