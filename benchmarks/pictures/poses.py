# SPDX-License-Identifier: MIT
"""Draws docs/pictures/poses.svg: the twelve poses of docs/calibration.md."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.common.paths import PICTURES
from benchmarks.pictures.box import Side, lying, sides
from imud.calibration.poses import TWELVE, StaticPose
from imud.rotation import FloatArray

OUTPUT = PICTURES / "poses.svg"

COLUMNS, CELL_X, CELL_Y, SCALE = 4, 200, 170, 44
FILLS = {"top": "#7fb3d5", "bottom": "#566573", "front": "#f5b041"}
OTHER = "#d5dbdb"


def main() -> None:
    """Writes the picture."""
    OUTPUT.write_text(drawn())


def drawn() -> str:
    """The picture as SVG."""
    rows = -(-len(TWELVE) // COLUMNS)
    width, height = COLUMNS * CELL_X, rows * CELL_Y
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="13" text-anchor="middle">'
    )
    lines = [head, f'<rect width="{width}" height="{height}" fill="#ffffff"/>']
    for index, pose in enumerate(TWELVE):
        left, top = index % COLUMNS * CELL_X, index // COLUMNS * CELL_Y
        lines += cell(pose, index + 1, left + CELL_X / 2, top + CELL_Y / 2 - 12)
    return "\n".join([*lines, "</svg>"]) + "\n"


def cell(pose: StaticPose, number: int, x: float, y: float) -> Iterator[str]:
    """A probe that lies so, about a place, with its words below."""
    for side in sides(lying(pose)):
        yield polygon(side, x, y)
    words = f"{number}. {pose.words}"
    yield f'<text x="{x:g}" y="{y + 86:g}" fill="#1c2833">{words}</text>'


def polygon(side: Side, x: float, y: float) -> str:
    """A side and its name."""
    points = " ".join(f"{px:.1f},{py:.1f}" for px, py in placed(side.corners, x, y))
    ((tx, ty),) = placed(side.middle[None], x, y)
    return (
        f'<polygon points="{points}" fill="{FILLS.get(side.name, OTHER)}" '
        'stroke="#1c2833" stroke-linejoin="round"/>'
        f'<text x="{tx:.1f}" y="{ty + 4:.1f}" font-size="10">{side.name}</text>'
    )


def placed(points: FloatArray, x: float, y: float) -> list[tuple[float, float]]:
    """Points of the box in the picture's pixels."""
    return [(x + SCALE * px, y - SCALE * py) for px, py in points.tolist()]


if __name__ == "__main__":
    main()
