# SPDX-License-Identifier: MIT
"""The documents' pictures of the parts: edges that are seen, as SVG."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from build123d import Compound, ExportSVG, Part, Pos, pack

from hardware.layout import Block, Layout
from hardware.solids import box, lying

if TYPE_CHECKING:
    from hardware.__main__ import Piece, Set

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
EYE = (400.0, -700.0, 500.0)  # far away, in mm
APART_MM = 30.0


def draw(handles: Iterable[Set], pieces: Iterable[Piece]) -> None:
    for each in handles:
        _save(_opened(each), f"hardware-{each.layout.name}")
    others = [each.solid for each in pieces if not each.name.startswith("handle-")]
    if others:
        _save(pack(others, APART_MM / 2), "hardware-gauges")


def _save(parts: Iterable[Part], name: str) -> None:
    """The parts as one sees them from EYE, without what they hide of each other."""
    visible, _ = Compound(children=list(parts)).project_to_viewport(EYE)
    # Grey shows on a light and on a dark page.
    drawing = ExportSVG(line_weight=0.3, line_color="gray")
    drawing.add_shape(visible)
    drawing.write(PICTURES / f"{name}.svg")


def _opened(of: Set) -> list[Part]:
    """A handle with its lid and its saddle taken off, boards and rod in place."""
    layout = of.layout
    return [
        Pos(0, 0, -APART_MM) * of.saddle,
        of.base,
        box(layout.board_slab.block),
        box(layout.sensor_slab.block),
        _chip(layout),
        _rod(layout),
        Pos(0, 0, APART_MM) * of.lid,
    ]


def _chip(layout: Layout) -> Part:
    x, y, z = layout.chip
    return box(Block(x - 1.5, y - 1.5, z - 0.5, x + 1.5, y + 1.5, z + 0.5))


def _rod(layout: Layout) -> Part:
    x, y, z = layout.tip
    inside = layout.length - layout.handle["rod_in"]
    return lying(inside, x, y, z, layout.handle["rod"] / 2)
