# SPDX-License-Identifier: MIT
"""Faults that are planted, each of which one of the checks must find."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from build123d import Part, Pos

from hardware import checks
from hardware.checks import Row
from hardware.layout import Block, Layout
from hardware.solids import box

if TYPE_CHECKING:
    from hardware.__main__ import Set


def _thin() -> Iterable[Row]:
    cup = box(Block(0, 0, 0, 20, 20, 10)) - box(Block(0.8, 2, 2, 18, 18, 10))
    return checks.of_part("cup", cup)


def _ceiling() -> Iterable[Row]:
    bridge = box(Block(0, 0, 0, 20, 20, 10)) - box(Block(5, -1, 0, 15, 21, 5))
    return checks.of_part("bridge", bridge)


def _two() -> Iterable[Row]:
    pair = Part(children=[box(Block(0, 0, 0, 5, 5, 5)), box(Block(9, 0, 0, 14, 5, 5))])
    return checks.of_part("pair", pair)


def _moved(of: Set, z: float) -> Iterable[Row]:
    """With the lid too high or too low."""
    lid = Pos(0, 0, z) * of.lid
    return checks.of_handle(of.layout, of.base, lid, of.saddle)


def _changed(of: Set, **values: float) -> Iterable[Row]:
    """The parts as they are, with another board or screw than they were made for."""
    layout = Layout(of.layout.name)
    layout.board = {**layout.board, **values}
    layout.inner, layout.width = of.layout.inner, of.layout.width
    return checks.of_handle(layout, of.base, of.lid, of.saddle)


def undetected(of: Set) -> list[str]:
    """The faults that no check finds; each is named with the row that has to."""
    wider = of.layout.board["width"] + 2.0
    faults: dict[str, Callable[[], Iterable[Row]]] = {
        "thinnest wall": _thin,
        "overhang": _ceiling,
        "closed surface": _two,
        "base and lid share": lambda: _moved(of, -0.2),
        "board with 0.39 mm around it shares": lambda: _changed(of, width=wider),
        "rear screw of 12": lambda: _changed(of, screw=12.0),
        "rod is squeezed by": lambda: _moved(of, 0.3),
    }
    return [
        what
        for what, rows in faults.items()
        if not any(row.what == what and not row.is_good for row in rows())
    ]
