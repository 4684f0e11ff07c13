# SPDX-License-Identifier: MIT
"""Logs and captures: `imud record`, `decode`, `info`, `recover`, `replay`, `export`."""

from __future__ import annotations

import argparse
import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import (
    above_zero,
    add_command,
    add_json,
    add_network,
    add_probe,
    add_seconds,
    client_of,
    finite,
)
from imud.defaults import ENDPOINT
from imud.errors import ConfigError

if TYPE_CHECKING:
    from imud.cli.arguments import Commands


A_LOG = "an MCAP file, or a capture of a UART; -: standard input"


def add(commands: Commands) -> None:
    _add_record(commands)
    _add_info(commands)
    _add_decode(commands)
    _add_export(commands)
    _add_replay(commands)
    _add_recover(commands)


def _add_record(commands: Commands) -> None:
    record = add_command(
        commands,
        "record",
        "write what daemons publish over the network to logs",
        "imud record --connect tcp/hub.example.org:7447 --keys recorder.toml",
        "It records all probes behind that router. The logs are as from imud run, "
        "with a topic `gap` for sequence gaps. Ctrl-C ends it.",
    )
    add_probe(record)
    record.add_argument(
        "--log",
        metavar="DIR",
        type=Path,
        default=Path("logs"),
        help="folder of the logs (default: %(default)s)",
    )
    add_seconds(record)
    add_json(record, "print a summary as one JSON object")
    add_network(record)
    record.set_defaults(run=_record)


def _add_decode(commands: Commands) -> None:
    decode = add_command(
        commands,
        "decode",
        "print the messages in a log, a UART capture or a card's PROBE.LOG",
        "imud decode logs/imud-20260102T030405Z.mcap --json",
    )
    decode.add_argument(
        "file", metavar="FILE", type=Path, help="what to print; -: standard input"
    )
    add_json(decode, "print one JSON object a line")
    decode.set_defaults(run=_decode)


def _add_info(commands: Commands) -> None:
    info = add_command(
        commands,
        "info",
        "summarise logs: contents, losses, damage",
        "imud info logs/*.mcap",
    )
    info.add_argument("logs", metavar="LOG", nargs="+", type=Path, help=A_LOG)
    add_json(info, "print one JSON object per log")
    info.set_defaults(run=_info)


def _add_recover(commands: Commands) -> None:
    recover = add_command(
        commands,
        "recover",
        "copy the readable part of a truncated or damaged log to a new one",
        "imud recover logs/imud-20260102T030405Z.mcap",
    )
    recover.add_argument("log", metavar="LOG", type=Path, help="an MCAP file")
    recover.add_argument(
        "--to",
        metavar="FILE",
        type=Path,
        help="the new log (default: LOG-recovered.mcap, beside LOG)",
    )
    recover.set_defaults(run=_recover)


def _add_replay(commands: Commands) -> None:
    replay = add_command(
        commands,
        "replay",
        "play logs as if their probes were connected",
        "imud replay logs/imud-20260102T030405Z.mcap --link /tmp/probe, and in another "
        "terminal: imud run /tmp/probe",
        "Each probe gets a serial port (a pty) for imud run to read. With --connect or "
        "--keys, all probes are published over Zenoh, as a daemon would.",
    )
    replay.add_argument(
        "logs",
        metavar="LOG",
        nargs="+",
        type=Path,
        help=f"{A_LOG}; several are played in order of their start",
    )
    replay.add_argument(
        "--probe", metavar="PROBE", help="play only this probe (default: all)"
    )
    replay.add_argument(
        "--speed",
        metavar="X",
        type=speed,
        default=1.0,
        help="X times real time; max or 0: as fast as possible (default: 1)",
    )
    where = replay.add_mutually_exclusive_group()
    where.add_argument(
        "--link",
        metavar="PATH",
        type=Path,
        help="path of the serial port, for a log with one probe",
    )
    where.add_argument(
        "--connect",
        metavar="ENDPOINT",
        nargs="?",
        const=ENDPOINT,
        help="publish to the Zenoh network at ENDPOINT; no serial ports (ENDPOINT may "
        "be left out: %(const)s)",
    )
    replay.add_argument(
        "--keys",
        metavar="FILE",
        type=Path,
        help="publish with these credentials: the file clients/NAME.toml of a user "
        "with the role daemon; it also has the address",
    )
    replay.set_defaults(run=_replay)


