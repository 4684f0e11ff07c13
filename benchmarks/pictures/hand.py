# SPDX-License-Identifier: MIT
"""The motion of a hand at a table, and probes in the poses that an image computed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from benchmarks.common.capture import Capture
from benchmarks.pictures.theme import LIGHT
from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.motion import Motion

PROBES = 4  # drawn on strokes that lie well apart

PROBE_M = 0.12  # from tip to sensor
BOARD_M = np.array([[-0.03, -0.012], [0.03, -0.012], [0.03, 0.012], [-0.03, 0.012]])


def seen(point: FloatArray) -> FloatArray:
    """Project world points to the page, seen from the south-east, 35 degrees up."""
    turn, rise = np.radians(-30.0), np.radians(35.0)
    x, y, z = np.moveaxis(point, -1, 0)
    right = x * np.cos(turn) - y * np.sin(turn)
    away = x * np.sin(turn) + y * np.cos(turn)
    return np.stack([right, away * np.sin(rise) + z * np.cos(rise)], axis=-1)


def strokes(made: Motion) -> list[slice]:
    """The intervals in which the tip runs along the surface."""
    if made.is_stroke is None:
        return []
    edges = np.flatnonzero(np.diff(np.r_[0, made.is_stroke.astype(int), 0]))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def spread(records: list[int], tip: FloatArray) -> list[int]:
    """Choose records, each the farthest from those already chosen."""
    chosen = [records[0]]
    while len(chosen) < min(PROBES, len(records)):
        gaps = [
            min(float(np.linalg.norm(tip[each] - tip[other])) for other in chosen)
            for each in records
        ]
        chosen.append(records[int(np.argmax(gaps))])
    # From back to front, so that near probes cover far ones.
    return sorted(chosen, key=lambda each: -float(seen(tip[each])[1]))


def draw_probe(axes: Axes, tip: FloatArray, quat: FloatArray) -> None:
    """Draw a stick with its board, turned by the quaternion."""
    sensor = tip - rotation.rotate(quat, np.array([PROBE_M, 0.0, 0.0]))
    stick = seen(np.stack([tip, sensor]))
    axes.plot(*stick.T, color=LIGHT.ink, lw=2.4, solid_capstyle="round", zorder=4)
    corners = np.column_stack([BOARD_M, np.zeros(len(BOARD_M))])
    board = seen(sensor + rotation.rotate(quat, corners))
    axes.fill(*board.T, facecolor=LIGHT.ours, edgecolor=LIGHT.ink, lw=0.8, zorder=5)


def draw_hand(axes: Axes, made: Motion, capture: Capture) -> None:
    """Draw the table, its strokes, and probes in the poses that the image computed."""
    if made.tip is None:
        return
    side = np.linspace(-0.16, 0.16, 9)
    for at in side:
        for line in ([[at, -0.16, 0], [at, 0.16, 0]], [[-0.16, at, 0], [0.16, at, 0]]):
            axes.plot(*seen(np.array(line)).T, color=LIGHT.faint, lw=0.6, zorder=1)
    stretches = strokes(made)
    for stretch in stretches:
        path = seen(made.tip[stretch])
        axes.plot(*path.T, color=LIGHT.other, lw=2.4, solid_capstyle="round", zorder=2)
    middles = [(each.start + each.stop) // 2 for each in stretches]
    for middle in spread(middles, made.tip):
        at = int(np.searchsorted(capture.pose_times_s, middle / made.rate_hz))
        pose = min(at, len(capture.poses) - 1)
        draw_probe(axes, made.tip[middle], capture.poses[pose])
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title("a hand draws; the probes lie as the image says", color=LIGHT.ink)
