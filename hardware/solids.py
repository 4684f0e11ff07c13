# SPDX-License-Identifier: MIT
"""Shapes that several parts are cut from."""

from __future__ import annotations

import math
from collections.abc import Iterable

from build123d import (
    Align,
    Box,
    Cone,
    Cylinder,
    Part,
    Plane,
    Polyline,
    Pos,
    Rot,
    Vector,
    extrude,
    make_face,
)

from hardware.layout import Block, Point

_LOW = (Align.MIN, Align.MIN, Align.MIN)
_STANDING = (Align.CENTER, Align.CENTER, Align.MIN)

Stroke = tuple[tuple[float, float], tuple[float, float]]

# A letter's strokes in a square of 1, as written.
LETTERS: dict[str, list[Stroke]] = {
    "X": [((0, 0), (1, 1)), ((0, 1), (1, 0))],
    "Y": [((0, 1), (0.5, 0.5)), ((1, 1), (0.5, 0.5)), ((0.5, 0.5), (0.5, 0))],
    "Z": [((0, 1), (1, 1)), ((1, 1), (0, 0)), ((0, 0), (1, 0))],
}


def box(block: Block) -> Part:
    size = (block.x1 - block.x0, block.y1 - block.y0, block.z1 - block.z0)
    return Pos(block.x0, block.y0, block.z0) * Box(*size, align=_LOW)


def post(x: float, y: float, z0: float, z1: float, radius: float) -> Part:
    """An upright cylinder."""
    return Pos(x, y, z0) * Cylinder(radius, z1 - z0, align=_STANDING)


def cone(x: float, y: float, z0: float, z1: float, r0: float, r1: float) -> Part:
    """An upright cone, of the radii at its lower and its upper end."""
    return Pos(x, y, z0) * Cone(r0, r1, z1 - z0, align=_STANDING)


def lying(x0: float, x1: float, y: float, z: float, radius: float) -> Part:
    """A cylinder along x."""
    rod = Cylinder(radius, x1 - x0, align=_STANDING)
    return Pos(x0, y, z) * Rot(0, 90, 0) * rod


def slanted(start: Point, end: Point, radius: float) -> Part:
    """A cylinder between two points."""
    along = Vector(*end) - Vector(*start)
    rod = Cylinder(radius, along.length, align=_STANDING)
    return Plane(start, z_dir=along) * rod


def union(parts: Iterable[Part]) -> Part:
    first, *others = parts
    return first.fuse(*others) if others else first


def arrow(tip: tuple[float, float], length: float, turn_deg: float) -> list[Stroke]:
    """Three strokes that end at `tip`, pointing along `turn_deg`."""
    along = (math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg)))
    tail = (tip[0] - length * along[0], tip[1] - length * along[1])
    strokes = [(tail, tip)]
    for side in (150, -150):
        angle = math.radians(turn_deg + side)
        barb = (tip[0] + 2.2 * math.cos(angle), tip[1] + 2.2 * math.sin(angle))
        strokes.append((barb, tip))
    return strokes


def letter(name: str, at: tuple[float, float], size: float) -> list[Stroke]:
    x, y = at
    return [
        ((x + a * size, y + b * size), (x + c * size, y + d * size))
        for (a, b), (c, d) in LETTERS[name]
    ]


def engraved(plane: Plane, strokes: list[Stroke], width: float, depth: float) -> Part:
    """A cut into a face: grooves with sloping walls, which print without
    supports whichever way the face lies. The plane's z points out of the face.
    """
    return union(_groove(plane, stroke, width, depth) for stroke in strokes)


def _groove(plane: Plane, stroke: Stroke, width: float, depth: float) -> Part:
    (x0, y0), (x1, y1) = stroke
    length = math.hypot(x1 - x0, y1 - y0)
    turn = math.degrees(math.atan2(y1 - y0, x1 - x0))
    tool = Cone(width / 2, 0.0, depth, align=_STANDING)
    ends = [Pos(at, 0, 0) * Rot(180, 0, 0) * tool for at in (0.0, length)]
    ridge = _wedge(length, width, depth)
    return plane * Pos(x0, y0, 0) * Rot(0, 0, turn) * union([ridge, *ends])


def _wedge(length: float, width: float, depth: float) -> Part:
    """A prism along x below z = 0, with its edge down."""
    return prism([(-width / 2, 0), (width / 2, 0), (0, -depth)], length, Plane.YZ)


def prism(corners: list[tuple[float, float]], length: float, plane: Plane) -> Part:
    """A polygon of a plane, drawn out along its z."""
    face = make_face(plane * Polyline(*corners, close=True))
    return extrude(face, length, dir=plane.z_dir)


def top_plane(z: float) -> Plane:
    return Plane((0, 0, z))


def left_plane(y: float) -> Plane:
    """x to the left as one looks at a handle's left side from outside, and z up."""
    return Plane((0, y, 0), x_dir=(-1, 0, 0), z_dir=(0, 1, 0))
