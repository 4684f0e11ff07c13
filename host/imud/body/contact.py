# SPDX-License-Identifier: MIT
"""When a foot rests on the ground, and its path in the world between the rests.

Between two rests the velocity is integrated; what it has left at the second rest is
taken out evenly over the time (zero velocity update: E. Foxlin, IEEE Computer Graphics
25(6):38, 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.body.tracks import Track
from imud.rotation import FloatArray

GRAVITY_M_S2 = 9.80665
RATE_MAX = math.radians(40.0)  # of a foot that rests
FORCE_MAX_M_S2 = 1.5  # by which the force differs from gravity
REST_S = 0.12
SWING_S = 0.15  # a shorter pause between rests is none


@dataclass(frozen=True, slots=True)
class FootPath:
    """A foot's path. `rests`: first and last row of each rest. `strides`: m, level
    distance from rest to rest.
    """

    times_s: FloatArray
    place: FloatArray  # m, world axes, from its first rest
    rests: tuple[tuple[int, int], ...]
    strides: FloatArray


def rests(track: Track) -> tuple[tuple[int, int], ...]:
    """First and last row of each rest, from rates, and forces where there are any."""
    is_calm = np.linalg.norm(track.gyr, axis=1) < RATE_MAX
    if track.acc is not None:
        off = np.abs(np.linalg.norm(track.acc, axis=1) - GRAVITY_M_S2)
        is_calm &= off < FORCE_MAX_M_S2
    edges = np.flatnonzero(
        np.diff(np.concatenate([[False], is_calm, [False]]).astype(int))
    )
    spans: list[tuple[int, int]] = []
    times = track.times_s
    for start, end in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        if spans and times[start] - times[spans[-1][1]] < SWING_S:
            spans[-1] = spans[-1][0], end
        else:
            spans.append((start, end))
    return tuple(each for each in spans if times[each[1]] - times[each[0]] >= REST_S)


def path(track: Track) -> FootPath:
    """The path of a foot's probe, from poses and forces. ValueError without forces.

    Between the rests it is known; before the first and after the last it is NaN.
    """
    if track.acc is None:
        raise ValueError(
            "the path of a foot needs forces: raw samples, not poses alone"
        )
    found = rests(track)
    place = np.full((len(track.times_s), 3), np.nan)
    ends = []
    force = rotation.rotate(track.quat, track.acc)
    force[:, 2] -= GRAVITY_M_S2
    here = np.zeros(3)
    for index, (first, last) in enumerate(found):
        place[first : last + 1] = here
        ends.append(here)
        if index + 1 < len(found):
            rows = slice(last, found[index + 1][0] + 1)
            place[rows] = here + swing(track.times_s[rows], force[rows])
            here = place[found[index + 1][0]]
    steps = np.diff(np.array(ends).reshape(-1, 3), axis=0)
    return FootPath(track.times_s, place, found, np.linalg.norm(steps[:, :2], axis=1))


def swing(times_s: FloatArray, force: FloatArray) -> FloatArray:
    """The way from rest to rest, m; `force` in m/s2 without gravity, world."""
    step = np.diff(times_s)[:, None]
    none = np.zeros((1, 3))
    speed = np.concatenate(
        [none, np.cumsum((force[1:] + force[:-1]) / 2.0 * step, axis=0)]
    )
    share = (times_s - times_s[0]) / (times_s[-1] - times_s[0])
    speed = speed - share[:, None] * speed[-1]
    way = np.cumsum((speed[1:] + speed[:-1]) / 2.0 * step, axis=0)
    return np.concatenate([none, way])
