# SPDX-License-Identifier: MIT
"""Checks of each part, and of parts and boards together. Each check returns
rows of a table: name, measured value, limit, and verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

from build123d import Face, GeomType, Part, Vector
from OCP.gp import gp_Lin
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

from hardware.layout import Block, Layout, Slab, dimensions
from hardware.solids import box, post, slanted

GRID = 7  # points along each side of a face, where its wall and slope are measured
BED_MM = 0.01
SPECK_MM2 = 0.01  # smaller faces do not matter with a nozzle of 0.4 mm
OVERHANG_SLACK_DEG = 0.01
WALL_SLACK_MM = 0.01
OPPOSITE = -0.7  # at most the cosine between the two sides of a wall
EMPTY_MM3 = 1e-3


@dataclass(frozen=True, slots=True)
class Row:
    part: str
    what: str
    measured: str
    limit: str
    is_good: bool


def of_part(name: str, printed: Part) -> Iterator[Row]:
    """Of a part alone, as it lies on the printer's bed."""
    count = len(printed.solids())
    is_whole = printed.is_valid and count == 1
    yield Row(name, "closed surface", f"{count} solid", "1 solid", is_whole)
    wall, at = thickness(printed)
    least = dimensions()["process"]["wall_min"]
    is_good = wall >= least - WALL_SLACK_MM
    words = f"{wall:.2f} mm at {at}"
    yield Row(name, "thinnest wall", words, f"{least} mm", is_good)
    steepest, at = overhang_deg(printed)
    most = dimensions()["process"]["overhang_max_deg"]
    is_good = steepest <= most + OVERHANG_SLACK_DEG
    words = f"{steepest:.1f} deg at {at}"
    yield Row(name, "overhang", words, f"{most} deg", is_good)


def points(face: Face) -> Iterator[tuple[Vector, Vector]]:
    """Points spread over a face, and the normals there."""
    shares = [(k + 0.5) / GRID for k in range(GRID)]
    for u, v in product(shares, shares):
        point = face.position_at(u, v)
        if face.is_inside(point):
            yield point, face.normal_at(u, v)


def thickness(part: Part) -> tuple[float, str]:
    """The least way through the part, straight in from points of its surface to a face
    that looks the other way, and where that is.
    """
    surface = IntCurvesFace_ShapeIntersector()
    surface.Load(part.wrapped, 1e-6)
    least, place = math.inf, ""
    for face in part.faces():
        for point, normal in points(face):
            ray = gp_Lin(point.to_pnt(), (-normal).to_dir())
            surface.PerformNearest(ray, 1e-3, 1e3)
            if surface.NbPnt() == 0 or surface.WParameter(1) >= least:
                continue
            behind = Face(surface.Face(1)).normal_at(Vector(surface.Pnt(1)))
            if behind.dot(normal) < OPPOSITE:
                least, place = surface.WParameter(1), _place(point)
    return least, place


def overhang_deg(part: Part) -> tuple[float, str]:
    """The largest angle from upright of a face that looks down and is not on the bed,
    and where that is; 90 is a ceiling.
    """
    low = part.bounding_box().min.Z
    worst, place = 0.0, ""
    for face in part.faces():
        height = face.bounding_box().max.Z - low
        if height < BED_MM or face.area < SPECK_MM2:
            continue
        for point, normal in points(face):
            angle = math.degrees(math.asin(max(-1.0, min(1.0, -normal.Z))))
            if angle > worst:
                worst, place = angle, _place(point)
    return worst, place


def flat_faces(part: Part, direction: Vector, at: float) -> list[Face]:
    """The flat faces that look there, at this distance from the origin."""
    return [
        face
        for face in part.faces().filter_by(GeomType.PLANE)
        if face.normal_at().dot(direction) > 0.99
        and abs(face.center().dot(direction) - at) < 1e-3
    ]


def _place(point: Vector) -> str:
    return " ".join(f"{value:.1f}" for value in point)


def common(one: Part, other: Part) -> float:
    """The volume that two solids share, mm3."""
    found = one.intersect(other)
    if found is None:
        return 0.0
    if isinstance(found, list):
        return float(sum(each.volume for each in found))
    return float(found.volume)


