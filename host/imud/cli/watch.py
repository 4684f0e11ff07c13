# SPDX-License-Identifier: MIT
"""Probes as the network sees them: `listen`, `strokes`, `list`, `monitor`, `view`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import (
    add_command,
    add_json,
    add_network,
    add_probe,
    add_seconds,
    client_of,
)
from imud.defaults import PAGE

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

# imud.rotation has the conversions, and loads numpy.
ANGLES = ("aerospace", "nautical", "nectec", "matrix")


def add(commands: Commands) -> None:
    _add_list(commands)
    _add_monitor(commands)
    _add_view(commands)
    _add_listen(commands)
    _add_strokes(commands)


def _add_listen(commands: Commands) -> None:
    listen = add_command(
        commands,
        "listen",
        "print poses as they arrive over the network",
        "imud listen --seconds 10 --angles aerospace",
        "Columns: yaw, pitch and roll, 1-sigma errors of tilt and heading (all in "
        "degrees), poses per second, flags. docs/pose-details.md defines the angles.",
    )
    add_probe(listen)
    listen.add_argument(
        "--angles",
        choices=ANGLES,
        help="aerospace: yaw from north to east, pitch with x up, roll with the right "
        "side down; nautical (default): yaw from east to north, pitch with x down, "
        "roll with the left side up; nectec: as nautical, yaw and roll exchanged; "
        "matrix: the probe's axes x, y, z (columns) along east, north, up (rows)",
    )
    add_json(
        listen,
        "print each pose as one JSON line, as published; --angles adds its angles",
    )
    add_seconds(listen)
    add_network(listen)
    listen.set_defaults(run=_listen)


def _add_strokes(commands: Commands) -> None:
    strokes = add_command(
        commands,
        "strokes",
        "print the displacement of each stroke as it ends",
        "imud strokes stylus --close",
        "Columns: number and time of the stroke, its length, its parts in the world "
        "and their 1-sigma errors, why it ended. docs/strokes.md explains how to "
        "measure.",
    )
    add_probe(strokes)
    strokes.add_argument(
        "--close",
        action="store_true",
        help="at the end (Ctrl-C, or --seconds) treat the reached position as the "
        "origin: print the closure error of the path, and the path with that error "
        "spread evenly over its strokes; a double click of its button does so at once",
    )
    add_json(strokes, "print one JSON object a line, as published")
    add_seconds(strokes)
    add_network(strokes)
    strokes.set_defaults(run=_strokes)


def _add_list(commands: Commands) -> None:
    listing = add_command(
        commands,
        "list",
        "list the probes with their state, rate, losses and accuracy",
        "imud list --ledger",
    )
    add_json(listing, "print one status object a line, as published")
    listing.add_argument(
        "--ledger",
        action="store_true",
        help="also print the message counts from the sensor to each sink",
    )
    add_network(listing)
    listing.set_defaults(run=_list)


def _add_monitor(commands: Commands) -> None:
    monitor = add_command(
        commands,
        "monitor",
        "show all probes live on one screen",
        "imud monitor --keys viewer.toml",
        "q or Ctrl-C ends it. Into a pipe it writes one line per probe and second.",
    )
    add_seconds(monitor)
    add_network(monitor)
    monitor.set_defaults(run=_monitor)


def _add_view(commands: Commands) -> None:
    view = add_command(
        commands,
        "view",
        "open the page in a browser; for a remote daemon, serve it here",
        "imud view --connect tcp/192.168.1.10:7447",
        "Without --connect it opens the page of the daemon on this machine. A page "
        "served here ends with Ctrl-C. The page of --to needs neither imud nor a "
        "network: Chrome, Chromium or Edge reads a probe from USB with it.",
    )
    view.add_argument(
        "--page",
        metavar="HOST:PORT",
        help=f"serve the page here (default: {PAGE}, or any port if it is taken)",
    )
    view.add_argument(
        "--no-open",
        action="store_true",
        help="print the address without opening a browser",
    )
    view.add_argument(
        "--to",
        metavar="DIR",
        type=Path,
        help="write the page into a folder, for computers without imud, and end",
    )
    add_network(view)
    view.set_defaults(run=_view)


def _listen(args: argparse.Namespace) -> int:
    from imud.cli import pose_table

    with client_of(args) as client:
        client.check_known(args.probe)
        return pose_table.listen(
            client, args.probe, args.seconds, as_json=args.json, shape=args.angles
        )


def _strokes(args: argparse.Namespace) -> int:
    from imud.cli import stroke_lines

    with client_of(args) as client:
        client.check_known(args.probe)
        return stroke_lines.listen(
            client, args.probe, args.seconds, as_json=args.json, closes=args.close
        )


def _list(args: argparse.Namespace) -> int:
    from imud.cli import probe_table

    with client_of(args) as client:
        return probe_table.show(client, as_json=args.json, has_ledger=args.ledger)


def _monitor(args: argparse.Namespace) -> int:
    from imud.cli import monitor

    return monitor.run(args.connect, args.prefix, keys=args.keys, seconds=args.seconds)


def _view(args: argparse.Namespace) -> int:
    if args.to is not None:
        from imud.web import packed

        for path in packed.write(args.to):
            sys.stdout.write(f"{path}\n")
        return 0

    from imud.cli import page

    return page.run(
        args.connect, args.prefix, args.keys, args.page, is_opened=not args.no_open
    )
