# SPDX-License-Identifier: MIT
"""Gauges that turn a handle by known angles: wedges, a square, a plate that divides the
circle with a carrier and pins, and a stand for the pose with the front down.
"""

from __future__ import annotations

import math

from build123d import Part, Plane

from hardware.layout import Block, dimensions
from hardware.solids import box, cone, engraved, post, prism, top_plane, union

MARK_DEPTH = 0.5
# Seven segments of a digit in a field of 1 by 2, as (from, to).
_SEGMENTS = {
    "a": ((0, 2), (1, 2)),
    "b": ((1, 2), (1, 1)),
    "c": ((1, 1), (1, 0)),
    "d": ((0, 0), (1, 0)),
    "e": ((0, 1), (0, 0)),
    "f": ((0, 2), (0, 1)),
    "g": ((0, 1), (1, 1)),
}
# Of 0 to 9.
_DIGITS = (
    *("abcdef", "bc", "abged", "abgcd", "fgbc"),
    *("afgcd", "afgedc", "abc", "abcdefg", "abcdfg"),
)
Strokes = list[tuple[tuple[float, float], tuple[float, float]]]


def wedge(angle_deg: float) -> Part:
    """A slope along x that rises to the front, with a lip at its lower end. The slope
    begins at the lip's inner face, at x = 0.
    """
    w = dimensions()["wedge"]
    angle = math.radians(angle_deg)
    rise, run = w["length"] * math.sin(angle), w["length"] * math.cos(angle)
    lip, toe = w["lip"], w["toe"]
    # The lip's inner face is square to the slope; its outer one is upright, so that it
    # prints without supports.
    top = (-lip * math.sin(angle), toe + lip * math.cos(angle))
    outer = top[0] - w["lip_thickness"]
    back = run + w["crest"]
    corners = [(outer, 0.0), (back, 0.0), (back, toe + rise), (run, toe + rise)]
    corners += [(0.0, toe), top, (outer, top[1])]
    half = w["width"] / 2
    part = prism(
        corners, w["width"], Plane((0, half, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    )
    notch = w["notch"] / 2
    part -= box(Block(outer - 1, -notch, toe, 0, notch, top[1] + 1))
    text = digits(f"{angle_deg:g}", 3.0)
    side = Plane((run * 0.62, -half, 1.5), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    return part - engraved(side, text, 1.0, 0.4)


def square() -> Part:
    """A floor and an upright wall with ribs: a handle that lies on its side, its base
    against the wall, is turned by 90 degrees about its long axis.
    """
    s = dimensions()["square"]
    half, thick = s["width"] / 2, s["thickness"]
    wall = s["floor"] + thick
    end = wall + s["foot"]
    parts = [
        box(Block(0, -half, 0, end, half, thick)),
        box(Block(s["floor"], -half, 0, wall, half, s["height"])),
    ]
    for y in (-half, half - s["rib"]):
        corners = [(wall - 0.1, 0.0), (end, 0.0), (end, thick)]
        corners.append((wall - 0.1, s["height"]))
        plane = Plane((0, y + s["rib"], 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
        parts.append(prism(corners, s["rib"], plane))
    return union(parts)


def plate() -> Part:
    """A disc with a stub in its middle, on which the carrier turns, and index holes on
    a ring. Each hole has a mark, each third one its degrees, counter-clockwise.
    """
    p = dimensions()["plate"]
    thick, radius = p["thickness"], p["diameter"] / 2
    part = post(0, 0, 0, thick, radius)
    top = thick + dimensions()["carrier"]["thickness"] - 0.5
    part = union([part, _stub(p["pivot"] / 2, thick, top)])
    strokes: Strokes = []
    for angle_deg in range(0, 360, p["step_deg"]):
        angle = math.radians(angle_deg)
        x, y = math.cos(angle), math.sin(angle)
        part -= _hole(p["ring"] * x, p["ring"] * y, thick, p["index"] + p["hole_fit"])
        strokes.append(((75.2 * x, 75.2 * y), (77.8 * x, 77.8 * y)))
        if angle_deg % 45 == 0:
            text = digits(str(angle_deg), 3.0)
            width = max(x for stroke in text for x, _ in stroke)
            at = (60 * x - width / 2, 60 * y - 3)
            strokes += [
                ((a + at[0], b + at[1]), (c + at[0], d + at[1]))
                for (a, b), (c, d) in text
            ]
    return part - engraved(top_plane(thick), strokes, p["mark"], MARK_DEPTH)


def carrier() -> Part:
    """A bar that turns on the plate. A handle lies against its fence and its rear stop,
    its tip ahead of the pivot; the index hole is in front.
    """
    c, p = dimensions()["carrier"], dimensions()["plate"]
    half, thick = c["width"] / 2, c["thickness"]
    stop, behind = c["stop_x"], c["stop_x"] - c["fence"]
    y0, top = c["fence_y"], thick + c["fence_height"]
    low, high = c["notch"]
    part = union(
        [
            box(Block(behind, -half, 0, c["front"], half, thick)),
            box(Block(behind, y0, 0, c["front"], y0 + c["fence"], top)),
            box(Block(behind, -half, 0, stop, y0, top)),
        ]
    )
    part -= box(Block(behind, low, thick, stop, high, top))
    part -= _hole(0, 0, thick, p["pivot"] + p["hole_fit"])
    return part - _hole(p["ring"], 0, thick, p["index"] + p["hole_fit"])


def pin() -> Part:
    """Holds the carrier at a hole of the plate. Stands on its head."""
    p, c = dimensions()["plate"], dimensions()["carrier"]
    r, head = p["index"] / 2, p["head"]
    top = head + p["thickness"] + c["thickness"] - 0.5
    return union([post(0, 0, 0, head, r + 2.5), _stub(r, head, top)])


def _stub(r: float, z0: float, z1: float) -> Part:
    """An upright pin with a chamfered end."""
    edge = 0.8
    return union(
        [post(0, 0, z0 - 0.1, z1 - edge, r), cone(0, 0, z1 - edge, z1, r, r - edge)]
    )


def stand() -> Part:
    """A handle stands on it with its front down and the rod in the slot, or with its
    back down and the cable there.
    """
    s, rod = dimensions()["stand"], dimensions()["handle"]["rod_out"]
    half, height, slot = s["size"] / 2, rod + 6, s["slot"] / 2
    part = box(Block(-half, -half, 0, half, half, height))
    part -= post(0, 0, 0, height, slot)
    return part - box(Block(-half, -slot, 0, 0, slot, height))


def _hole(x: float, y: float, height: float, diameter: float) -> Part:
    """Through a plate, with a small chamfer on both sides: a swollen first layer does
    not hold the pin."""
    r, wide, high = diameter / 2, 0.5, 0.6
    return union(
        [
            post(x, y, 0, height, r),
            cone(x, y, 0, high, r + wide, r),
            cone(x, y, height - high, height, r, r + wide),
        ]
    )


def digits(text: str, width: float) -> Strokes:
    """A number as strokes, `width` a digit and twice as high."""
    strokes: Strokes = []
    for place, digit in enumerate(text):
        x = place * 1.6 * width
        for name in _DIGITS[int(digit)]:
            (a, b), (c, d) = _SEGMENTS[name]
            strokes.append(((x + a * width, b * width), (x + c * width, d * width)))
    return strokes


def all_gauges() -> dict[str, Part]:
    """Name and solid of each, as it is printed."""
    wedges = {f"wedge-{a:g}": wedge(a) for a in dimensions()["wedge"]["angles_deg"]}
    others = {"plate": plate(), "carrier": carrier(), "pin": pin(), "stand": stand()}
    return {**wedges, "wedge-90": square(), **others}
