# SPDX-License-Identifier: MIT
"""How the pictures look, on light and on dark pages, and how they are saved."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from io import StringIO
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours that read well on their own ground, each of them once."""

    ground: str
    ink: str
    faint: str
    quiet: str  # explanations
    ours: str
    other: str
    third: str
    fourth: str


# The grounds are those of GitHub's pages. A picture has its own, because a page can be
# light where the browser is set to dark.
LIGHT = Theme(
    ground="#ffffff",
    ink="#1f2328",
    faint="#d0d7de",
    quiet="#59636e",
    ours="#0969da",
    other="#9a6700",
    third="#bf3989",
    fourth="#1a7f37",
)
DARK = Theme(
    ground="#0d1117",
    ink="#e6edf3",
    faint="#3d444d",
    quiet="#9198a1",
    ours="#58a6ff",
    other="#d29922",
    third="#f778ba",
    fourth="#3fb950",
)


def blank(width: float, height: float) -> Figure:
    """A figure to draw on in the colours of LIGHT; inches."""
    # Text stays text, and equal figures give equal files.
    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "imu-probe"})
    mpl.rcParams.update({"font.family": "sans-serif"})
    mpl.rcParams.update({"font.size": 9.0, "axes.titlesize": 9.0})
    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: Path) -> None:
    """Write a figure of LIGHT as an SVG that shows DARK's colours on a dark page."""
    drawn = StringIO()
    figure.savefig(drawn, format="svg", facecolor=LIGHT.ground, metadata={"Date": None})
    # A line an element, where matplotlib writes one for each point, and 1/100 units.
    svg = re.sub(r"\s*\n(?=[MLCQz\"])", "", drawn.getvalue())
    svg = re.sub(r"\d+\.\d{3,}", lambda found: f"{float(found[0]):.2f}", svg)
    pairs = zip(asdict(LIGHT).values(), asdict(DARK).values(), strict=True)
    rules = "".join(
        f'[style*="{name}: {light}"]{{{name}:{dark} !important}}'
        for light, dark in pairs
        for name in ("fill", "stroke")
    )
    style = f"<style>@media (prefers-color-scheme:dark){{{rules}}}</style>\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(svg.replace("</defs>", f"{style}</defs>", 1))
    print(path)
