# SPDX-License-Identifier: MIT
"""The closed form of a stroke in doubles, from the equations of stroke.h: what the
fixed point is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from core.desk import DEGREE, Array, G

WINDOW_S = 0.1
BIAS = 0.01 * DEGREE  # rad/s, the least that is stated
NOISE = 0.02**2  # (m/s2)^2, of a window about all axes, the least
TURN_LEVEL = 1661000 / 2**30 / 8  # (m/s2)^2 a rad2, of a calibrated module
TURN_UP = 878000 / 2**30 / 8


@dataclass
class Way:
    """A displacement in the world, m, and its sigmas of a horizontal axis and up."""

    moved: Array
    horizontal: float
    vertical: float


def share(tilt: float, rest: float) -> float:
    return tilt / (tilt + rest)


def rest_of(force: Array) -> Array:
    """The mean force of a rest, of whose last windows the later count more."""
    mean = force[0]
    for number, row in enumerate(force[1:], 2):
        mean = mean + (row - mean) / min(number, 4)
    return mean


def is_calm(force: Array, rest: Array) -> bool:
    """Whether the force of a window differs from that of a rest by no more than noise
    explains.
    """
    return float(np.sum((force - rest) ** 2)) < 4 * NOISE


def late_mean(force: Array) -> Array:
    """Of the rest behind a stroke, its last three windows."""
    return np.asarray((force[-3] + 2 * force[-2] + force[-1]) / 4)


def closed(
    f0: Array, force: Array, gained: Array, angle: float, *, left_out: int = 0
) -> Way:
    """Of a stroke in a level frame after a rest of force `f0`: rows of windows, the
    first the last of the rest, the last three those of the rest behind it, and
    `left_out` before them that are of that rest too. `force`: their mean, m/s2;
    `gained`: twice the mean velocity gained in a window, as a force. `angle`: turned in
    it, rad.
    """
    f1, behind = late_mean(force), len(force) - 3 - left_out
    inner = force[1:behind] - f0
    count = len(inner)
    velocity = (force[0] - f0) - (gained[0] - f0) / 2
    way = np.zeros(3)
    for row, more in zip(inner, gained[1:behind] - f0, strict=True):
        way = way + 2 * velocity + more
        velocity = velocity + row
    end = velocity + (gained[behind] - f0) / 2
    rest = NOISE * (0.375 + 0.15) / 3
    miss = 8 * (1 - np.cos(angle / 2))
    tilt = (G * BIAS / 2 * WINDOW_S * count) ** 2 + TURN_LEVEL * miss
    keep = np.array([share(tilt, rest)] * 2 + [share(TURN_UP * miss, rest)])
    pairs = (count + 1) * (count + 2)
    sums = way - count * end + keep * (f1 - f0) * pairs / 6
    moved = sums * WINDOW_S**2 / 2
    noise = NOISE / 3 * WINDOW_S**4 * count**3 / 12
    uneven = np.array([TURN_LEVEL * miss / 11] * 2 + [0.0])
    grown = (keep * rest + uneven) * (WINDOW_S**2 * pairs / 12) ** 2
    length = np.sum((0.001 * moved) ** 2) + 0.0003**2
    tipped = 0.4 * DEGREE
    level = noise + grown[0] + length + (tipped * moved[2]) ** 2
    up = noise + grown[2] + length + (tipped * np.hypot(*moved[:2])) ** 2
    return Way(moved, np.sqrt(level), np.sqrt(up))
