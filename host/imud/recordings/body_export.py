# SPDX-License-Identifier: MIT
"""`imud export --body FILE`: joint angles, attitudes, paths as files.

.sto is OpenSim's table: version 1 of numbers, version 3 of quaternions.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from imud import rotation
from imud.body import chain, session
from imud.body.chain import Chain
from imud.body.hinge import AlignmentRefused
from imud.body.session import RATE_HZ, BodyAnalysis
from imud.columns import inert
from imud.errors import FileError
from imud.recordings import body_motion, body_tracks
from imud.rotation import FloatArray
from imud.text_file import read_text


def run(
    names: Sequence[str],
    to: str,
    body: Path,
    out: Path | None,
    facing_rad: float | None,
) -> int:
    """Writes the files of one body and prints their names; returns 0.

    Raises ConfigError for the body's file, FileError for everything else.
    """
    limb = chain.read(read_text(body), str(body))
    try:
        made = session.of(limb, body_tracks.of_files(names), facing_rad)
    except AlignmentRefused as refused:
        raise FileError(f"{limb.name}: {refused}") from refused
    for remark in made.remarks:
        sys.stderr.write(f"{limb.name}: {remark}\n")
    directory = out or Path()
    try:
        directory.mkdir(parents=True, exist_ok=True)
        files = WRITERS[to](directory, limb, made)
    except FileExistsError as error:
        raise FileError(
            f"{error.filename} already exists; choose another folder with --out"
        ) from error
    except OSError as error:
        raise FileError(f"can't export to {directory}: {error.strerror}") from error
    rows = len(made.posture.times_s)
    for file in files:
        sys.stdout.write(f"{file}: {rows} rows\n")
    return 0


def _since_start(made: BodyAnalysis) -> FloatArray:
    return np.asarray(made.posture.times_s - made.posture.times_s[0])


def _names(limb: Chain, made: BodyAnalysis) -> list[str]:
    return [
        f"{child}_{angle}"
        for child in made.posture.angles
        for angle in limb[child].joint.angles
    ]


def _angles_sto(directory: Path, limb: Chain, made: BodyAnalysis) -> Path:
    """Joint angles in degrees, named after the child's segment."""
    angles = [np.degrees(each) for each in made.posture.angles.values()]
    table = np.column_stack([_since_start(made), *angles])
    head = [
        f"{limb.name} joint angles",
        "version=1",
        f"nRows={table.shape[0]}",
        f"nColumns={table.shape[1]}",
        "inDegrees=yes",
        "endheader",
        "\t".join(["time", *_names(limb, made)]),
    ]
    lines = ["\t".join(f"{value:.6f}" for value in row) for row in table.tolist()]
    return _written(directory / f"{limb.name}-angles.sto", [*head, *lines])


def _quats_sto(directory: Path, limb: Chain, made: BodyAnalysis) -> Path:
    """Attitudes of the segments as OpenSense reads them, columns SEGMENT_imu."""
    quats = [
        rotation.continuous(
            rotation.multiply(body_motion.Y_UP, made.posture.quats[each.name])
        )
        for each in limb.segments
    ]
    head = [
        f"DataRate={RATE_HZ:.6f}",
        "DataType=Quaternion",
        "version=3",
        "OpenSimVersion=4.5",
        "endheader",
        "\t".join(["time", *(f"{each.name}_imu" for each in limb.segments)]),
    ]
    lines = []
    for index, time_s in enumerate(_since_start(made).tolist()):
        cells = [",".join(f"{part:.8f}" for part in each[index]) for each in quats]
        lines.append("\t".join([f"{time_s:.6f}", *cells]))
    return _written(directory / f"{limb.name}-orientations.sto", [*head, *lines])


def _written(file: Path, lines: Sequence[str]) -> Path:
    with file.open("x", encoding="utf-8", newline="\n") as out:
        out.write("\n".join(lines) + "\n")
    return file


def _csv(directory: Path, limb: Chain, made: BodyAnalysis) -> list[Path]:
    """Angles and their errors in degrees, world_from_segment, places of feet in m."""
    found = made.posture
    columns = [found.times_s]
    names = ["t_s"]
    for child, angles in found.angles.items():
        columns += [*np.degrees(angles).T, *np.degrees(found.sigmas[child]).T]
        names += [f"{child}_{each}_deg" for each in limb[child].joint.angles]
        names += [f"{child}_{each}_sigma_deg" for each in limb[child].joint.angles]
    for name, quat in found.quats.items():
        columns += [*rotation.continuous(quat).T]
        names += [f"{name}_q{part}" for part in "wxyz"]
    for name, path in made.paths.items():
        for what, values in (("m", path.place), ("sigma_m", path.sigmas)):
            for axis, each in zip("xyz", values.T, strict=True):
                columns.append(np.interp(found.times_s, path.times_s, each))
                names.append(f"{name}_{axis}_{what}")
    file = directory / f"{limb.name}-body.csv"
    with file.open("x", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(map(inert, names))
        for row in np.column_stack(columns).tolist():
            cells = ("" if value != value else f"{value:.6f}" for value in row)
            writer.writerow(cells)
    return [file]


def _sto(directory: Path, limb: Chain, made: BodyAnalysis) -> list[Path]:
    return [_angles_sto(directory, limb, made), _quats_sto(directory, limb, made)]


def _bvh(directory: Path, limb: Chain, made: BodyAnalysis) -> list[Path]:
    rows = body_motion.whole(made.posture)
    count = len(made.posture.times_s)
    if rows.stop - rows.start < count:
        sys.stderr.write(
            f"{limb.name}: BVH can't mark missing data: only rows {rows.start} to "
            f"{rows.stop - 1} of {count}\n"
        )
    lines = body_motion.bvh(limb, made, rows)
    return [_written(directory / f"{limb.name}.bvh", lines)]


def _c3d(directory: Path, limb: Chain, made: BodyAnalysis) -> list[Path]:
    file = directory / f"{limb.name}.c3d"
    file.open("xb").close()
    try:
        body_motion.c3d(file, limb, made)
    except FileError:
        file.unlink()
        raise
    return [file]


WRITERS: Mapping[str, Callable[[Path, Chain, BodyAnalysis], list[Path]]] = {
    "csv": _csv,
    "sto": _sto,
    "bvh": _bvh,
    "c3d": _c3d,
}
