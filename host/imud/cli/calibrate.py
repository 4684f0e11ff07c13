# SPDX-License-Identifier: MIT
"""`imud calibrate`: guided, sensor by sensor, from a log; verified, undone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command, add_network, add_probe, client_of, finite

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

PARTS = {
    "all": "all three sensors at once (the default)",
    "acc": "the accelerometer alone, from stops",
    "gyro": "the gyroscope alone, from turns between stops",
    "mag": "the magnetometer alone: wave the probe in all directions",
    "mount": "how the module is mounted in its housing: five poses, or --mount",
    "tip": "where the tip is: wobble the probe about it",
    "verify": "check the active calibration, in ten seconds",
    "learned": "activate the calibration that the daemon learned from free motion; "
    "with --from, learn it from a file",
    "undo": "restore the previous params",
}
METHODS = {
    "guided": "ours",
    "positions": "Rozanowski's six positions and ellipsoid",
    "extremes": "NECTEC's smallest and largest reading (magnetometer)",
    "extremes-as-printed": "the same with the loop from its paper, which skips an axis",
    "half-turns": "half turns on a level table, from the thesis",
}
TIP_METHODS = {
    "dimple": "wobble the tip in a dimple (the default)",
    "sphere": "--positions of the sensor while the tip stays in one place",
    "circle": "--positions while it is turned about its upright axis",
    "points": "three or four --positions, from the thesis",
    "tape": "--offset-mm, measured with a rule",
}


def add(commands: Commands) -> None:
    """Adds `imud calibrate` and its options."""
    words = "; ".join(f"{name}: {what}" for name, what in PARTS.items())
    parser = add_command(
        commands,
        "calibrate",
        "calibrate a probe, guided step by step",
        "imud calibrate stylus",
        f"WHAT is {words}. docs/calibration.md is the guide.",
    )
    parser.add_argument(
        "what", metavar="WHAT", nargs="?", default="all", help="default: all"
    )
    add_probe(parser)
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="show the result without activating it",
    )
    parser.add_argument(
        "--from",
        dest="source",
        metavar="FILE",
        type=Path,
        help="use the raw samples in a log or capture; with --dry-run no daemon is "
        "needed",
    )
    parser.add_argument(
        "--method",
        metavar="METHOD",
        choices=[*METHODS, *TIP_METHODS],
        help="; ".join(f"{name}: {what}" for name, what in METHODS.items())
        + " (default: guided). Of a tip: "
        + "; ".join(f"{name}: {what}" for name, what in TIP_METHODS.items()),
    )
    parser.add_argument(
        "--mount",
        metavar="X,Y",
        help="directions of the module's x and y arrows in the housing, such as "
        "back,left (default: found in the first poses; with --from: unchanged)",
    )
    parser.add_argument(
        "--no-housing",
        action="store_true",
        help="skip the last two poses, which measure the sensor's rotation in its "
        "housing",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="with --from: also use the samples of another probe",
    )
    _add_tip(parser)
    add_network(parser)
    parser.set_defaults(run=_run, parser=parser)


def _add_tip(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("of a tip", "docs/tip.md is the guide.")
    group.add_argument(
        "--positions",
        metavar="FILE",
        type=Path,
        help="a table of positions and attitudes of the sensor (CSV)",
    )
    for name, metavar, words in (
        ("offset-mm", ("X", "Y", "Z"), "position of the tip relative to the sensor"),
        ("axis", ("X", "Y", "Z"), "direction of the probe's axis, out of the surface"),
        ("distance-mm", None, "distance from the sensor to the tip"),
        ("error-mm", None, "one-sigma error of each number (default: 1)"),
    ):
        count = 3 if metavar else None
        group.add_argument(
            f"--{name}", metavar=metavar or "MM", type=finite, nargs=count, help=words
        )


def _run(args: argparse.Namespace) -> int:
    if args.what == "history":
        args.parser.error("for the history see: imud params history")
    if args.what not in PARTS:
        if args.probe is not None:
            args.parser.error(f"WHAT is {', '.join(PARTS)}, not {args.what}")
        args.what, args.probe = "all", args.what  # the probe alone
    what = args.what
    _check_method(args)
    if args.force and args.source is None:
        args.parser.error("--force is for --from FILE")
    if args.mount is not None and what not in ("all", "acc", "gyro", "mount"):
        args.parser.error(f"--mount is not for {what}")
    if args.source is not None and what in ("mount", "undo"):
        args.parser.error(f"{what} takes no --from")
    from imud.cli import calibrate_run, calibrate_tip

    if what == "tip" and args.method != "dimple":
        return calibrate_tip.typed(args)
    if args.source is not None:
        return calibrate_run.from_file(args)
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        if what == "learned":
            return calibrate_run.learned(client, probe, args)
        if what == "undo":
            from imud.cli import params_text

            return params_text.undo(client, probe, is_dry=args.dry_run)
        if what == "mount" and args.mount is not None:
            return calibrate_run.mount_as_told(client, probe, args)
        return calibrate_run.live(client, probe, args)


def _check_method(args: argparse.Namespace) -> None:
    """Whether the method and its options are for what is calibrated."""
    is_tip = args.what == "tip"
    if args.method is None:
        args.method = "dimple" if is_tip else "guided"
    if args.method not in (TIP_METHODS if is_tip else METHODS):
        args.parser.error(f"--method {args.method} is not for {args.what}")
    if args.method not in ("guided", *TIP_METHODS) and args.what != "all":
        args.parser.error("--method is for calibrating all sensors, or a tip")
    has_positions = args.method in ("sphere", "circle", "points")
    if (args.positions is not None) != has_positions:
        args.parser.error("--positions FILE is for the methods sphere, circle, points")
    if (args.offset_mm is not None) != (args.method == "tape"):
        args.parser.error("--offset-mm X Y Z is for --method tape")
    if args.distance_mm is not None and not has_positions:
        args.parser.error("--distance-mm is for --method circle")
    if (args.axis or args.error_mm) and not is_tip:
        args.parser.error("--axis and --error-mm are for a tip")
    if args.axis is not None and sum(each**2 for each in args.axis) == 0.0:
        args.parser.error("--axis needs a direction")
