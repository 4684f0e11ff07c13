# SPDX-License-Identifier: MIT
"""Draws docs/pictures/strokes-*.svg: an A4 outline, a circle and strokes of 10 cm, as
they are and as the probe measures them. The first motion that judges each case.
"""

from __future__ import annotations

import sys

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from benchmarks.common.figure import SETS
from benchmarks.common.paths import PICTURES
from benchmarks.pictures.theme import THEMES, Theme
from benchmarks.strokes import on_host
from benchmarks.strokes.runs import Found, Run, measure, run_of
from imud.rotation import FloatArray

SIZE = (10.0, 4.0)  # inches
PATHS = ("A4 outline, 4 x 1 s", "circle of 20 cm, 8 x 0.75 s")
STROKES = "supported, 2 s"
ELLIPSE = 2.448  # sigmas that hold 95 % of errors in a plane
CM = 100.0
REACH_CM = 11.0


def first(name: str) -> tuple[Run, Found]:
    """The first motion that judges a case, and what the probe makes of it."""
    case = next(each for each in on_host.CASES if each.name == name)
    run = run_of(case, 1000 * on_host.CASES.index(case) + SETS["judging"])
    return run, measure(run)


def places(run: Run, found: Found, *, is_closed: bool) -> FloatArray:
    """The corners that the probe measures, from the first on, cm; east and north."""
    way = np.cumsum(run.true + found.path, axis=0)
    if is_closed:
        share = np.arange(1, len(way) + 1)[:, None] / len(way)
        way = way - share * way[-1]
    return np.asarray(CM * np.vstack([np.zeros(3), way])[:, :2])


def undress(axes: Axes, theme: Theme, title: str, names: tuple[str, str]) -> None:
    axes.set_title(title, color=theme.ink)
    axes.set_aspect("equal")
    axes.margins(0.08)
    axes.set_xlabel(names[0], color=theme.quiet)
    axes.set_ylabel(names[1], color=theme.quiet)
    axes.tick_params(colors=theme.ink, length=0)
    axes.grid(color=theme.faint, lw=0.5)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_path(axes: Axes, theme: Theme, name: str, run: Run, found: Found) -> None:
    true = CM * np.vstack([np.zeros(3), np.cumsum(run.true, axis=0)])[:, :2]
    axes.plot(*true.T, color=theme.ink, lw=3.0, alpha=0.3, label="true")
    for is_closed, colour, label in (
        (False, theme.other, "measured"),
        (True, theme.ours, "closed"),
    ):
        rms = CM * on_host.corners(found, is_closed=is_closed)
        axes.plot(
            *places(run, found, is_closed=is_closed).T,
            color=colour,
            lw=1.0,
            marker="o",
            ms=3.0,
            label=f"{label}: corners {rms:.2f} cm rms",
        )
    undress(axes, theme, name, ("east, cm", "north, cm"))


def draw_strokes(axes: Axes, theme: Theme, run: Run, found: Found) -> None:
    """Each stroke from the middle, seen from the side."""
    side = [0, 2]
    for way, error, sigma in zip(
        CM * run.true, CM * found.errors, CM * found.sigmas, strict=True
    ):
        (x, y), (width, height) = way[side], 2.0 * ELLIPSE * sigma[side]
        axes.plot([0.0, x], [0.0, y], color=theme.ink, lw=3.0, alpha=0.3)
        axes.plot(x, y, color=theme.ink, marker="x", ms=5.0)
        end = way[side] + error[side]
        axes.plot(*end, color=theme.ours, marker="o", ms=3.0)
        axes.add_patch(
            Ellipse((end[0], end[1]), width, height, ec=theme.ours, fc="none", lw=1.0)
        )
    axes.plot([], [], color=theme.ink, lw=3.0, alpha=0.3, marker="x", label="true")
    axes.plot(
        [], [], color=theme.ours, marker="o", ms=3.0, lw=0, label="measured, 95 %"
    )
    undress(axes, theme, f"10 cm, {STROKES}", ("east, cm", "up, cm"))
    axes.set_xlim(-REACH_CM, REACH_CM)
    axes.set_ylim(-REACH_CM, REACH_CM)


def drawn(theme: Theme, known: dict[str, tuple[Run, Found]]) -> Figure:
    """The picture; `known`: the runs by the names of their cases."""
    figure = plt.figure(figsize=SIZE, layout="constrained")
    wide, *others = figure.subplots(1, 3, width_ratios=(1.4, 1.0, 1.0))
    for axes, name in zip((wide, others[0]), PATHS, strict=True):
        draw_path(axes, theme, name, *known[name])
    draw_strokes(others[1], theme, *known[STROKES])
    for axes in (wide, *others):
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.2),
            frameon=False,
            labelcolor=theme.ink,
        )
    return figure


def main() -> int:
    """Draws the picture for light and dark pages."""
    # Text stays text, and equal figures give equal files.
    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "imu-probe"})
    mpl.rcParams.update({"font.family": "sans-serif", "font.size": 9.0})
    known = {name: first(name) for name in (*PATHS, STROKES)}
    for theme in THEMES:
        figure = drawn(theme, known)
        target = PICTURES / f"strokes-{theme.name}.svg"
        figure.savefig(target, transparent=True, metadata={"Date": None})
        plt.close(figure)
        print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
