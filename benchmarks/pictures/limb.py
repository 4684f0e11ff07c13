# SPDX-License-Identifier: MIT
"""Draws docs/pictures/limb.svg: a virtual leg as three probes see it, beside its
truth, and how it is recorded.
"""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.common.feed import sampled
from benchmarks.common.paths import PICTURES
from benchmarks.limb import legs
from benchmarks.pictures.theme import LIGHT, blank, save
from imud.body import chain, contact, posture, session
from imud.body.session import BodyAnalysis
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

SEED = 300  # neither for tuning nor for judging
WIDTH, HEIGHT = 10.0, 5.6
SIGMAS = 1.96
DRAWN = 6  # of rows at 100 Hz: each sixth, so that the picture stays small
FIGURE_EVERY_S = 0.1
FIGURES_S = 2.3  # two strides
JOINTS = {"knee": "shank", "ankle": "foot"}


@cache
def recorded() -> tuple[leg.Leg, BodyAnalysis, contact.FootPath]:
    """The leg, what imud makes of its probes, and the path of its foot."""
    made = leg.made(SEED, leg.Manner(walk_s=15.0))
    found = {name: legs.track_of(sampled(each)) for name, each in made.motions.items()}
    seen = session.of(chain.read(leg.CHAIN, "leg"), found)
    return made, seen, seen.paths["foot"]


def draw(figure: Figure) -> None:
    """All of the picture."""
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0))
    over_time(figure.add_subplot(grid[0, :]))
    sticks(figure.add_subplot(grid[1, 0]))
    foot(figure.add_subplot(grid[1, 1]))
    for axes in figure.axes:
        axes.set_facecolor("none")
        axes.tick_params(colors=LIGHT.quiet)
        for spine in axes.spines.values():
            spine.set_color(LIGHT.faint)


def over_time(axes: Axes) -> None:
    """Flexion of knee and ankle over the whole recording, and what is done when."""
    made, seen, _ = recorded()
    times_s = seen.posture.times_s[::DRAWN]
    for (joint, child), colour in zip(
        JOINTS.items(), (LIGHT.ours, LIGHT.other), strict=True
    ):
        angle = np.degrees(seen.posture.angles[child][::DRAWN, 0])
        band = SIGMAS * np.degrees(seen.posture.sigmas[child][::DRAWN, 0])
        truth = np.degrees(made.angles[child][:, 0])[:: 10 * DRAWN]
        axes.fill_between(
            times_s, angle - band, angle + band, color=colour, alpha=0.25, lw=0
        )
        axes.plot(times_s, angle, color=colour, lw=1.2, label=joint)
        label = "truth" if joint == "ankle" else None
        axes.plot(
            np.arange(len(truth)) / RATE_HZ * 10 * DRAWN,
            truth,
            color=LIGHT.ink,
            lw=0.6,
            ls=":",
            label=label,
        )
    for name, (start, end) in made.stages.items():
        words = {"raise": "raise the knee", "rest": "stand", "end": "stand"}
        axes.axvline(start, color=LIGHT.faint, lw=0.8, zorder=0)
        axes.text(
            (start + end) / 2,
            103,
            words.get(name, name),
            color=LIGHT.quiet,
            ha="center",
        )
    axes.set_ylim(-45, 115)
    axes.set_xlim(0, times_s[-1])
    axes.set_title(
        "flexion in degrees, with the stated 95 %", color=LIGHT.ink, loc="left"
    )
    axes.set_xlabel("s", color=LIGHT.quiet)
    axes.legend(frameon=False, labelcolor=LIGHT.ink, loc="lower left", ncols=3)


def sticks(axes: Axes) -> None:
    """The leg in the plane ahead and up, some times a second, spread out."""
    made, seen, _ = recorded()
    body = chain.read(leg.CHAIN, "leg")
    places = posture.places(body, seen.posture.quats)
    start = made.stages["walk"][0] + 3.0
    times_s = seen.posture.times_s
    names = ("thigh.start", "shank.start", "foot.start", "foot.toe")
    for index, time_s in enumerate(np.arange(0.0, FIGURES_S, FIGURE_EVERY_S)):
        row = int(np.searchsorted(times_s, start + time_s))
        joints: FloatArray = np.array([places[name][row] for name in names])
        x, z = joints[:, 0] + 0.1 * index, joints[:, 2]
        axes.plot(x, z, color=LIGHT.ours, lw=1.4, marker="o", ms=2.0)
    axes.set_aspect("equal")
    title = f"thigh, shank, foot every {FIGURE_EVERY_S:g} s, from the hip (m)"
    axes.set_title(title, color=LIGHT.ink, loc="left")


def foot(axes: Axes) -> None:
    """How high the foot's probe is over how far it has gone."""
    made, _, path = recorded()
    begin = int(np.searchsorted(path.times_s, made.stages["walk"][0]))
    place = path.place - path.place[begin]
    away = np.hypot(*place[:, :2].T)
    drawn = slice(begin, None, DRAWN // 2)
    axes.plot(away[drawn], 100.0 * place[drawn, 2], color=LIGHT.ours, lw=1.2)
    rests = [first for first, _ in path.rests if first >= begin]
    axes.plot(away[rests], 100.0 * place[rests, 2], "o", color=LIGHT.other, ms=3)
    title = "the foot's probe: height (cm) over way (m); dots: rests"
    axes.set_title(title, color=LIGHT.ink, loc="left")


def main() -> int:
    figure = blank(WIDTH, HEIGHT)
    draw(figure)
    save(figure, PICTURES / "limb.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
