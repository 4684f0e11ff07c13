# SPDX-License-Identifier: MIT
"""Draws docs/pictures/wobble.svg: how a probe is wobbled about its tip."""

from __future__ import annotations

import math
from collections.abc import Iterator

from benchmarks.common.paths import PICTURES

OUTPUT = PICTURES / "wobble.svg"

WIDTH, HEIGHT, CELL = 720, 260, 240
LEAN_DEG, LONG, THICK = 25.0, 130.0, 11.0
INK, BODY, BASE, ARROW = "#1c2833", "#7fb3d5", "#d5dbdb", "#c0392b"
CELLS = ("forwards and back", "to both sides", "twist it")


def main() -> None:
    """Writes the picture."""
    OUTPUT.write_text(drawn())


def drawn() -> str:
    """The picture as SVG."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="14" text-anchor="middle">'
    )
    lines = [head, f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>', TIP]
    for index, words in enumerate(CELLS):
        x, y = CELL * (index + 0.5), 190.0
        lines += [*base(x, y), *(twisted(x, y) if index == 2 else swung(x, y, index))]
        lines.append(f'<text x="{x:g}" y="240" fill="{INK}">{words}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"


TIP = (
    '<defs><marker id="tip" markerWidth="9" markerHeight="9" refX="6" refY="4" '
    'orient="auto-start-reverse">'
    f'<path d="M0 0 8 4 0 8z" fill="{ARROW}"/></marker></defs>'
)


def base(x: float, y: float) -> Iterator[str]:
    """A block with a dimple at (x, y)."""
    yield (
        f'<path d="M{x - 80:g} {y - 6:g}h74l6 6 6-6h74v26h-160z" fill="{BASE}" '
        f'stroke="{INK}"/>'
    )


def probe(x: float, y: float, lean_deg: float, opacity: float) -> str:
    """A probe whose tip is at (x, y)."""
    high = y - LONG
    return (
        f'<path d="M{x:g} {y:g}L{x - THICK:g} {y - 26:g}V{high:g}h{2 * THICK:g}V'
        f'{y - 26:g}z" fill="{BODY}" stroke="{INK}" stroke-linejoin="round" '
        f'opacity="{opacity:g}" transform="rotate({lean_deg:g} {x:g} {y:g})"/>'
    )


def swung(x: float, y: float, index: int) -> Iterator[str]:
    """Leaning to both sides, with an arrow in both directions; `index` 1 is seen from
    ahead."""
    for lean_deg, opacity in ((-LEAN_DEG, 0.35), (LEAN_DEG, 0.35), (0.0, 1.0)):
        yield probe(x, y, lean_deg, opacity)
    radius = LONG + 18.0
    aside = radius * math.sin(math.radians(LEAN_DEG))
    high = y - radius * math.cos(math.radians(LEAN_DEG))
    yield (
        f'<path d="M{x - aside:.1f} {high:.1f}A{radius:g} {radius:g} 0 0 1 '
        f'{x + aside:.1f} {high:.1f}" fill="none" stroke="{ARROW}" stroke-width="2.5" '
        'marker-start="url(#tip)" marker-end="url(#tip)"/>'
    )
    seen = ("from the side", "from the front")[index]
    words = f"{LEAN_DEG:.0f} degrees to each side, {seen}"
    yield f'<text x="{x:g}" y="22" font-size="11" fill="{INK}">{words}</text>'


def twisted(x: float, y: float) -> Iterator[str]:
    """Upright, with an arrow about its axis."""
    yield probe(x, y, 0.0, 1.0)
    high = y - LONG + 30.0
    yield (
        f'<path d="M{x - 34:g} {high:g}A34 10 0 0 0 {x + 34:g} {high:g}" fill="none" '
        f'stroke="{ARROW}" stroke-width="2.5" marker-end="url(#tip)"/>'
    )


if __name__ == "__main__":
    main()
