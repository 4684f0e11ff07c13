# SPDX-License-Identifier: MIT
"""The intervals in which a recording lies still."""

from __future__ import annotations

import math

import numpy as np

from imud.refine.model import BoolArray, Recording
from imud.rotation import FloatArray

AROUND_S = 1.5  # an interval is at rest within so long a stretch of quiet
# The quietest parts tell a sensor's noise; without any rest they are slow motion, which
# these limits leave out: rad/s and m/s2.
GYR_LEAST, GYR_MOST = math.radians(0.3), math.radians(0.5)
ACC_LEAST, ACC_MOST = 0.08, 0.15
RATE_MOST = math.radians(5.0)  # a bias


def find_rests(recording: Recording) -> BoolArray:
    """Whether each interval is at rest."""
    around = max(3, round(AROUND_S / recording.node_s))
    if recording.count < around:
        return np.zeros(recording.count, bool)
    turning, rate = _spread(recording.by_node(recording.gyr), around)
    shaking, _ = _spread(recording.by_node(recording.acc), around)
    is_quiet = (
        (turning < np.clip(2.0 * np.percentile(turning, 3), GYR_LEAST, GYR_MOST))
        & (shaking < np.clip(2.0 * np.percentile(shaking, 3), ACC_LEAST, ACC_MOST))
        & (np.linalg.norm(rate, axis=1) < RATE_MOST)
        & ~recording.is_bad_node
    )
    return np.convolve(is_quiet, np.ones(around), "same") > around - 0.5


def stretches(is_rest: BoolArray) -> list[tuple[int, int]]:
    """The first interval of each rest, and the one after its last."""
    edges = np.diff(np.concatenate([[0], is_rest.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    return [*zip(starts.tolist(), ends.tolist(), strict=True)]


def _spread(nodes: FloatArray, around: int) -> tuple[FloatArray, FloatArray]:
    """The largest standard deviation of an axis around each node, and the means."""
    mean = smooth(nodes.mean(axis=1), around)
    square = smooth((nodes**2).mean(axis=1), around)
    return np.sqrt(np.maximum(square - mean**2, 0.0)).max(axis=1), mean


def smooth(rows: FloatArray, around: int) -> FloatArray:
    """Means of so many rows around each, held at the ends."""
    before = around // 2
    padded = np.pad(rows, ((before, around - 1 - before), (0, 0)), "edge")
    sums = np.cumsum(np.concatenate([np.zeros((1, rows.shape[1])), padded]), axis=0)
    return np.asarray((sums[around:] - sums[:-around]) / around)