def _add_export(commands: Commands) -> None:
    export = add_command(
        commands,
        "export",
        "write logs as CSV or Parquet tables, or as a ROS 2 bag",
        "imud export logs/imud-20260102T030405Z.mcap --to csv --out tables",
        "One file for each log, probe and kind: pose, raw, event, status (its "
        "numbers), twin, clock, log. With --body: the joint angles of several probes.",
    )
    export.add_argument(
        "logs",
        metavar="LOG",
        nargs="+",
        type=Path,
        help=f"{A_LOG}; with --body MCAP files, or PROBE=FILE, a motion (.npz, .csv)",
    )
    export.add_argument(
        "--to",
        choices=("csv", "parquet", "rosbag2", "sto", "bvh", "c3d"),
        default="csv",
        help="file format; rosbag2: a ROS 2 bag for each log; with --body also "
        "OpenSim's (sto), BVH and C3D (default: %(default)s)",
    )
    export.add_argument(
        "--fuse",
        action="store_true",
        help="compute poses of the raw samples, also of a foreign recording, as the "
        "firmware does (20 samples a second and more), in the place of those logged",
    )
    export.add_argument(
        "--body",
        metavar="FILE",
        type=Path,
        help="the segments that the probes sit on (docs/limb.md): all logs together "
        "become joint angles and attitudes",
    )
    export.add_argument(
        "--facing",
        metavar="DEG",
        type=finite,
        help="with --body: the compass direction that the person faced when standing, "
        "clockwise from north, for probes without a hinge",
    )
    export.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="folder for the tables (default: the log's folder)",
    )
    export.set_defaults(run=_export)


def speed(text: str) -> float | None:
    """How many times real time; None: as fast as possible."""
    return None if text in ("max", "0") else above_zero(text)


def _record(args: argparse.Namespace) -> int:
    from imud.log.file import Settings
    from imud.recordings import record

    with client_of(args) as client:
        client.check_known(args.probe)
        return record.run(
            client,
            args.log,
            Settings(prefix=args.prefix),
            args.probe,
            args.seconds,
            as_json=args.json,
        )


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
    from imud.recordings.source import log_of

    if args.link is not None and args.keys is not None:
        raise ConfigError(
            "--link is a port, which needs no --keys; leave out one of them"
        )
    with contextlib.ExitStack() as stack:
        logs = [stack.enter_context(log_of(path)) for path in args.logs]
        what = replay.log_set(logs, args.probe)
        if args.connect is None and args.keys is None:
            return replay.to_ports(what, args.link, args.speed)
        with replay.connected(what, args.connect, args.keys) as client:
            return replay.to_network(what, client, args.speed)


def _export(args: argparse.Namespace) -> int:
    if args.body is not None:
        from imud.recordings import body_export

        if args.fuse:
            raise ConfigError("--body computes what it needs: leave out --fuse")
        if args.to in ("parquet", "rosbag2"):
            raise ConfigError("a body is written as csv, sto, bvh or c3d; choose one")
        facing = None if args.facing is None else math.radians(90.0 - args.facing)
        names = [str(each) for each in args.logs]
        return body_export.run(names, args.to, args.body, args.out, facing)
    if args.to in ("sto", "bvh", "c3d") or args.facing is not None:
        raise ConfigError(
            "--to sto, bvh, c3d and --facing are for bodies; give one with --body"
        )
    if args.to == "rosbag2":
        from imud.recordings import rosbag

        return rosbag.run(args.logs, args.out, is_fused=args.fuse)
    from imud.recordings import export

    return export.run(args.logs, args.to, args.out, is_fused=args.fuse)
