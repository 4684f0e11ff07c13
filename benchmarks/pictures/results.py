# SPDX-License-Identifier: MIT
"""Draws docs/pictures/*.svg from the benchmarks' results.

probe: the image's poses in a hand, beside its error on each recording. time: errors
over the time of one recording.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from benchmarks.common import boards
from benchmarks.common.capture import run
from benchmarks.common.engines import HOST, VQF
from benchmarks.common.images import RunFailed
from benchmarks.common.paths import PICTURES, PROJECT, RESULTS
from benchmarks.pictures.hand import draw_hand
from benchmarks.pictures.theme import LIGHT, blank, save
from imud.errors import ImudError
from imud.rotation import FloatArray
from imud.virtual import sensors

NANO = boards.NANO.name

HAND_SEED = 10
HAND_SECONDS = 40.0

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


def set_log(axes: Axes, which: str, ticks: Sequence[float]) -> None:
    """Make an axis logarithmic, with plain numbers at these ticks."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis.set_ticks(ticks)
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(mpl.ticker.NullLocator())
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:,g}".replace(",", " "))
    )


def draw_errors(axes: Axes, measured: dict[str, Any]) -> None:
    """Draw a line for each recording, from our error to VQF's."""
    trials = measured["trials"]
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
    axes.set_yticks(rows, names, fontsize=6.5, color=LIGHT.ink)
    axes.set_xlim(0.0, None)
    axes.set_xlabel("orientation error, degrees rms", color=LIGHT.ink)
    axes.tick_params(colors=LIGHT.ink, length=0)
    axes.grid(axis="x", color=LIGHT.faint, lw=0.6)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(
        f"• ATmega328P, fixed point: {ours.mean():.2f}°",
        color=LIGHT.ours,
        loc="left",
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
    set_log(axes, "y", (0.3, 1, 3, 10, 30, 100))
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


def draw_probe_and_errors(
    figure: Figure, measured: dict[str, Any], made: Any, capture: Any
) -> None:
    """Draw the hand on the left and the recordings on the right."""
    left, right = figure.subplots(1, 2)
    draw_hand(left, made, capture)
    draw_errors(right, measured)


def load(name: str, how: str) -> dict[str, Any]:
    """Read a benchmark's JSON; raises RunFailed if it is absent."""
    path = RESULTS / name
    if not path.exists():
        raise RunFailed(f"{path.relative_to(PROJECT)} is missing; run {how}")
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def draw_of(name: str) -> Callable[[Figure], None]:
    """A function that draws the named picture, with its data loaded."""
    measured = load("recordings.json", "`make bench`")["data"]
    if name == "time":
        return partial(draw_time, measured=measured)
    made = sensors.generate(HAND_SECONDS, HAND_SEED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hand.npz"
        made.save(path)
        capture = run(NANO, path)
    return partial(draw_probe_and_errors, measured=measured, made=made, capture=capture)


HEIGHTS = {"probe": 4.2, "time": 3.4}


def main(argv: Sequence[str] | None = None) -> int:
    """Draw each picture."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: benchmarks/pictures/results.py time",
    )
    parser.add_argument(
        "names",
        metavar="PICTURE",
        nargs="*",
        help=f"of {', '.join(HEIGHTS)} (default: all)",
    )
    args = parser.parse_args(argv)
    unknown = [name for name in args.names if name not in HEIGHTS]
    if unknown:
        parser.error(f"there is no picture {unknown[0]}")
    for name in args.names or HEIGHTS:
        draw = draw_of(name)
        figure = blank(WIDTH, HEIGHTS[name])
        draw(figure)
        save(figure, PICTURES / f"{name}.svg")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"picture: {error}")
