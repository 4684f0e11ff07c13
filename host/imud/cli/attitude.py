# SPDX-License-Identifier: MIT
"""An orientation drawn with characters: the horizon and a compass."""

from __future__ import annotations

from collections.abc import Sequence

# Columns and rows of the horizon, in characters of 2 x 4 dots each.
HORIZON = (14, 4)

# The horizon shows 45 degrees up and down; this is its tangent.
TANGENT = 1.0

# The tape of the compass: columns, and degrees per column.
TAPE, STEP_DEG = 29, 5
DIRECTIONS = {0: "E", 45: "NE", 90: "N", 135: "NW", 180: "W", 225: "SW", 270: "S"}
DIRECTIONS |= {315: "SE"}


def horizon(q: Sequence[float], size: tuple[int, int] = HORIZON) -> list[str]:
    """The view ahead (x) over a plain, as rows of Braille characters: dots are ground.

    `q` is world_from_body: w, x, y, z.
    """
    w, x, y, z = q
    # The world's up in the probe's axes; right of the picture is -y, its top is z.
    ahead, left, up = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    columns, rows = size
    width, height = 2 * columns, 4 * rows

    def is_ground(column: int, row: int) -> bool:
        right = (2 * column + 1 - width) / height * TANGENT
        high = (height - 2 * row - 1) / height * TANGENT
        return ahead - right * left + high * up < 0

    # The bits of Unicode's Braille patterns, by column and row.
    bits = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
    return [
        "".join(
            chr(
                0x2800
                + sum(
                    bits[i][j]
                    for i in range(2)
                    for j in range(4)
                    if is_ground(2 * column + i, 4 * row + j)
                )
            )
            for column in range(columns)
        )
        for row in range(rows)
    ]


def compass(yaw_deg: float) -> str:
    """A tape of compass points, TAPE columns wide; its middle is the nautical yaw."""
    signs = ["·" if column % 3 == TAPE // 2 % 3 else " " for column in range(TAPE)]
    for at_deg, name in DIRECTIONS.items():
        off_deg = (yaw_deg - at_deg + 180) % 360 - 180
        column = TAPE // 2 + round(off_deg / STEP_DEG)
        if column >= 0 and column + len(name) <= TAPE:
            signs[column : column + len(name)] = name
    return "".join(signs)
