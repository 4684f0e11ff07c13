# SPDX-License-Identifier: MIT
"""Colours of the pictures, for light and dark pages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours that read well on GitHub's light or dark page."""

    name: str
    ink: str
    faint: str
    quiet: str  # explanations
    ours: str
    other: str
    third: str
    fourth: str


THEMES = (
    Theme(
        "light",
        ink="#1f2328",
        faint="#d0d7de",
        quiet="#59636e",
        ours="#0969da",
        other="#9a6700",
        third="#bf3989",
        fourth="#1a7f37",
    ),
    Theme(
        "dark",
        ink="#e6edf3",
        faint="#3d444d",
        quiet="#9198a1",
        ours="#58a6ff",
        other="#d29922",
        third="#f778ba",
        fourth="#3fb950",
    ),
)
