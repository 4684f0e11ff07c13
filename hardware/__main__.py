# SPDX-License-Identifier: MIT
"""Builds the printed parts into build/hardware as STL, STEP and 3MF, and checks them:
`make hardware`. With --pictures it also draws the documents' pictures.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from build123d import Mesher, Part, Pos, Rot, export_step, export_stl

from hardware import archive, checks, gauge_checks, gauges, handle, planted
from hardware.checks import Row
from hardware.layout import Layout, boards, index_error_deg, wedge_error_deg

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "build" / "hardware" / "parts"
CHORD_MM, ANGLE_RAD = 0.01, 0.1  # of the triangles that are printed


@dataclass(frozen=True)
class Piece:
    """A solid, and how it is turned to be printed without supports."""

    name: str
    solid: Part
    is_on_head: bool = False

    @property
    def printed(self) -> Part:
        """As it lies on the bed."""
        turned = Rot(180, 0, 0) * self.solid if self.is_on_head else self.solid
        return Pos(0, 0, -turned.bounding_box().min.Z) * turned


@dataclass(frozen=True)
class Set:
    """The parts of one handle."""

    layout: Layout
    base: Part
    lid: Part
    saddle: Part

    def pieces(self) -> Iterator[Piece]:
        name = f"handle-{self.layout.name}"
        yield Piece(f"{name}-base", self.base)
        yield Piece(f"{name}-lid", self.lid, is_on_head=True)
        yield Piece(f"{name}-saddle", self.saddle)


def sets(names: list[str]) -> Iterator[Set]:
    for name in names:
        layout = Layout(name)
        yield Set(
            layout, handle.base(layout), handle.lid(layout), handle.saddle(layout)
        )


def main() -> int:
    parser = argparse.ArgumentParser(prog="hardware", description=__doc__)
    parser.add_argument(
        "--only", choices=[*boards(), "gauges"], help="one handle, or the gauges"
    )
    parser.add_argument(
        "--pictures", action="store_true", help="also draw docs/pictures/hardware-*"
    )
    args = parser.parse_args()
    began_s, made_of = time.monotonic(), archive.origin()
    names = [name for name in boards() if args.only in (None, name)]
    handles = list(sets(names))
    pieces = [piece for each in handles for piece in each.pieces()]
    tools = gauges.all_gauges() if args.only in (None, "gauges") else {}
    pieces += [Piece(name, solid) for name, solid in tools.items()]
    shutil.rmtree(PLACE, ignore_errors=True)
    PLACE.mkdir(parents=True)
    rows = [row for piece in pieces for row in _piece(piece)]
    for each in handles:
        rows += checks.of_handle(each.layout, each.base, each.lid, each.saddle)
    if tools:
        rows += gauge_checks.of_gauges(tools)
    _report(rows)
    if args.pictures:
        from hardware import pictures

        pictures.draw(handles, pieces)
    bad = sum(not row.is_good for row in rows)
    missed = planted.undetected(handles[0]) if handles else []
    if not args.only:
        path = PLACE.parent / archive.NAME
        path.unlink(missing_ok=True)  # a release would take it
        if not bad and not missed:
            archive.write(path, [*sorted(PLACE.iterdir()), ROOT / "LICENSE"], made_of)
    for what in missed:
        sys.stdout.write(f"a planted fault is not found: {what}\n")
    sys.stdout.write(
        f"{len(pieces)} parts in {PLACE}, {len(rows)} checks, {bad} not good, "
        f"{time.monotonic() - began_s:.0f} s\n"
    )
    return int(bad > 0 or bool(missed))


def _piece(piece: Piece) -> Iterator[Row]:
    """Writes the files of a part, and checks it."""
    printed = piece.printed
    path = PLACE / piece.name
    export_stl(printed, path.with_suffix(".stl"), CHORD_MM, ANGLE_RAD)
    export_step(printed, path.with_suffix(".step"))
    mesher = Mesher()
    mesher.add_shape(printed, linear_deflection=CHORD_MM, angular_deflection=ANGLE_RAD)
    mesher.write(path.with_suffix(".3mf"))
    is_closed = all(mesh.IsManifoldAndOriented() for mesh in mesher.meshes)
    told = "closed" if is_closed else "open"
    yield Row(piece.name, "triangles", told, "closed", is_closed)
    yield from checks.of_part(piece.name, printed)


def _report(rows: list[Row]) -> None:
    """A line for each check, in build/hardware/checks.txt; failed ones also here."""
    lines = [
        f"{'good' if row.is_good else 'NOT GOOD':<9}{row.part:<22}{row.what:<46}"
        f"{row.measured:<48}{row.limit}"
        for row in rows
    ]
    (PLACE.parent / "checks.txt").write_text("\n".join(lines) + "\n", "utf-8")
    for line, row in zip(lines, rows, strict=True):
        if not row.is_good:
            sys.stdout.write(line + "\n")
    play, slope = index_error_deg(), wedge_error_deg()
    sys.stdout.write(f"plate: at most {play:.2f} deg of play to one side\n")
    sys.stdout.write(f"wedges: {slope:.2f} deg if an end is off by a layer's error\n")


if __name__ == "__main__":
    sys.exit(main())