def of_handle(layout: Layout, base: Part, lid: Part, saddle: Part) -> Iterator[Row]:
    """The checks of a handle's parts with their contents."""
    name = layout.name
    yield _free(name, "base and lid share", common(base, lid))
    yield _free(name, "base and saddle share", common(base, saddle))
    for title, slab in (("board", layout.board_slab), ("sensor", layout.sensor_slab)):
        yield from _of_slab(name, title, slab, layout, base, lid)
    shared = common(box(layout.plug), base) + common(box(layout.plug), lid)
    yield _free(name, "plug and housing share", shared)
    yield from _between(layout)
    yield from _datums(layout, base, lid)
    yield from _screws(layout, base, lid, saddle)
    yield from _way(layout, base, lid)
    yield from _clamps(layout, base, lid)


def _free(name: str, what: str, volume: float) -> Row:
    return Row(name, what, f"{volume:.3f} mm3", "0", volume < EMPTY_MM3)


def _of_slab(
    name: str, title: str, slab: Slab, layout: Layout, base: Part, lid: Part
) -> Iterator[Row]:
    """A board rests on its posts, moves nowhere, and has its play and its room."""
    block, fit = slab.block, layout.handle["fit"] - 0.01
    loose = box(block.grown(fit, fit, -0.01))
    shared = common(loose, base) + common(loose, lid)
    yield _free(name, f"{title} with {fit:.2f} mm around it shares", shared)
    moved = layout.handle["fit"] + 0.3
    for what, dx, dy in (("ahead", moved, 0), ("aside", 0, moved)):
        both = [common(box(_shifted(block, s * dx, s * dy)), base) for s in (-1, 1)]
        is_held = min(both) > 0.01
        yield Row(name, f"{title} held {what}", f"{min(both):.2f} mm3", "> 0", is_held)
    sunk = common(box(_shifted(block, 0, 0, -0.1)), base) / 0.1
    area = sum((p.x1 - p.x0) * (p.y1 - p.y0) for p in slab.posts)
    is_on = abs(sunk - area) < 0.02 * area
    yield Row(name, f"{title} lies on", f"{sunk:.1f} mm2", f"{area:.1f} mm2", is_on)
    gap = layout.handle["press_gap"]
    raised = common(box(_shifted(block, 0, 0, gap + 0.1)), lid) / 0.1
    is_on = abs(raised - area) < 0.02 * area
    yield Row(name, f"{title} under", f"{raised:.1f} mm2", f"{area:.1f} mm2", is_on)
    yield from _rooms(name, title, slab, base, lid)


def _rooms(name: str, title: str, slab: Slab, base: Part, lid: Part) -> Iterator[Row]:
    """Below and above a board nothing but posts is in the way of parts and wires."""
    b = slab.block
    below = box(Block(b.x0, b.y0, b.z0 - slab.standoff + 0.01, b.x1, b.y1, b.z0 - 0.01))
    above = box(Block(b.x0, b.y0, b.z1 + 0.01, b.x1, b.y1, b.z1 + slab.above))
    for p in slab.posts:
        grown = Block(p.x0 - 0.01, p.y0 - 0.01, 0, p.x1 + 0.01, p.y1 + 0.01, 99)
        below -= box(grown)
        above -= box(grown)
    shared = common(below, base) + common(above, lid) + common(above, base)
    yield _free(name, f"room around the {title} is shared by", shared)


def _shifted(b: Block, x: float, y: float, z: float = 0.0) -> Block:
    return Block(b.x0 + x, b.y0 + y, b.z0 + z, b.x1 + x, b.y1 + y, b.z1 + z)


def _between(layout: Layout) -> Iterator[Row]:
    """Boards, plug and the button's block do not meet each other."""
    b = dimensions()["button"]
    (x, y), half = layout.button, b["block"] / 2
    z0 = layout.height - b["dish"] - b["plate"] - b["body_height"]
    things = {
        "board": _with_room(layout.board_slab),
        "sensor": _with_room(layout.sensor_slab),
        "button": Block(x - half, y - half, z0, x + half, y + half, layout.height),
    }
    for (one, first), (other, second) in combinations(things.items(), 2):
        shared = common(box(first), box(second))
        yield _free(layout.name, f"{one} and {other} share", shared)


def _with_room(slab: Slab) -> Block:
    b = slab.block
    return Block(b.x0, b.y0, b.z0 - slab.standoff, b.x1, b.y1, b.z1 + slab.above)


