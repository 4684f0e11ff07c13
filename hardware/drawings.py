# SPDX-License-Identifier: MIT
"""Drawings with dimensions, as SVG: three sides of a part, hidden edges dashed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from build123d import GeomType, Part

from hardware.mesh import Floats

FAR_MM = 1000.0
MARGIN_MM = 16.0
GAP_MM = 22.0  # between two views, for their dimensions
STYLE = """\
<style>
path { fill: none; stroke: #222; stroke-width: .35; stroke-linecap: round }
.h { stroke: #888; stroke-width: .2; stroke-dasharray: 1.2 .8 }
.d { stroke: #1559a5; stroke-width: .18 }
text { font: 3.2px sans-serif; fill: #1559a5; text-anchor: middle }
.t { font-size: 4.4px; fill: #222; text-anchor: start }
.n { fill: #222; text-anchor: start }
</style>"""
# Where one stands, and which way is up.
SIDES = {
    "top": ((0, 0, 1), (0, 1, 0)),
    "front": ((0, -1, 0), (0, 0, 1)),
    "end": ((1, 0, 0), (0, 0, 1)),
}


@dataclass(frozen=True)
class Flat:
    """A part as seen from one side: x to the right, y up."""

    visible: list[Floats]
    hidden: list[Floats]

    @property
    def box(self) -> tuple[float, float, float, float]:
        points = np.concatenate(self.visible)
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


def seen(part: Part, side: str) -> Flat:
    eye, up = SIDES[side]
    origin = tuple(FAR_MM * value for value in eye)
    visible, hidden = part.project_to_viewport(origin, up, (0, 0, 0))
    return Flat([_line(e) for e in visible], [_line(e) for e in hidden])


def _line(edge: Any) -> Floats:
    """The edge as a line of points: a straight one has two."""
    count = 2 if edge.geom_type == GeomType.LINE else 25 if edge.is_closed else 9
    points = (edge.position_at(k / (count - 1)) for k in range(count))
    return np.array([(p.X, p.Y) for p in points])


@dataclass
class Drawing:
    """Millimetres, x to the right and y down."""

    title: str
    lines: list[str] = field(default_factory=list)
    right: float = 0.0
    low: float = 0.0

    def put(self, flat: Flat, x: float, y: float) -> tuple[float, float]:
        """A view with its upper left corner there; where its own zero then is."""
        x0, _, _, y1 = flat.box
        shift = (x - x0, y + y1)
        for lines, kind in ((flat.hidden, ' class="h"'), (flat.visible, "")):
            data = "".join(_path(line, shift) for line in lines)
            if data:
                self.lines.append(f'<path{kind} d="{data}"/>')
        self._reach(x + flat.box[2] - x0, y + y1 - flat.box[1])
        return shift

    def across(self, x0: float, x1: float, y: float, text: str) -> None:
        """A dimension between two x, drawn at y."""
        self.lines.append(
            f'<path class="d" d="M{x0:.2f} {y:.2f}H{x1:.2f}'
            f'M{x0:.2f} {y - 1.5:.2f}v3M{x1:.2f} {y - 1.5:.2f}v3"/>'
        )
        self.lines.append(
            f'<text x="{(x0 + x1) / 2:.2f}" y="{y - 1:.2f}">{text}</text>'
        )
        self._reach(max(x0, x1), y + 2)

    def upright(self, y0: float, y1: float, x: float, text: str) -> None:
        """A dimension between two y, drawn at x."""
        self.lines.append(
            f'<path class="d" d="M{x:.2f} {y0:.2f}V{y1:.2f}'
            f'M{x - 1.5:.2f} {y0:.2f}h3M{x - 1.5:.2f} {y1:.2f}h3"/>'
        )
        middle = (y0 + y1) / 2
        self.lines.append(
            f'<text transform="translate({x - 1:.2f} {middle:.2f}) rotate(-90)">'
            f"{text}</text>"
        )
        self._reach(x + 2, max(y0, y1))

    def note(self, x: float, y: float, text: str, kind: str = "n") -> None:
        self.lines.append(f'<text class="{kind}" x="{x:.2f}" y="{y:.2f}">{text}</text>')
        self._reach(x + 1.75 * len(text), y + 2)

    def _reach(self, x: float, y: float) -> None:
        self.right, self.low = max(self.right, x), max(self.low, y)

    def text(self) -> str:
        width, height = self.right + MARGIN_MM, self.low + 8
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} '
            f'{height:.0f}" width="{4 * width:.0f}">'
        )
        title = f"<title>{self.title}</title>"
        paper = f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>'
        return "\n".join([head, title, STYLE, paper, *self.lines, "</svg>"]) + "\n"

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.text(), "utf-8")


def _path(line: Floats, shift: tuple[float, float]) -> str:
    points = [f"{shift[0] + x:.2f} {shift[1] - y:.2f}" for x, y in line]
    return f"M{points[0]}L{' '.join(points[1:])}"


def sheet(title: str, part: Part) -> tuple[Drawing, dict[str, tuple[float, float]]]:
    """Three views of a part with its outer dimensions; where each view's zero is."""
    drawing = Drawing(title)
    drawing.note(MARGIN_MM, 8, title, "t")
    top, front, end = (seen(part, side) for side in SIDES)
    x, y = MARGIN_MM, 32.0
    zeros = {"top": drawing.put(top, x, y)}
    x0, y0, x1, y1 = top.box
    drawing.across(x, x + x1 - x0, y - 4, f"{x1 - x0:.1f}")
    drawing.upright(y, y + y1 - y0, x - 4, f"{y1 - y0:.1f}")
    below = y + y1 - y0 + GAP_MM
    zeros["front"] = drawing.put(front, x, below)
    _, z0, _, z1 = front.box
    drawing.upright(below, below + z1 - z0, x - 4, f"{z1 - z0:.1f}")
    aside = x + x1 - x0 + GAP_MM
    zeros["end"] = drawing.put(end, aside, below)
    return drawing, zeros
