# SPDX-License-Identifier: MIT
"""The closed form of a stroke in doubles, from the equations of stroke.h: what the
fixed point is compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from core.desk import DEGREE, Array, G

WINDOW_S = 0.1
BIAS = 0.01 * DEGREE  # rad/s, the least that is stated
NOISE = 0.005**2  # (m/s2)^2, of a window about all axes, the least for gates
WALK = math.radians(0.005) ** 2 / 2  # rad2/s, of the gyroscope
HAND_M = 0.3
SWAY_MAX = 2.109e-5  # (rad/s)^2
LEAN = 0.05 * DEGREE  # of the force of a rest, the least


@dataclass
class Known:
    """What a stroke knows beside its windows: sigmas of the params, m/s2 and a
    fraction; the noise of windows about all axes, (m/s2)^2, and the least of it; the
    square rate of rests and at both ends, (rad/s)^2 about all axes.
    """

    acc: float
    gyr: float
    noise: float = NOISE
    quiet: float = NOISE
    sway: float = 0.0
    ends: float = 0.0


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


def is_calm(force: Array, rest: Array, noise: float) -> bool:
    """Whether the force of a window differs from that of a rest by no more than noise
    explains.
    """
    return float(np.sum((force - rest) ** 2)) < 4 * max(noise, NOISE)


def upright(f0: Array, moved: Array) -> Array:
    """Turned so that the force of a rest is vertical."""
    lean = np.array([f0[1], -f0[0], 0.0]) / G
    return np.asarray(moved + np.cross(lean, moved))


def late_mean(force: Array) -> Array:
    """Of the rest behind a stroke, its last three windows."""
    return np.asarray((force[-3] + 2 * force[-2] + force[-1]) / 4)


def closed(
    f0: Array,
    force: Array,
    gained: Array,
    angle: float,
    known: Known,
    *,
    left_out: int = 0,
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
    rest = max(known.noise, NOISE) * (0.375 + 0.15) / 3
    miss = 8 * (1 - np.cos(angle / 2))
    turned = ((G * known.gyr) ** 2 + known.acc**2) * miss
    turned_up = 1.25 * known.acc**2 * miss
    bias = max(BIAS**2, min(known.sway, SWAY_MAX) / 75)
    tilt = bias * (G / 2 * WINDOW_S * count) ** 2 + turned
    keep = np.array([share(tilt, rest)] * 2 + [share(turned_up, rest)])
    pairs = (count + 1) * (count + 2)
    sums = way - count * end + keep * (f1 - f0) * pairs / 6
    moved = upright(f0, sums * WINDOW_S**2 / 2)
    seconds = WINDOW_S * count
    noise = 1.25 * known.quiet / 3 * WINDOW_S**4 * count**3 / 12
    noise += (HAND_M * seconds) ** 2 * max(known.sway, known.ends) / 6
    uneven = np.array([turned / 11] * 2 + [turned_up / 14])
    grown = (keep * rest + uneven) * (WINDOW_S**2 * pairs / 12) ** 2
    walk = G**2 * WALK * seconds**5 / 720 * (6 - 5 * keep[0])
    length = np.sum((known.acc / G * moved) ** 2) + 0.0001**2
    tipped = max(known.acc / G, LEAN)
    level = noise + grown[0] + walk + length + (tipped * moved[2]) ** 2
    up = noise + grown[2] + length + (tipped * np.hypot(*moved[:2])) ** 2
    return Way(moved, np.sqrt(level), np.sqrt(up))
