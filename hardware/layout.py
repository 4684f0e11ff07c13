# SPDX-License-Identifier: MIT
"""The layout of a handle, from dimensions.toml: numbers alone, for tests and the first
params, which have no library for solids.

The frame of a handle: x to its front, y to its left, z to its top; from the middle of
the lower edge of its back. Lengths in mm.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("dimensions.toml")

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Block:
    """A box between two corners."""

    x0: float
    y0: float
    z0: float
    x1: float
    y1: float
    z1: float

    def grown(self, x: float, y: float = 0.0, z: float = 0.0) -> Block:
        return Block(
            *(self.x0 - x, self.y0 - y, self.z0 - z),
            *(self.x1 + x, self.y1 + y, self.z1 + z),
        )


@dataclass(frozen=True, slots=True)
class Slab:
    """A printed circuit board in its place: the block, and where posts may touch it."""

    block: Block
    posts: tuple[Block, ...]  # its areas, from its lower to its upper side
    above: float  # room for parts on it
    standoff: float  # room for parts below


@cache
def dimensions() -> dict[str, Any]:
    with FILE.open("rb") as file:
        return tomllib.load(file)


def boards() -> tuple[str, ...]:
    return tuple(dimensions()["board"])


class Layout:
    """One handle: a board with its sensor."""

    def __init__(self, name: str) -> None:
        every = dimensions()
        self.name = name
        self.board: dict[str, Any] = every["board"][name]
        self.sensor: dict[str, Any] = every["sensor"][self.board["sensor"]]
        self.handle: dict[str, Any] = every["handle"]
        self.screw: dict[str, Any] = every["screw"]
        h = self.handle
        self.inner = max(self.board["width"], self.sensor["width"]) + 2 * h["fit"]
        self.width = self.inner + 2 * h["wall"]
        self.height: float = self.board["height"]
        self.split: float = self.board["split"]
        plug = self.board["plug"][0]
        self.board_x = h["rear"] + plug + h["stop"] + h["fit"]
        board_end = self.board_x + self.board["length"] + h["fit"] + h["stop"]
        self.gap_x = board_end  # of the room for button and wires
        self.sensor_x = board_end + h["gap"] + h["stop"] + h["fit"]
        end = self.sensor_x + self.sensor["length"] + h["fit"] + h["stop"]
        self.cavity_end = end
        self.length = end + h["front"]

    @property
    def outside(self) -> Block:
        side = self.width / 2
        return Block(0, -side, 0, self.length, side, self.height)

    @property
    def cavity(self) -> Block:
        side, top = self.inner / 2, self.height - self.handle["floor"]
        floor = self.handle["floor"]
        return Block(self.handle["rear"], -side, floor, self.cavity_end, side, top)

    def _slab(self, of: dict[str, Any], x: float) -> Slab:
        z = self.handle["floor"] + of["standoff"]
        y = -of["width"] / 2
        top = z + of["thickness"]
        block = Block(x, y, z, x + of["length"], y + of["width"], top)
        posts = tuple(
            Block(x + x0, y + y0, z, x + x1, y + y1, top)
            for x0, y0, x1, y1 in of["posts"]
        )
        return Slab(block, posts, of["above"], of["standoff"])

    @property
    def board_slab(self) -> Slab:
        return self._slab(self.board, self.board_x)

    @property
    def sensor_slab(self) -> Slab:
        return self._slab(self.sensor, self.sensor_x)

    @property
    def plug(self) -> Block:
        """The room of the cable's plug, behind the board."""
        length, width, height = self.board["plug"]
        middle = self.board_slab.block.z1 + self.board["plug_center"]
        end = self.board_x
        return Block(
            *(end - length, -width / 2, middle - height / 2),
            *(end, width / 2, middle + height / 2),
        )

    @property
    def cable_rise(self) -> float:
        """How much higher the cable's clamp is than the plug."""
        return self.split - (self.plug.z0 + self.plug.z1) / 2

    @property
    def window(self) -> Block | None:
        """The opening above the board's LEDs."""
        if "window" not in self.board:
            return None
        x0, y0, x1, y1 = self.board["window"]
        y = self.board_slab.block.y0
        return Block(
            *(self.board_x + x0, y + y0, self.split),
            *(self.board_x + x1, y + y1, self.height),
        )

    @property
    def button(self) -> tuple[float, float]:
        return self.gap_x + self.handle["gap"] / 2, 0.0

    @property
    def screws(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """One at the back on the right, one in front on the left."""
        y = self.width / 2 - self.handle["screw_to_side"]
        x = self.handle["rear"] / 2
        return (x, -y), (self.length - self.handle["front"] / 2 - 1, y)

    def thread(self, length: float, below: float = 0.0) -> float:
        """How much of a screw is inside the lid; `below`: a plate under the base."""
        return length - below - self.split

    @property
    def chip(self) -> Point:
        block = self.sensor_slab.block
        x, y, z = self.sensor["chip"]
        return block.x0 + x, block.y0 + y, block.z1 + z

    @property
    def tip(self) -> Point:
        return self.length + self.handle["rod_out"], 0.0, self.split

    @property
    def tip_from_chip(self) -> Point:
        x, y, z = (t - c for t, c in zip(self.tip, self.chip, strict=True))
        return round(x, 3), round(y, 3), round(z, 3)

    @property
    def tip_error(self) -> float:
        """One sigma of an axis: the chip's place, and what printing and a rod add."""
        return math.hypot(self.sensor["chip_error"], self.handle["tip_error"])


def index_error_deg() -> float:
    """How far the carrier can be turned to one side, at most: half the play of the
    pin in both of its holes and of the stub in one, over the ring's radius.
    """
    p = dimensions()["plate"]
    return math.degrees(1.5 * p["hole_fit"] / p["ring"])


def wedge_error_deg() -> float:
    """How wrong a wedge is if one end of its slope is off by an error of printing."""
    error = dimensions()["process"]["layer_error"]
    return math.degrees(error / dimensions()["wedge"]["length"])


def tip_radius(layout: Layout) -> float:
    """Of the circle that the tip goes round on the carrier."""
    x, _, _ = layout.tip
    return float(dimensions()["carrier"]["stop_x"] + x)
