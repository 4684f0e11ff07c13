# SPDX-License-Identifier: MIT
"""Draws docs/pictures/*.svg: the image's poses in a hand, and its errors beside VQF.

The left half is a virtual Nano moved by the hand of imud.motion, the right half what
benchmarks/accuracy.py has measured.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import scoring
from capture import Capture, RunFailed, run_nano
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from imud import motion, rotation
from imud.errors import ImudError
from imud.motion import Motion
from imud.rotation import FloatArray

PICTURES = scoring.PROJECT / "docs" / "pictures"
MEASURED = scoring.PROJECT / "build" / "benchmarks" / "accuracy.json"

HAND_SEED = 10
HAND_SECONDS = 40.0
PROBES = 4  # drawn on strokes that lie well apart

PROBE_M = 0.12  # from tip to sensor
BOARD_M = np.array([[-0.03, -0.012], [0.03, -0.012], [0.03, 0.012], [-0.03, 0.012]])


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours that read well on GitHub's light or dark page."""

    name: str
    ink: str
    faint: str
    ours: str
    other: str


THEMES = (
    Theme("light", "#1f2328", "#d0d7de", "#0969da", "#9a6700"),
    Theme("dark", "#e6edf3", "#3d444d", "#58a6ff", "#d29922"),
)


def seen(point: FloatArray) -> FloatArray:
    """World to paper: from the south-east, 35 degrees above the table."""
    turn, rise = np.radians(-30.0), np.radians(35.0)
    x, y, z = np.moveaxis(point, -1, 0)
    right = x * np.cos(turn) - y * np.sin(turn)
    away = x * np.sin(turn) + y * np.cos(turn)
    return np.stack([right, away * np.sin(rise) + z * np.cos(rise)], axis=-1)


def strokes(made: Motion) -> list[slice]:
    """The stretches in which the tip runs along the surface."""
    if made.is_stroke is None:
        return []
    edges = np.flatnonzero(np.diff(np.r_[0, made.is_stroke.astype(int), 0]))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def spread(records: list[int], tip: FloatArray) -> list[int]:
    """Some of the records, the next always the farthest from those there are."""
    chosen = [records[0]]
    while len(chosen) < min(PROBES, len(records)):
        gaps = [
            min(float(np.linalg.norm(tip[each] - tip[other])) for other in chosen)
            for each in records
        ]
        chosen.append(records[int(np.argmax(gaps))])
    # From the back to the front, so that near ones cover far ones.
    return sorted(chosen, key=lambda each: -float(seen(tip[each])[1]))


def draw_probe(axes: Axes, tip: FloatArray, quat: FloatArray, theme: Theme) -> None:
    """A stick with its board, as the quaternion has it."""
    sensor = tip - rotation.rotate(quat, np.array([PROBE_M, 0.0, 0.0]))
    stick = seen(np.stack([tip, sensor]))
    axes.plot(*stick.T, color=theme.ink, lw=2.4, solid_capstyle="round", zorder=4)
    corners = np.column_stack([BOARD_M, np.zeros(len(BOARD_M))])
    board = seen(sensor + rotation.rotate(quat, corners))
    axes.fill(*board.T, facecolor=theme.ours, edgecolor=theme.ink, lw=0.8, zorder=5)


def draw_hand(axes: Axes, made: Motion, capture: Capture, theme: Theme) -> None:
    """The table, the strokes on it, and probes in the poses that the image gave."""
    if made.tip is None:
        return
    side = np.linspace(-0.16, 0.16, 9)
    for at in side:
        for line in ([[at, -0.16, 0], [at, 0.16, 0]], [[-0.16, at, 0], [0.16, at, 0]]):
            axes.plot(*seen(np.array(line)).T, color=theme.faint, lw=0.6, zorder=1)
    stretches = strokes(made)
    for stretch in stretches:
        path = seen(made.tip[stretch])
        axes.plot(*path.T, color=theme.other, lw=2.4, solid_capstyle="round", zorder=2)
    middles = [(each.start + each.stop) // 2 for each in stretches]
    for middle in spread(middles, made.tip):
        at = int(np.searchsorted(capture.pose_times_s, middle / made.rate_hz))
        pose = min(at, len(capture.poses) - 1)
        draw_probe(axes, made.tip[middle], capture.poses[pose], theme)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title("a hand draws; the probes lie as the image says", color=theme.ink)


def draw_errors(axes: Axes, measured: dict[str, Any], theme: Theme) -> None:
    """A line a recording, from our error to VQF's."""
    trials = measured["trials"]
    rows = np.arange(len(trials))[::-1]
    ours, other = (
        np.array([trial["scores_deg"][name]["total"] for trial in trials])
        for name in ("nano", "vqf")
    )
    axes.hlines(rows, ours, other, color=theme.faint, lw=2.0, zorder=1)
    axes.scatter(other, rows, s=26, color=theme.other, zorder=2)
    axes.scatter(ours, rows, s=26, color=theme.ours, zorder=3)
    names = [trial["trial"].replace("_", " ") for trial in trials]
    axes.set_yticks(rows, names, fontsize=6.5, color=theme.ink)
    axes.set_xlim(0.0, None)
    axes.set_xlabel("orientation error, degrees rms", color=theme.ink)
    axes.tick_params(colors=theme.ink, length=0)
    axes.grid(axis="x", color=theme.faint, lw=0.6)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(
        f"$\\bullet$ ATmega328P, fixed point: {ours.mean():.2f}°",
        color=theme.ours,
        loc="left",
    )
    axes.set_title(
        f"$\\bullet$ VQF, doubles: {other.mean():.2f}°", color=theme.other, loc="right"
    )


def main() -> int:
    """Runs the hand, reads the scores, draws for both kinds of page."""
    if not MEASURED.exists():
        print(
            "no picture: benchmarks/accuracy.py has to measure first", file=sys.stderr
        )
        return 1
    measured = json.loads(MEASURED.read_text())
    made = motion.generate(HAND_SECONDS, HAND_SEED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hand.npz"
        made.save(path)
        capture = run_nano(path)
    # Text stays text, and the same figures give the same file.
    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "imu-probe"})
    mpl.rcParams.update({"font.family": "sans-serif"})
    mpl.rcParams.update({"font.size": 9.0, "axes.titlesize": 9.0})
    PICTURES.mkdir(parents=True, exist_ok=True)
    for theme in THEMES:
        figure, (left, right) = plt.subplots(
            1, 2, figsize=(10.0, 4.2), width_ratios=(1.0, 1.0), layout="constrained"
        )
        draw_hand(left, made, capture, theme)
        draw_errors(right, measured, theme)
        target = PICTURES / f"probe-{theme.name}.svg"
        figure.savefig(target, transparent=True, metadata={"Date": None})
        plt.close(figure)
        print(target.relative_to(scoring.PROJECT))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"picture: {error}")
