# SPDX-License-Identifier: MIT
"""`imud calibrate tip`: from a wobble, from positions, from a rule."""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from imud import rotation
from imud.calibration.affine import MethodError
from imud.calibration.algebra import units
from imud.calibration.faults import CalibrationFault
from imud.calibration.recording import Sample
from imud.calibration.result import CalibrationResult
from imud.calibration.tip import positions
from imud.calibration.tip.guide import Dimpling
from imud.calibration.tip.result import result_of_tip
from imud.calibration.tip_found import TipFound
from imud.cli import calibrate_text
from imud.cli.arguments import client_of
from imud.cli.calibrate_refusal import CalibrationRefused, refusal, today
from imud.cli.calibrate_screen import CalibrationScreen
from imud.cli.calibrate_source import CalibratedProbe
from imud.errors import FileError
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.text_file import read_text

ERROR_MM = {"tape": 2.0}  # one sigma of an axis; of positions 1 mm
PLACE = ("x_m", "y_m", "z_m")
ATTITUDE = ("qw", "qx", "qy", "qz")

Axis = Sequence[float] | None


def followed(
    samples: Iterable[Sample | None],
    subject: CalibratedProbe,
    screen: CalibrationScreen,
    axis: Axis,
) -> CalibrationResult:
    """Evaluates samples as they arrive."""
    guide = Dimpling(subject.scale, subject.params)
    for sample in samples:
        found = guide.feed(sample) if sample is not None else None
        if screen.is_ended():
            found = guide.end()
        screen.show(guide.status())
        if found is not None:
            return _outcome(found, subject.params, axis)
    raise CalibrationRefused("the samples ended too early; start again")


def of_samples(
    samples: Sequence[Sample], subject: CalibratedProbe, axis: Axis
) -> CalibrationResult:
    """Evaluates all samples of a file: its first good wobble."""
    found: TipFound | CalibrationFault | None = None
    guide = Dimpling(subject.scale, subject.params)
    for sample in samples:
        if guide.is_over:
            guide = Dimpling(subject.scale, subject.params)
        found = guide.feed(sample) or found
        if isinstance(found, TipFound):
            break
    return _outcome(found or guide.end(), subject.params, axis)


def _outcome(
    found: TipFound | CalibrationFault, before: Params, axis: Axis
) -> CalibrationResult:
    if isinstance(found, CalibrationFault):
        raise refusal(found)
    if axis is not None:
        found = replace(found, axis=units(np.array(axis)))
    return result_of_tip(found, before, today())


def typed(args: argparse.Namespace) -> int:
    """With positions or an offset instead of samples; returns the exit code."""
    error_m = (args.error_mm or ERROR_MM.get(args.method, 1.0)) / 1000.0
    if args.method == "tape":
        offset = np.array(args.offset_mm) / 1000.0
        found = TipFound("measured", offset, error_m)
    else:
        found = _of_positions(args, error_m)
    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        reply = client.params(probe)
        before = Params.decode(bytes.fromhex(reply["bytes"]))
        outcome = _outcome(found, before, args.axis)
        calibrate_text.outcome(probe, outcome, before)
        if args.dry_run:
            return calibrate_text.not_changed(probe, outcome.params)
        client.change_params(probe, outcome.params.encode(), reply["probe_id"])
    return calibrate_text.changed(probe, outcome.params)


def _of_positions(args: argparse.Namespace, error_m: float) -> TipFound:
    places, attitudes = read(args.positions)
    count = len(places)
    is_round = args.method == "circle"
    if args.method == "points":
        if count not in (3, 4):
            raise MethodError(f"{args.positions}: the method points takes 3 or 4")
        is_round = count == 3
    if is_round:
        distance_m = args.distance_mm / 1000.0 if args.distance_mm else None
        return _on_circle(places, attitudes, error_m, distance_m)
    if attitudes is None or args.method == "points":
        return _on_sphere(places, error_m)
    offset = positions.pivot(places, attitudes, error_m)
    sigma = float(np.sqrt(np.mean(offset.sigma_m**2)))
    note = f"{1000.0 * offset.residual_m:.2f} mm residual at {count} positions"
    return TipFound("sphere", offset.offset_m, sigma, note=note)


def _on_sphere(places: FloatArray, error_m: float) -> TipFound:
    """Tells only how far the tip is: that is no offset."""
    ball = positions.sphere(places, error_m)
    distance = f"{1000.0 * ball.radius:.1f} +-{1960.0 * ball.sigma_m:.1f} mm"
    raise MethodError(
        f"the tip is {distance} from the sensor (95 %), but a sphere does not give "
        f"its direction: add columns {','.join(ATTITUDE)} with --method sphere, or "
        f"use --method circle --distance-mm {1000.0 * ball.radius:.1f}"
    )


def _on_circle(
    places: FloatArray,
    attitudes: FloatArray | None,
    error_m: float,
    distance_m: float | None,
) -> TipFound:
    if attitudes is None:
        raise MethodError(
            "a circle needs the attitude at each position: add the columns "
            f"{','.join(ATTITUDE)}"
        )
    circle = positions.circle(places, error_m)
    axis = positions.axis_of(circle, attitudes)
    found = TipFound(
        "sphere",
        axis=axis.axis,
        axis_sigma_deg=float(np.degrees(axis.sigma_rad)),
        note=f"the circle's radius is {1000.0 * circle.radius:.1f} mm",
    )
    if distance_m is None:
        return found
    offset = positions.tip_below(circle, places, attitudes, distance_m, error_m)
    return replace(
        found, offset_m=offset.offset_m, sigma_m=float(offset.sigma_m.mean())
    )


def read(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Places (n, 3) in m and, if they are there, attitudes (n, 3, 3) world_from_body,
    of a CSV file with the columns x_m,y_m,z_m and qw,qx,qy,qz. FileError if it is none.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path), newline="")))
    except csv.Error as error:
        raise FileError(f"{path} is not a CSV file: {error}") from error
    if not rows or not set(PLACE) <= rows[0].keys():
        raise FileError(f"{path}: needs a first line {','.join(PLACE)}, and positions")
    places = _columns(path, rows, PLACE)
    if not set(ATTITUDE) <= rows[0].keys():
        return places, None
    quats = _columns(path, rows, ATTITUDE)
    lengths = np.linalg.norm(quats, axis=1)
    if np.abs(lengths - 1.0).max() > 0.01:
        raise FileError(f"{path}: an attitude is a quaternion of length 1, w first")
    return places, rotation.to_matrix(quats / lengths[:, None])


def _columns(
    path: Path, rows: Sequence[dict[str, str]], names: Sequence[str]
) -> FloatArray:
    try:
        found = np.array([[float(row[name]) for name in names] for row in rows])
    except (TypeError, ValueError):
        found = np.full((1, 1), np.nan)
    if not np.isfinite(found).all():
        raise FileError(f"{path}: {','.join(names)} must be numbers in every line")
    return found
