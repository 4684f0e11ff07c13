# SPDX-License-Identifier: MIT
"""A recorded body for programs of animation and of gait: BVH, which this file writes,
and C3D, by ezc3d.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from imud import rotation
from imud.body import angles, posture
from imud.body.chain import JOINTS, Chain, Segment
from imud.body.posture import Posture
from imud.body.session import RATE_HZ, BodyAnalysis
from imud.errors import FileError
from imud.rotation import FloatArray

# Both have y up: z up turned about x.
Y_UP = rotation.from_rotation_vector(np.array([-math.pi / 2, 0.0, 0.0]))
CM, MM = 100.0, 1000.0
TURNS = "Zrotation Xrotation Yrotation"


def whole(found: Posture) -> slice:
    """The longest stretch of rows in which no segment is missing. FileError if none."""
    good = np.all([np.isfinite(each[:, 0]) for each in found.quats.values()], axis=0)
    edges = np.flatnonzero(
        np.diff(np.concatenate([[False], good, [False]]).astype(int))
    )
    if not len(edges):
        raise FileError("a segment is always missing, which BVH can't express")
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    return slice(int(edges[2 * longest]), int(edges[2 * longest + 1]))


def bvh(limb: Chain, made: BodyAnalysis, rows: slice) -> list[str]:
    """The lines of a BVH file: centimetres, degrees, y up; the root stays in its place.

    An upright segment that faces east has no rotation.
    """
    lines = ["HIERARCHY"]
    order: list[Segment] = []
    root = limb.segments[0]
    _joint(limb, root, "", lines, order)
    columns = []
    for segment in order:
        own = made.posture.quats[segment.name][rows]
        if segment.parent is None:
            columns.append(np.zeros((len(own), 3)))
            above, below = (
                np.broadcast_to(rotation.IDENTITY, own.shape),
                rotation.multiply(Y_UP, own),
            )
        else:
            above, below = made.posture.quats[segment.parent][rows], own
        # About z, then x, then y: the body's joint angles, with their signs.
        bend, out, turn = angles.joint_angles(above, below, JOINTS["ball"], "left").T
        columns.append(np.degrees(np.stack([bend, out, -turn], axis=1)))
    table = np.concatenate(columns, axis=1).tolist()
    lines += ["MOTION", f"Frames: {len(table)}", f"Frame Time: {1.0 / RATE_HZ:.6f}"]
    lines += [" ".join(f"{value:.5f}" for value in row) for row in table]
    return lines


def _joint(
    limb: Chain, segment: Segment, indent: str, lines: list[str], order: list[Segment]
) -> None:
    """A segment and all below it, in the order of the columns."""
    order.append(segment)
    place = np.zeros(3)
    if segment.parent is not None:
        place = limb[segment.parent].marks[segment.at]
    is_root = segment.parent is None
    channels = f"3 {TURNS}"
    if is_root:
        channels = f"6 Xposition Yposition Zposition {TURNS}"
    lines += [
        f"{indent}{'ROOT' if is_root else 'JOINT'} {segment.name}",
        f"{indent}{{",
        f"{indent}  OFFSET {_offset(place)}",
        f"{indent}  CHANNELS {channels}",
    ]
    children = [child for parent, child in limb.joints() if parent is segment]
    for child in children:
        _joint(limb, child, f"{indent}  ", lines, order)
    if not children:
        lines += [f"{indent}  End Site", f"{indent}  {{"]
        lines += [f"{indent}    OFFSET {_offset(segment.marks['end'])}"]
        lines += [f"{indent}  }}"]
    lines.append(f"{indent}}}")


def _offset(place_m: FloatArray) -> str:
    return " ".join(f"{CM * each:.4f}" for each in place_m.tolist())


def c3d(path: Path, limb: Chain, made: BodyAnalysis) -> None:
    """Writes joints and marks in mm, z up, from the root's start, and joint angles in
    degrees as points of their own. What is missing is invalid. FileError.
    """
    try:
        import ezc3d
    except ModuleNotFoundError as error:
        raise FileError(
            "writing C3D needs ezc3d: pip install 'imu-probe[c3d]'"
        ) from error
    places = posture.places(limb, made.posture.quats)
    points = {name: MM * place for name, place in places.items()}
    turns = {}
    for child, found in made.posture.angles.items():
        wide = np.zeros((len(found), 3))
        wide[:, : found.shape[1]] = np.degrees(found)
        wide[np.isnan(found).any(axis=1)] = np.nan
        turns[f"{child}_angles"] = wide
    table = np.stack([*points.values(), *turns.values()], axis=1)
    rows, count, _ = table.shape
    data = np.full((4, count, rows), np.nan)
    data[:3] = table.transpose(2, 1, 0)
    residuals = np.where(np.isnan(data[0]), -1.0, 0.0)
    file: Any = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE_HZ]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = [*points, *turns]
    file.add_parameter("POINT", "ANGLES", [*turns])
    file.add_parameter("POINT", "ANGLE_UNITS", ["deg"])
    file["data"]["points"] = data
    file["data"]["meta_points"]["residuals"] = residuals[None]
    file.write(str(path))
