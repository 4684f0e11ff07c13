# SPDX-License-Identifier: MIT
"""Draws docs/pictures/*.svg from the benchmarks' results.

errors: ours and VQF's on each recording. time: errors over the time of one of them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from benchmarks.common import boards
from benchmarks.common.engines import HOST, VQF
from benchmarks.common.paths import PICTURES, PROJECT, RESULTS
from benchmarks.pictures.theme import LIGHT, blank, save
from imud.rotation import FloatArray

NANO = boards.NANO.name

# The README shows pictures 10 inches wide, whatever their own width.
WIDTH = 10.0

# The engines that are drawn over time: name, label, colour.
OVER_TIME = (
    (NANO, "imu-probe, ATmega328P", "ours"),
    ("vqf", "VQF, doubles", "other"),
    ("ahrs-madgwick", "Madgwick, doubles", "third"),
    ("complementary", "complementary, of the thesis", "fourth"),
)
SMOOTH_S = (
    2.0  # length of the root mean square: shows levels, not the noise of the optics
)


def undress(axes: Axes) -> None:
    """Leave only a grid and text."""
    axes.tick_params(colors=LIGHT.ink, which="both", length=0)
    axes.grid(color=LIGHT.faint, lw=0.6)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_errors(figure: Figure, measured: Mapping[str, Any]) -> None:
    """Draw a line for each recording, from our error to VQF's."""
    axes, trials = figure.subplots(), measured["trials"]
    rows = np.arange(len(trials))[::-1]
    ours, other = (
        np.array(
            [scores[measured_as(scores, name)]["total"] for scores in trials.values()]
        )
        for name in (NANO, VQF)
    )
    axes.hlines(rows, ours, other, color=LIGHT.faint, lw=2.0, zorder=1)
    axes.scatter(other, rows, s=26, color=LIGHT.other, zorder=2)
    axes.scatter(ours, rows, s=26, color=LIGHT.ours, zorder=3)
    names = [name.replace("_", " ") for name in trials]
    undress(axes)
    axes.grid(visible=False, axis="y")
    axes.set_yticks(rows, names, fontsize=6.5, color=LIGHT.ink)
    axes.set_xlim(0.0, None)
    axes.set_xlabel("orientation error, degrees rms", color=LIGHT.ink)
    axes.set_title(
        f"• ATmega328P, fixed point: {ours.mean():.2f}°", color=LIGHT.ours, loc="left"
    )
    axes.set_title(
        f"• VQF, doubles: {other.mean():.2f}°", color=LIGHT.other, loc="right"
    )


def measured_as(errors: Mapping[str, Any], name: str) -> str:
    """The engine that was measured: the image, or its C on this machine."""
    return HOST if name == NANO and NANO not in errors else name


def smoothed(errors_deg: Sequence[float | None], step_s: float) -> FloatArray:
    """Root mean squares over SMOOTH_S, without times that the optics did not see."""
    values = np.array(errors_deg, dtype=np.float64)
    window = np.ones(max(1, round(SMOOTH_S / step_s)))
    seen = np.isfinite(values)
    squares = np.convolve(np.where(seen, values, 0.0) ** 2, window, "same")
    count = np.convolve(seen, window, "same")
    mean = squares / np.maximum(count, 1)
    return np.where(count > 0, np.sqrt(mean), np.nan)


def apart(places: Sequence[float], gap: float) -> list[float]:
    """Positions moved up where needed to keep a gap between neighbours."""
    moved: dict[int, float] = {}
    below = -np.inf
    for index in np.argsort(places).tolist():
        below = moved[index] = max(places[index], below + gap)
    return [moved[index] for index in range(len(places))]


def draw_time(figure: Figure, measured: Mapping[str, Any]) -> None:
    """Draw the errors over the time of one recording."""
    trace = measured["trace"]
    scores = measured["trials"][trace["trial"]]
    times, moving = np.array(trace["t_s"]), np.array(trace["moving"])
    begun, ended = np.flatnonzero(moving)[[0, -1]]
    times = times[begun : ended + 1] - times[begun]
    axes = figure.subplots()
    undress(axes)
    axes.set_yscale("log")
    axes.yaxis.set_ticks((0.3, 1, 3, 10, 30, 100))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    words, levels = [], []
    for name, label, colour in OVER_TIME:
        engine = measured_as(scores, name)
        if engine not in scores:
            continue
        errors = trace["errors_deg"][engine][begun : ended + 1]
        errors = smoothed(errors, times[1] - times[0])
        ink = getattr(LIGHT, colour)
        is_ours = name == NANO
        axes.plot(
            times, errors, color=ink, lw=2.2 if is_ours else 1.4, zorder=2 + is_ours
        )
        words.append((f"{label}: {scores[engine]['total']:.1f}°", ink))
        levels.append(float(np.log10(scores[engine]["total"])))
    # Labels stand at their figure on the axis; a line of text takes 0.2 decades.
    for (label, ink), place in zip(words, apart(levels, 0.2), strict=True):
        where = (1.005, 10.0**place)
        axes.annotate(
            label, where, xycoords=("axes fraction", "data"), color=ink, va="center"
        )
    axes.set_xlim(0.0, times[-1])
    axes.set_ylim(0.2, 180.0)
    axes.set_xlabel("seconds of movement", color=LIGHT.ink)
    number, _, title = trace["trial"].partition("_")
    axes.set_title(
        f"orientation error, degrees, on BROAD's trial {number}, "
        + title.replace("_", " "),
        color=LIGHT.ink,
        loc="left",
    )


PICTURES_OF = {"errors": (4.2, draw_errors), "time": (3.4, draw_time)}


def main() -> int:
    """Draw each picture."""
    path = RESULTS / "recordings.json"
    if not path.exists():
        raise SystemExit(f"{path.relative_to(PROJECT)} is missing; run `make bench`")
    measured = json.loads(path.read_text("utf-8"))["data"]
    for name, (height, draw) in PICTURES_OF.items():
        figure = blank(WIDTH, height)
        draw(figure, measured)
        save(figure, PICTURES / f"{name}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
