# SPDX-License-Identifier: MIT
"""A handle in two halves and a saddle for straps, as solids in the handle's frame.

Base and lid meet at the height `split`. Blocks at both ends are solid: screws, the
cable's clamp and the tip's rod are in them. Between them boards lie on posts, and posts
of the lid hold them down.
"""

from __future__ import annotations

from build123d import Axis, Part, Plane, chamfer

from hardware.layout import Block, Layout, Slab, dimensions
from hardware.solids import (
    arrow,
    box,
    cone,
    engraved,
    left_plane,
    letter,
    lying,
    post,
    prism,
    top_plane,
    union,
)

GROOVE_TOP = 0.55  # depth; steeper than 45 degrees, as its face prints downwards
GROOVE_SIDE = 0.4  # flatter than 45 degrees, as its face prints upright


def base(layout: Layout) -> Part:
    """The lower half: printed as it lies."""
    outside = layout.outside
    part = _half(layout, Block(*_low(outside), outside.x1, outside.y1, layout.split))
    cavity = layout.cavity
    part -= box(Block(*_low(cavity), cavity.x1, cavity.y1, layout.split))
    part = union([part, *_supports(layout)])
    part -= _seat(layout)
    for x, y in layout.screws:
        part -= post(x, y, 0, layout.split, layout.screw["clearance"] / 2)
        part -= _sink(layout, x, y, 0)
    part -= _channels(layout, up=1)
    if layout.cable_rise > 1:
        part -= _ramp(layout)
    return part - _side_axes(layout)


def lid(layout: Layout) -> Part:
    """The upper half: printed on its head."""
    o, cavity = layout.outside, layout.cavity
    part = _half(layout, Block(o.x0, o.y0, layout.split, o.x1, o.y1, o.z1))
    part -= box(Block(cavity.x0, cavity.y0, layout.split, *_high(cavity)))
    part = union([part, _tongue(layout), *_presses(layout), _button_block(layout)])
    part -= _button_hole(layout)
    wall = layout.handle["floor"] / 2  # what remains above a thread
    for x, y in layout.screws:
        top = layout.height - wall
        part -= post(x, y, layout.split, top, layout.screw["thread"] / 2)
    part -= _channels(layout, up=-1)
    if layout.window is not None:
        part -= box(layout.window)
    return part - _top_axes(layout)


def saddle(layout: Layout) -> Part:
    """A plate below the base with slots for two straps; longer screws hold it."""
    s = dimensions()["saddle"]
    side = layout.width / 2 + s["bridge"] + s["slot"] + s["bridge"]
    top, end = 0.0, layout.length
    z = -s["thickness"]
    part = box(Block(0, -side, z, end, side, top))
    for middle in (s["strap"] / 2 + 8, end - s["strap"] / 2 - 8):
        x0, x1 = middle - s["strap"] / 2, middle + s["strap"] / 2
        for y in (-side + s["bridge"], side - s["bridge"] - s["slot"]):
            part -= box(Block(x0, y, z, x1, y + s["slot"], top))
    for x, y in layout.screws:
        part -= post(x, y, z, top, layout.screw["clearance"] / 2)
        part -= _sink(layout, x, y, z)
    return part


def _low(block: Block) -> tuple[float, float, float]:
    return block.x0, block.y0, block.z0


def _high(block: Block) -> tuple[float, float, float]:
    return block.x1, block.y1, block.z1


def _half(layout: Layout, block: Block) -> Part:
    """The outside of a half, with the nose and without sharp long edges."""
    part = box(block)
    is_base = block.z0 == 0
    outer = block.z0 if is_base else block.z1
    upright = part.edges().filter_by(Axis.Z).group_by(Axis.X)[-1]
    across = part.edges().filter_by(Axis.Y).group_by(Axis.X)[-1]
    nose = [*upright, *(e for e in across if abs(e.center().Z - outer) < 1e-6)]
    part = chamfer(nose, layout.handle["nose"])
    edges = part.edges().filter_by(Axis.X)
    long = [e for e in edges if abs(e.center().Z - outer) < 1e-6]
    return chamfer(long, layout.handle["edge"])


