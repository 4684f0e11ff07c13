# SPDX-License-Identifier: MIT
"""Draws docs/pictures/strokes.svg: an A4 outline, a circle and strokes of 10 cm, as
they are and as the probe measures them. The first motion that judges each case.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from benchmarks.common.paths import PICTURES
from benchmarks.harness import SETS
from benchmarks.pictures.theme import LIGHT, blank, save
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


def undress(axes: Axes, title: str, names: tuple[str, str]) -> None:
    axes.set_title(title, color=LIGHT.ink, fontsize="large")
    axes.set_aspect("equal")
    axes.margins(0.08)
    axes.set_xlabel(names[0], color=LIGHT.quiet)
    axes.set_ylabel(names[1], color=LIGHT.quiet)
    axes.tick_params(colors=LIGHT.ink, length=0)
    axes.grid(color=LIGHT.faint, lw=0.5)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_path(axes: Axes, name: str, run: Run, found: Found) -> None:
    true = CM * np.vstack([np.zeros(3), np.cumsum(run.true, axis=0)])[:, :2]
    axes.plot(*true.T, color=LIGHT.ink, lw=3.0, alpha=0.3, label="true")
    for is_closed, colour, label in (
        (False, LIGHT.other, "measured"),
        (True, LIGHT.ours, "closed"),
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
    undress(axes, name, ("east, cm", "north, cm"))


def draw_strokes(axes: Axes, run: Run, found: Found) -> None:
    """Each stroke from the middle, seen from the side."""
    side = [0, 2]
    for way, error, sigma in zip(
        CM * run.true, CM * found.errors, CM * found.sigmas, strict=True
    ):
        (x, y), (width, height) = way[side], 2.0 * ELLIPSE * sigma[side]
        axes.plot([0.0, x], [0.0, y], color=LIGHT.ink, lw=3.0, alpha=0.3)
        axes.plot(x, y, color=LIGHT.ink, marker="x", ms=5.0)
        end = way[side] + error[side]
        axes.plot(*end, color=LIGHT.ours, marker="o", ms=3.0)
        axes.add_patch(
            Ellipse((end[0], end[1]), width, height, ec=LIGHT.ours, fc="none", lw=1.0)
        )
    axes.plot([], [], color=LIGHT.ink, lw=3.0, alpha=0.3, marker="x", label="true")
    axes.plot(
        [], [], color=LIGHT.ours, marker="o", ms=3.0, lw=0, label="measured, 95 %"
    )
    undress(axes, f"10 cm, {STROKES}", ("east, cm", "up, cm"))
    axes.set_xlim(-REACH_CM, REACH_CM)
    axes.set_ylim(-REACH_CM, REACH_CM)


def drawn(known: dict[str, tuple[Run, Found]]) -> Figure:
    """The picture; `known`: the runs by the names of their cases."""
    figure = blank(*SIZE)
    wide, *others = figure.subplots(1, 3, width_ratios=(1.4, 1.0, 1.0))
    for axes, name in zip((wide, others[0]), PATHS, strict=True):
        draw_path(axes, name, *known[name])
    draw_strokes(others[1], *known[STROKES])
    for axes in (wide, *others):
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.2),
            frameon=False,
            labelcolor=LIGHT.ink,
        )
    return figure


def main() -> int:
    """Draws the picture."""
    known = {name: first(name) for name in (*PATHS, STROKES)}
    save(drawn(known), PICTURES / "strokes.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
