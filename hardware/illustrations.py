# SPDX-License-Identifier: MIT
"""The documents' pictures of the parts: three sides of each, an exploded handle, and
drawings with dimensions.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from build123d import Part, Pos
from PIL import Image, ImageDraw

from hardware import mesh
from hardware.drawings import Drawing, sheet
from hardware.layout import Block, Layout, dimensions
from hardware.pictures import View, beside, render, save
from hardware.solids import box, lying

if TYPE_CHECKING:
    from hardware.__main__ import Piece, Set

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
Tint = tuple[int, int, int]
BASE, LID, SADDLE, GAUGE = (
    (112, 160, 210),
    (232, 178, 108),
    (150, 196, 150),
    (176, 176, 190),
)
BOARD, SENSOR, METAL = (40, 120, 70), (120, 60, 140), (190, 170, 120)
VIEWS = (View(-60, 35), View(60, -35), View(-90, 89.9))
EYE = View(-60, 32)


def draw(handles: list[Set], pieces: list[Piece]) -> None:
    for each in handles:
        name = each.layout.name
        save(_parts(each), PICTURES / f"hardware-{name}-parts.png")
        save(_exploded(each), PICTURES / f"hardware-{name}.png")
        _base_sheet(each).save(PICTURES / f"hardware-{name}-base.svg")
        _lid_sheet(each).save(PICTURES / f"hardware-{name}-lid.svg")
    others = [piece for piece in pieces if not piece.name.startswith("handle-")]
    if others:
        save(_table(others), PICTURES / "hardware-gauges.png")


def _rows(parts: list[tuple[str, Part, Tint]], size: tuple[int, int]) -> Image.Image:
    """A row for each part: its name, then three sides."""
    rows = []
    for name, part, tint in parts:
        surface = mesh.of(part)
        row = beside([render([(surface, tint)], view, size) for view in VIEWS])
        ImageDraw.Draw(row).text((6, 4), name, fill=(60, 60, 60))
        rows.append(row)
    whole = Image.new("RGB", (rows[0].width, sum(r.height for r in rows)), "white")
    y = 0
    for row in rows:
        whole.paste(row, (0, y))
        y += row.height
    return whole


def _parts(of: Set) -> Image.Image:
    parts = [
        ("base", of.base, BASE),
        ("lid", of.lid, LID),
        ("saddle", of.saddle, SADDLE),
    ]
    return _rows(parts, (420, 210))


def _table(pieces: list[Piece]) -> Image.Image:
    """Two columns of gauges."""
    parts = [(piece.name, piece.solid, GAUGE) for piece in pieces]
    half = (len(parts) + 1) // 2
    return beside([_rows(parts[:half], (230, 170)), _rows(parts[half:], (230, 170))])


def _exploded(of: Set) -> Image.Image:
    """The handle opened, with boards and rod in their places."""
    layout = of.layout
    up = 30 + layout.height
    things = [
        (of.base, BASE),
        (Pos(0, 0, up) * of.lid, LID),
        (box(layout.board_slab.block), BOARD),
        (_usb(layout), METAL),
        (box(layout.sensor_slab.block), SENSOR),
        (_chip(layout), (30, 30, 30)),
        (_rod(layout), METAL),
    ]
    return render([(mesh.of(part), tint) for part, tint in things], EYE, (900, 520))


def _usb(layout: Layout) -> Part:
    """The connector at the board's end; on the pyboard it stays without a plug."""
    b = layout.board_slab.block
    middle = b.z1 + layout.board["plug_center"]
    z0, z1 = (middle - 1.4, middle + 1.4)
    return box(Block(b.x0 - 1.3, -3.9, z0, b.x0 + 6, 3.9, z1))


def _chip(layout: Layout) -> Part:
    x, y, z = layout.chip
    return box(Block(x - 1.5, y - 1.5, z - 0.5, x + 1.5, y + 1.5, z + 0.5))


def _rod(layout: Layout) -> Part:
    x, y, z = layout.tip
    inside = layout.length - layout.handle["rod_in"]
    return lying(inside, x, y, z, layout.handle["rod"] / 2)


def _base_sheet(of: Set) -> Drawing:
    """With the places that matter: boards, chip, screws, split, tip."""
    layout = of.layout
    drawing, zeros = sheet(f"{layout.name}: base, mm", of.base)
    x, y = zeros["top"]
    low = y + layout.width / 2
    marks = [
        ("board", layout.board_slab.block.x0),
        ("sensor", layout.sensor_slab.block.x0),
        ("chip", layout.chip[0]),
    ]
    for row, (name, at) in enumerate(marks):
        drawing.across(x, x + at, low + 5 + 5 * row, f"{name} {at:.1f}")
    (rear, _), (front, side) = layout.screws
    drawing.across(x, x + rear, y - layout.width / 2 - 9, f"{rear:.1f}")
    drawing.across(x, x + front, y - layout.width / 2 - 14, f"screw {front:.1f}")
    drawing.upright(y, y - side, x + layout.length + 8, f"{side:.1f}")
    fx, fy = zeros["front"]
    notes = [
        f"tip from chip: {', '.join(f'{v:.1f}' for v in layout.tip_from_chip)}",
        f"rod {layout.handle['rod']:g}, {layout.handle['rod_out']:g} out; "
        f"screws M3 x {layout.board['screw']:g}",
        f"tongue {layout.handle['lip']:g}, play {layout.handle['lip_fit']:g}",
    ]
    for row, note in enumerate(notes):
        drawing.note(fx, fy + 8 + 5 * row, note)
    return drawing


def _lid_sheet(of: Set) -> Drawing:
    layout = of.layout
    drawing, zeros = sheet(f"{layout.name}: lid, mm", of.lid)
    x, y = zeros["top"]
    low = y + layout.width / 2
    drawing.across(x, x + layout.button[0], low + 5, f"button {layout.button[0]:.1f}")
    if layout.window is not None:
        at = (layout.window.x0 + layout.window.x1) / 2
        drawing.across(x, x + at, low + 10, f"window {at:.1f}")
    b = dimensions()["button"]
    fx, fy = zeros["front"]
    words = (
        f"switch {b['body']:g} x {b['body']:g}; thread hole {layout.screw['thread']:g}"
    )
    drawing.note(fx, fy + 8 - layout.split, words)
    return drawing