def _sink(layout: Layout, x: float, y: float, z: float) -> Part:
    """A countersink of 90 degrees in a lower face; 0.2 deeper than the head."""
    r0, r1 = layout.screw["head"] / 2 + 0.2, layout.screw["clearance"] / 2
    return cone(x, y, z, z + r0 - r1, r0, r1)


def _seat(layout: Layout) -> Part:
    """The recess of the base's rim that takes the lid's tongue."""
    h = layout.handle
    reach = h["lip"] + h["lip_fit"]
    cut = layout.cavity.grown(reach, reach)
    z0 = layout.split - h["lip_height"] - h["lip_fit"]
    return box(Block(cut.x0, cut.y0, z0, cut.x1, cut.y1, layout.split))


def _tongue(layout: Layout) -> Part:
    h = layout.handle
    cavity = layout.cavity
    outer = cavity.grown(h["lip"], h["lip"])
    z0, z1 = layout.split - h["lip_height"], layout.split
    ring = box(Block(outer.x0, outer.y0, z0, outer.x1, outer.y1, z1))
    return ring - box(Block(cavity.x0, cavity.y0, z0, cavity.x1, cavity.y1, z1))


def _supports(layout: Layout) -> list[Part]:
    """Posts below a board, and stops around its corners."""
    parts = []
    for slab in (layout.board_slab, layout.sensor_slab):
        parts += [
            box(Block(p.x0, p.y0, layout.handle["floor"] - 0.1, p.x1, p.y1, p.z0))
            for p in slab.posts
        ]
        parts += _stops(layout, slab)
    return parts


def _stops(layout: Layout, slab: Slab) -> list[Part]:
    """A stop at each corner: beside the short edge, and beside the long one where the
    wall is farther away."""
    h, block, cavity = layout.handle, slab.block, layout.cavity
    depth, fit, z0 = h["stop_depth"], h["fit"], h["floor"] - 0.1
    top = min(block.z1, layout.split - h["lip_height"] - h["lip_fit"])
    parts = []
    for is_left in (False, True):
        wall = cavity.y1 if is_left else cavity.y0
        edge = block.y1 if is_left else block.y0
        inner = edge - depth if is_left else edge + depth
        beside = edge + fit if is_left else edge - fit
        low, high = sorted((wall, inner))
        ends = (
            (block.x0 - fit - h["stop"], block.x0 - fit),
            (block.x1 + fit, block.x1 + fit + h["stop"]),
        )
        parts += [box(Block(x0, low, z0, x1, high, top)) for x0, x1 in ends]
        if abs(wall - beside) > 0.1:
            low, high = sorted((wall, beside))
            x0, x1 = ends[0][0], ends[1][1]
            parts += [
                box(Block(x0, low, z0, x0 + h["stop"] + depth, high, top)),
                box(Block(x1 - h["stop"] - depth, low, z0, x1, high, top)),
            ]
    return parts


def _presses(layout: Layout) -> list[Part]:
    """Posts of the lid above those of the base."""
    roof, gap = layout.cavity.z1 + 0.1, layout.handle["press_gap"]
    return [
        box(Block(p.x0, p.y0, p.z1 + gap, p.x1, p.y1, roof))
        for slab in (layout.board_slab, layout.sensor_slab)
        for p in slab.posts
    ]


def _button_block(layout: Layout) -> Part:
    b = dimensions()["button"]
    x, y = layout.button
    half = b["block"] / 2
    z0 = layout.height - b["dish"] - b["plate"] - b["body_height"]
    roof = layout.cavity.z1 + 0.1
    return box(Block(x - half, y - half, z0, x + half, y + half, roof))


