# SPDX-License-Identifier: MIT
"""`imud body`: joint angles of several probes, live."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_json, add_seconds, finite, whole
from imud.defaults import ENDPOINT, PREFIX

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

# As imud.body.live has it, which loads numpy.
DELAY_MS, RATE_HZ = 150, 25


def add(commands: Commands) -> None:
    """Adds `imud body` and its options."""
    body = add_command(
        commands,
        "body",
        "show and publish the joint angles of several probes on a limb",
        "imud body leg.toml --log logs, with imud run in another terminal",
        "It guides you through aligning the probes, then prints the joint angles and "
        "their errors (degrees) once a second, and publishes them on "
        "imud/body/NAME/state. docs/limb.md describes FILE.",
    )
    body.add_argument(
        "file", metavar="FILE", type=Path, help="the segments and their probes (TOML)"
    )
    body.add_argument(
        "--connect",
        metavar="ENDPOINT",
        action="append",
        help="address of a daemon (imud run); repeat it for each further daemon. "
        f"The state is published to the first (default: {ENDPOINT})",
    )
    body.add_argument(
        "--prefix",
        metavar="KEY",
        default=PREFIX,
        help="first part of the daemons' Zenoh keys (default: %(default)s)",
    )
    body.add_argument(
        "--keys",
        metavar="FILE",
        type=Path,
        help="credentials of the role daemon, if the daemons require them: the file "
        "clients/NAME.toml from imud keys",
    )
    _add_manner(body)
    _add_outputs(body)
    body.set_defaults(run=_run)


def _add_manner(body: argparse.ArgumentParser) -> None:
    body.add_argument(
        "--facing",
        metavar="DEG",
        type=finite,
        help="the compass direction that the person faces when standing, clockwise "
        "from north, for probes without a hinge",
    )
    body.add_argument(
        "--delay",
        metavar="MS",
        type=whole(10, 2000),
        default=DELAY_MS,
        help="milliseconds to wait for the poses of all probes (default: %(default)s)",
    )
    body.add_argument(
        "--rate",
        metavar="HZ",
        type=whole(1, 100),
        default=RATE_HZ,
        help="states per second (default: %(default)s)",
    )
    add_seconds(body)


def _add_outputs(body: argparse.ArgumentParser) -> None:
    body.add_argument(
        "--ros2",
        metavar="DOMAIN",
        type=whole(0, 232),
        nargs="?",
        const=0,
        help="publish JointState and /tf for ROS 2 nodes of this ROS_DOMAIN_ID "
        "(default: %(const)s)",
    )
    body.add_argument("--log", metavar="DIR", type=Path, help="log the states (MCAP)")
    add_json(body, "print each state as one JSON line, as published")


def _run(args: argparse.Namespace) -> int:
    from imud.cli import body_run

    facing = None if args.facing is None else math.radians(90.0 - args.facing)
    where = body_run.Where(tuple(args.connect or (ENDPOINT,)), args.prefix, args.keys)
    how = body_run.How(facing, args.delay / 1e3, float(args.rate), args.ros2, args.log)
    return body_run.run(args.file, where, how, args.seconds, as_json=args.json)
