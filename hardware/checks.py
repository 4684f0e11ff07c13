# SPDX-License-Identifier: MIT
"""Checks of each part, and of parts and boards together. Each check returns
rows of a table: name, measured value, limit, and verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from build123d import Part

from hardware import mesh as meshes
from hardware.layout import Block, Layout, Slab, dimensions
from hardware.mesh import Mesh
from hardware.solids import box, post, slanted

RAYS = 3000  # a part: where its walls are measured
SEED = 1
BED_MM = 0.01
SPECK_MM2 = 0.01  # smaller faces do not matter with a nozzle of 0.4 mm
# Facets of a cone of 45 degrees are up to a degree off it.
OVERHANG_SLACK_DEG = 1.0
WALL_SLACK_MM = 0.01
EMPTY_MM3 = 1e-3


@dataclass(frozen=True, slots=True)
class Row:
    part: str
    what: str
    measured: str
    limit: str
    is_good: bool


def of_part(name: str, part: Part, printed: Mesh) -> Iterator[Row]:
    """Of a part alone. `printed`: as it lies on the printer's bed."""
    count, gaps = len(part.solids()), meshes.open_edges(printed)
    is_closed = part.is_valid and count == 1 and gaps == 0 and printed.volume > 0
    words = f"{count} solid, {gaps} open edges"
    yield Row(name, "closed surface", words, "1 solid, 0", is_closed)
    off = abs(printed.volume / part.volume - 1)
    yield Row(name, "triangles against solid", f"{off:.4%}", "0.3%", off < 3e-3)
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


def thickness(mesh: Mesh) -> tuple[float, str]:
    """The least way through the part, straight in from RAYS points of its surface, and
    where that is.
    """
    points, normals = meshes.samples(mesh, RAYS, SEED)
    found = meshes.depths(mesh, points - 1e-4 * normals, -normals)
    least = int(found.argmin())
    return float(found[least]), _place(points[least])


def overhang_deg(mesh: Mesh) -> tuple[float, str]:
    """The largest angle from upright of a face that looks down and is not on the bed,
    and where that is; 90 is a ceiling.
    """
    low = mesh.points[:, 2].min()
    is_on_bed = (mesh.corners[:, :, 2] < low + BED_MM).all(axis=1)
    down = np.where(is_on_bed | (mesh.areas < SPECK_MM2), 0.0, -mesh.normals[:, 2])
    worst = int(down.argmax())
    angle = math.degrees(math.asin(min(max(float(down[worst]), 0.0), 1.0)))
    return angle, _place(mesh.corners[worst].mean(axis=0))


def _place(point: meshes.Floats) -> str:
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
        "bottom": ((0, 0, -1), [base], -o.z0),
        "top": ((0, 0, 1), [lid], o.z1),
        "left": ((0, 1, 0), [base, lid], o.y1),
        "right": ((0, -1, 0), [base, lid], -o.y0),
        "back": ((-1, 0, 0), [base, lid], -o.x0),
        "front": ((1, 0, 0), [base, lid], o.x1),
    }
    for side, (direction, parts, reach) in wanted.items():
        worst, farthest, area = 0.0, 0.0, 0.0
        for part in parts:
            mesh = meshes.of(part)
            along = mesh.points @ np.array(direction, dtype=float)
            farthest = max(farthest, abs(float(along.max()) - reach))
            on_it = (mesh.corners @ np.array(direction, dtype=float)) > reach - 1e-3
            faces = on_it.all(axis=1) & (mesh.areas > 1e-6)
            cosine = np.clip(mesh.normals[faces] @ direction, -1, 1)
            area += float(mesh.areas[faces].sum())
            worst = max(worst, math.degrees(math.acos(float(cosine.min()))))
        words = f"{worst:.3f} deg, {farthest:.4f} mm, {area:.0f} mm2"
        is_good = worst < 0.01 and farthest < 1e-3 and area > 100
        yield Row(layout.name, f"{side} face", words, "0.01, 0.001, > 100", is_good)


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