def _datums(layout: Layout, base: Part, lid: Part) -> Iterator[Row]:
    """The faces that a handle is laid on: flat, square, and nothing stands out."""
    o = layout.outside
    wanted = {
        "bottom": (Vector(0, 0, -1), [base], -o.z0),
        "top": (Vector(0, 0, 1), [lid], o.z1),
        "left": (Vector(0, 1, 0), [base, lid], o.y1),
        "right": (Vector(0, -1, 0), [base, lid], -o.y0),
        "back": (Vector(-1, 0, 0), [base, lid], -o.x0),
        "front": (Vector(1, 0, 0), [base, lid], o.x1),
    }
    for side, (direction, parts, reach) in wanted.items():
        faces = [face for part in parts for face in flat_faces(part, direction, reach)]
        ends = [end for part in parts for end in _ends(part)]
        out = abs(max(end.dot(direction) for end in ends) - reach)
        worst = max((f.normal_at().get_angle(direction) for f in faces), default=90.0)
        area = sum(face.area for face in faces)
        words = f"{worst:.3f} deg, {out:.4f} mm, {area:.0f} mm2"
        is_good = worst < 0.01 and out < 1e-3 and area > 100
        yield Row(layout.name, f"{side} face", words, "0.01, 0.001, > 100", is_good)


def _ends(part: Part) -> tuple[Vector, Vector]:
    box = part.bounding_box()
    return box.min, box.max


def _screws(layout: Layout, base: Part, lid: Part, saddle: Part) -> Iterator[Row]:
    """Both reach: through the base without touching it, and far enough into the lid."""
    least, rest = layout.screw["reach_min"], dimensions()["process"]["wall_min"]
    s = dimensions()["saddle"]
    cases = (
        ("", layout.board["screw"], 0.0),
        (" with saddle", layout.board["screw"] + s["screw_more"], s["thickness"]),
    )
    for case, length, below in cases:
        for place, (x, y) in zip(("rear", "front"), layout.screws, strict=True):
            shank = post(x, y, -below, length - below, 1.5)
            held = common(shank, lid)
            ring = math.pi * (1.5**2 - (layout.screw["thread"] / 2) ** 2)
            reach = held / ring
            free = common(shank, base) + (common(shank, saddle) if below else 0.0)
            left = layout.height - (length - below)
            words = f"{reach:.2f} mm in the lid, {left:.1f} mm left, {free:.3f} mm3"
            is_good = reach >= least - 0.02 and left >= rest and free < EMPTY_MM3
            what = f"{place} screw of {length:g}{case}"
            yield Row(layout.name, what, words, f"{least}, {rest}, 0", is_good)


def _way(layout: Layout, base: Part, lid: Part) -> Iterator[Row]:
    """The cable, squeezed, runs straight from its plug to the clamp."""
    h = layout.handle
    radius = (layout.board["cable"] - h["cable_squeeze"]) / 2 - 0.05
    end = (layout.plug.x0, 0.0, layout.split - layout.cable_rise)
    # From a little inside, where it is no longer flattened.
    x = h["clamp"] + 1.0
    share = 1.0 / (layout.plug.x0 - h["clamp"])
    cable = slanted((x, 0.0, layout.split - share * layout.cable_rise), end, radius)
    shared = common(cable, base) + common(cable, lid)
    yield _free(layout.name, "cable and housing share", shared)


def _clamps(layout: Layout, base: Part, lid: Part) -> Iterator[Row]:
    """The halves squeeze cable and rod; beside them there is play."""
    h = layout.handle
    for what, x, thick, squeeze in (
        ("cable", h["clamp"] / 2, layout.board["cable"], h["cable_squeeze"]),
        ("rod", layout.length - 6, h["rod"], h["rod_squeeze"]),
    ):
        # A needle through both halves: what of it is in neither is the opening.
        needle = box(Block(x, -0.05, 0, x + 0.1, 0.05, layout.height))
        solid = (common(needle, base) + common(needle, lid)) / 0.01
        found = thick - (layout.height - solid)
        is_good = abs(found - squeeze) < 0.05
        words = f"{found:.2f} mm"
        yield Row(
            layout.name, f"{what} is squeezed by", words, f"{squeeze} mm", is_good
        )