def _button_hole(layout: Layout) -> Part:
    """From above: a dish for the finger, the stem's hole, the pocket of the switch."""
    b = dimensions()["button"]
    (x, y), top = layout.button, layout.height
    hole = b["stem"] / 2 + 0.35
    half = b["body"] / 2 + 0.15
    seat = top - b["dish"] - b["plate"]
    pocket = Block(x - half, y - half, layout.split, x + half, y + half, seat)
    return union(
        [
            cone(x, y, top - b["dish"], top, hole, hole + b["dish"]),
            post(x, y, seat - 0.1, top, hole),
            box(pocket),
        ]
    )


def _channels(layout: Layout, up: int) -> Part:
    """Half a hole for the cable and half a hole for the rod. Their middles are a little
    beyond the split, so that the halves squeeze what is inside.
    """
    h, z = layout.handle, layout.split
    clamps = (
        (-1.0, h["rear"] + h["wall"], layout.board["cable"], h["cable_squeeze"]),
        (layout.length - h["rod_in"], layout.length + 1, h["rod"], h["rod_squeeze"]),
    )
    play = 0.2  # to the sides, in diameter
    cuts = [
        lying(x0, x1, 0, z + up * (squeeze + play) / 2, (thick + play) / 2)
        for x0, x1, thick, squeeze in clamps
    ]
    if up < 0:  # the lid's tongue is left out across the cable, not cut to slivers
        half = (layout.board["cable"] + play) / 2
        x0, x1 = h["rear"] - h["lip"] - 1, h["rear"] + 1
        cuts.append(box(Block(x0, -half, z - h["lip_height"] - 1, x1, half, z)))
    return union(cuts)


def _ramp(layout: Layout) -> Part:
    """A trench in the rear block, in which the cable rises from its plug."""
    h, z, cable = layout.handle, layout.split, layout.board["cable"]
    low, inner = z - layout.cable_rise - cable / 2 - 0.2, h["rear"] + 0.1
    corners = [(inner, z), (inner, low), (inner - 1, low)]
    corners += [(h["clamp"], z - cable / 2), (h["clamp"], z)]
    half = (cable + 0.4) / 2
    plane = Plane((0, half, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    return prism(corners, 2 * half, plane)


def _top_axes(layout: Layout) -> Part:
    """x and y begin above the chip; a ring with a point is z, which comes out."""
    x, y, _ = layout.chip
    width = layout.handle["groove"]
    corners = [(1.8, -1.8), (1.8, 1.8), (-1.8, 1.8), (-1.8, -1.8)]
    ring = [
        ((x + a, y + b), (x + c, y + d))
        for (a, b), (c, d) in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    reach = layout.width / 2 - 2.0 - y
    strokes = [
        *arrow((x + 16, y), 13.0, 0),
        *letter("X", (x + 11, y - 5.0), 3.0),
        *arrow((x, y + reach), reach - 3.0, 90),
        *letter("Y", (x + 3.0, y + reach - 3.6), 3.0),
        *ring,
        *letter("Z", (x - 6.6, y - 1.5), 3.0),
    ]
    plane = top_plane(layout.height)
    dot = cone(x, y, layout.height - GROOVE_TOP, layout.height, 0.0, width / 2)
    return union([engraved(plane, strokes, width, GROOVE_TOP), dot])


def _side_axes(layout: Layout) -> Part:
    """x and z on the left side, below the rim."""
    x, _, _ = layout.chip
    width = layout.handle["groove"]
    low, high = 2.0, layout.split - 3.0
    strokes = [
        *arrow((-(x + 16), low), 13.0, 180),
        *letter("X", (-(x + 12), low + 1.6), 2.6),
        *arrow((-x, high), high - low - 1.0, 90),
        *letter("Z", (-(x - 2.4), high - 2.6), 2.6),
    ]
    return engraved(left_plane(layout.width / 2), strokes, width, GROOVE_SIDE)
