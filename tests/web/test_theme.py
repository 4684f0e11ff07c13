# SPDX-License-Identifier: MIT
"""Texts can be read in both themes: contrast by WCAG 2.1, level AA."""

from __future__ import annotations

import re

import pytest

from imud.web.files import HERE

TEXT, GRAPHICS = 4.5, 3.0
PAIRS = [
    *(
        (ink, ground)
        for ink in ("ink", "muted")
        for ground in ("page", "surface", "raised")
    ),
    *((ink, "surface") for ink in ("accent", "good", "warn", "bad")),
    *((ink, "page") for ink in ("accent", "good", "warn")),
    *((kind, f"{kind}-soft") for kind in ("good", "warn", "bad")),
    ("on-accent", "accent"),
]
LINES = ("axis-x", "axis-y", "axis-z", "accent", "warn", "fourth")


def themes() -> dict[str, dict[str, str]]:
    """The colours of each theme by name."""
    text = (HERE / "site" / "theme.css").read_text()
    blocks = re.findall(r"(:root[^{]*)\{([^}]*)\}", text)
    return {
        ("dark" if "dark" in selector else "light"): dict(
            re.findall(r"--([\w-]+): (#[0-9a-f]{6});", block)
        )
        for selector, block in blocks
        if "--page" in block
    }


def luminance(colour: str) -> float:
    shares = (int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5))
    red, green, blue = (
        share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4
        for share in shares
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_measure_is_right_at_its_ends() -> None:
    assert contrast("#ffffff", "#000000") == pytest.approx(21)
    assert contrast("#777777", "#777777") == 1


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_and_lines_stand_out(theme: str) -> None:
    colours = themes()[theme]
    for ink, ground in PAIRS:
        assert contrast(colours[ink], colours[ground]) >= TEXT, (ink, ground)
    for line in LINES:
        assert contrast(colours[line], colours["surface"]) >= GRAPHICS, line
