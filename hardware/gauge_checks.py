# SPDX-License-Identifier: MIT
"""Checks of gauges: their angles, and whether pins fit their holes."""

from __future__ import annotations

import math
from collections.abc import Iterator

from build123d import GeomType, Part, Pos, Rot, Vector

from hardware.checks import EMPTY_MM3, Row, common, flat_faces
from hardware.layout import dimensions
from hardware.solids import post

ANGLE_DEG = 0.01
FACE_MM2 = 200.0  # smaller faces carry no handle


def of_gauges(parts: dict[str, Part]) -> Iterator[Row]:
    for angle in dimensions()["wedge"]["angles_deg"]:
        name = f"wedge-{angle:g}"
        yield _angle(name, parts[name], angle)
    yield _angle("wedge-90", parts["wedge-90"], 90.0)
    yield from _plate(parts["plate"])
    yield from _carrier(parts["carrier"])
    yield from _together(parts)


def _angle(name: str, part: Part, wanted_deg: float) -> Row:
    """Of the face that a handle is laid on, against the lower one. It looks backwards:
    against x.
    """
    up, area, off = Vector(0, 0, 1), 0.0, 0.0
    for face in part.faces().filter_by(GeomType.PLANE):
        error = abs(face.normal_at().get_angle(up) - wanted_deg)
        if error < 1 and face.normal_at().X < -1e-6:
            area, off = area + face.area, max(off, error)
    words = f"{wanted_deg:g} deg, off by {off:.4f}; {area:.0f} mm2"
    is_good = area > FACE_MM2 and off < ANGLE_DEG
    return Row(name, "angle", words, f"{ANGLE_DEG} deg, {FACE_MM2:g} mm2", is_good)


def _fits(part: Part, x: float, y: float, z: float, diameter: float) -> bool:
    """A pin of this diameter goes through, and one that is thicker than the hole by a
    tenth does not.
    """
    fit = dimensions()["plate"]["hole_fit"]
    thin = post(x, y, z - 1, z + 1, diameter / 2)
    thick = post(x, y, z - 1, z + 1, (diameter + fit + 0.1) / 2)
    return common(thin, part) < EMPTY_MM3 < common(thick, part)


def _plate(part: Part) -> Iterator[Row]:
    """A hole at each step, and none halfway to the next."""
    p = dimensions()["plate"]
    z = p["thickness"] / 2
    steps = range(0, 360, p["step_deg"])
    right = 0
    for step in steps:
        for more, is_hole in ((0.0, True), (p["step_deg"] / 2, False)):
            angle = math.radians(step + more)
            x, y = p["ring"] * math.cos(angle), p["ring"] * math.sin(angle)
            right += _fits(part, x, y, z, p["index"]) == is_hole
    wanted = 2 * len(steps)
    yield Row("plate", "holes", f"{right} of {wanted}", "all", right == wanted)


def _carrier(part: Part) -> Iterator[Row]:
    """Its holes are those of the plate; fence and stop are square."""
    c, p = dimensions()["carrier"], dimensions()["plate"]
    z = c["thickness"] / 2
    is_good = _fits(part, 0, 0, z, p["pivot"]) and _fits(
        part, p["ring"], 0, z, p["index"]
    )
    yield Row("carrier", "holes", f"at 0 and {p['ring']:g}", "as in the plate", is_good)
    for what, at, direction in (
        ("fence", c["fence_y"], Vector(0, -1, 0)),
        ("rear stop", c["stop_x"], Vector(1, 0, 0)),
    ):
        reach = at * (direction.X + direction.Y)
        area = sum(face.area for face in flat_faces(part, direction, reach))
        words = f"at {at:g}, {area:.0f} mm2"
        yield Row("carrier", what, words, "> 100 mm2", area > 100)


def _together(parts: dict[str, Part]) -> Iterator[Row]:
    """The carrier on the plate, with the pin in both at any step."""
    p = dimensions()["plate"]
    plate, thick = parts["plate"], p["thickness"]
    free = 0.0
    for step in (0, p["step_deg"], 180):
        carrier = Rot(0, 0, step) * Pos(0, 0, thick) * parts["carrier"]
        angle = math.radians(step)
        # The pin stands on its head; here it hangs from above.
        top = thick + dimensions()["carrier"]["thickness"] + p["head"]
        at = Pos(p["ring"] * math.cos(angle), p["ring"] * math.sin(angle), top)
        pin = at * Rot(180, 0, 0) * parts["pin"]
        free += common(carrier, plate) + common(pin, plate) + common(pin, carrier)
    words = f"{free:.3f} mm3 shared"
    yield Row("plate", "with carrier and pin", words, "0", free < EMPTY_MM3)
