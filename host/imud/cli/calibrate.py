# SPDX-License-Identifier: MIT
"""`imud calibrate`: guided, sensor by sensor, from a log; verified, undone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_network, add_probe, client_of

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

PARTS = {
    "all": "all three sensors at once (the default)",
    "acc": "the accelerometer alone, from stops",
    "gyro": "the gyroscope alone, from turns between stops",
    "mag": "the magnetometer alone: wave the probe about",
    "verify": "check the calibration that is in force, in ten seconds",
    "learned": "put in force what the daemon has learned from free motion",
    "undo": "bring back the params of before",
    "history": "list the params that came into force",
}
METHODS = {
    "guided": "ours",
    "positions": "Rozanowski's six positions and ellipsoid",
    "extremes": "NECTEC's smallest and largest reading (magnetometer)",
    "extremes-as-printed": "the same with the loop of its paper, which skips an axis",
    "half-turns": "the thesis' half turns on a level table",
}


def add(commands: Commands) -> None:
    words = "; ".join(f"{name}: {what}" for name, what in PARTS.items())
    parser = add_command(
        commands,
        "calibrate",
        "calibrate a probe: it says how to lay it, and when it is good",
        "imud calibrate stylus",
        f"WHAT is {words}. docs/calibration.md is the guide.",
    )
    parser.add_argument(
        "what", metavar="WHAT", nargs="?", default="all", help="all, if it is left out"
    )
    add_probe(parser)
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="show what would be put in force, and change nothing",
    )
    parser.add_argument(
        "--from",
        dest="source",
        metavar="FILE",
        type=Path,
        help="use the raw samples of a log or a capture; with --dry-run no daemon is "
        "needed",
    )
    parser.add_argument(
        "--method",
        metavar="METHOD",
        choices=METHODS,
        default="guided",
        help="; ".join(f"{name}: {what}" for name, what in METHODS.items())
        + " (default: %(default)s)",
    )
    parser.add_argument(
        "--no-housing",
        action="store_true",
        help="leave out the last two poses, which find how the sensor is turned in its "
        "housing",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="with --from: also use the samples of another probe",
    )
    add_network(parser)
    parser.set_defaults(run=_run, parser=parser)


def _run(args: argparse.Namespace) -> int:
    if args.what not in PARTS:
        if args.probe is not None:
            args.parser.error(f"WHAT is {', '.join(PARTS)}, not {args.what}")
        args.what, args.probe = "all", args.what  # the probe alone
    what = args.what
    if args.method != "guided" and what != "all":
        args.parser.error("--method is for calibrating all sensors")
    if args.force and args.source is None:
        args.parser.error("--force is for --from FILE")
    if args.source is not None and what in ("learned", "undo", "history"):
        args.parser.error(f"{what} takes no --from")
    from imud.cli import calibrate_run

    if args.source is not None:
        return calibrate_run.from_file(args)
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        if what == "history":
            from imud.cli import params_text

            return params_text.history(client, probe)
        if what == "learned":
            return calibrate_run.learned(client, probe, args)
        if what == "undo":
            from imud.cli import params_text

            return params_text.undo(client, probe, is_dry=args.dry_run)
        return calibrate_run.live(client, probe, args)
