# SPDX-License-Identifier: MIT
"""The data of one probe over time, from poses, raw samples or a motion; and several
probes brought to common times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from imud import rotation
from imud.rotation import FloatArray

BoolArray = npt.NDArray[np.bool_]

# A stretch without poses longer than this is missing, not interpolated.
GAP_S = 0.15
# A probe that was silent for longer may have restarted: its heading may be another.
AWAY_S = 3.0


@dataclass(frozen=True, slots=True)
class Track:
    """One probe over time. Arrays of n rows; NaN where a value is missing.

    `quat` is world_from_probe, world east-north-up, of the probe's own heading.
    `gyr` (rad/s) and `acc` (specific force, m/s2) are in the probe's frame.
    """

    times_s: FloatArray
    quat: FloatArray
    gyr: FloatArray
    tilt_sigma: FloatArray  # rad
    heading_sigma: FloatArray  # rad; NaN: the heading has no reference
    acc: FloatArray | None = None

    def between(self, start_s: float, end_s: float) -> Track:
        """The rows with start_s <= time < end_s."""
        return self.rows((self.times_s >= start_s) & (self.times_s < end_s))

    def rows(self, rows: BoolArray) -> Track:
        """Some of the rows."""
        return Track(
            self.times_s[rows],
            self.quat[rows],
            self.gyr[rows],
            self.tilt_sigma[rows],
            self.heading_sigma[rows],
            None if self.acc is None else self.acc[rows],
        )

    def since(self, start_s: float) -> Track:
        """The same with times that begin there."""
        return replace(self, times_s=self.times_s - self.times_s[0] + start_s)


def nothing(times_s: FloatArray) -> Track:
    """The track of a probe that is missing."""
    none = np.full(len(times_s), np.nan)
    return Track(
        times_s,
        np.full((len(times_s), 4), np.nan),
        np.full((len(times_s), 3), np.nan),
        none,
        none,
    )


def of_poses(
    times_s: FloatArray,
    quat: FloatArray,
    tilt_sigma: FloatArray,
    heading_sigma: FloatArray,
) -> Track:
    """A track of poses alone: rates from the turn between neighbours, no forces."""
    step = rotation.multiply(rotation.inverse(quat[:-1]), quat[1:])
    rate = rotation.to_rotation_vector(step) / np.diff(times_s)[:, None]
    # At a pose: the mean of the turns before and after it.
    before = np.concatenate([rate[:1], rate])
    after = np.concatenate([rate, rate[-1:]])
    return Track(times_s, quat, (before + after) / 2.0, tilt_sigma, heading_sigma)


def slides(track: Track) -> FloatArray:
    """By how much the heading of a probe's own filter has slid since the first row,
    beyond the turn of its rates: rad, (n,). A filter slides while it learns the
    field of a place.
    """
    step_s = np.diff(track.times_s)[:, None]
    rates = (track.gyr[1:] + track.gyr[:-1]) / 2.0
    turned = rotation.multiply(
        track.quat[:-1], rotation.from_rotation_vector(rates * step_s)
    )
    off = rotation.multiply(track.quat[1:], rotation.inverse(turned))
    about_up = np.nan_to_num(rotation.to_rotation_vector(off)[:, 2])
    return np.concatenate([[0.0], np.cumsum(about_up)])


def turning(track: Track) -> FloatArray:
    """The turn rate at each moment, rad/s; of poses alone the rate across the vertical:
    a filter that corrects its heading turns them about it.
    """
    if track.acc is not None:
        return np.asarray(np.linalg.norm(track.gyr, axis=1))
    rates = rotation.rotate(track.quat, track.gyr)
    return np.asarray(np.hypot(rates[:, 0], rates[:, 1]))


def common_times(tracks: Sequence[Track], rate_hz: float) -> FloatArray:
    """Times at a constant rate over the span that every track covers."""
    start = max(float(each.times_s[0]) for each in tracks)
    end = min(float(each.times_s[-1]) for each in tracks)
    return start + np.arange(max(0, int((end - start) * rate_hz) + 1)) / rate_hz


def joined(track: Track, times_s: FloatArray, gap_s: float = GAP_S) -> Track:
    """The track at other times: interpolated, NaN outside and inside gaps."""
    known = track.times_s
    quat = rotation.interpolate(times_s, known, track.quat)
    after = np.clip(np.searchsorted(known, times_s), 1, len(known) - 1)
    is_far = known[after] - known[after - 1] > gap_s
    is_missing = is_far | ~np.isfinite(quat).all(axis=1)
    quat[is_missing] = np.nan

    def rows(values: FloatArray) -> FloatArray:
        columns = [np.interp(times_s, known, column) for column in values.T]
        found = np.stack(columns, axis=1)
        found[is_missing] = np.nan
        return found

    sigmas = rows(np.stack([track.tilt_sigma, track.heading_sigma], axis=1))
    acc = None if track.acc is None else rows(track.acc)
    return Track(times_s, quat, rows(track.gyr), sigmas[:, 0], sigmas[:, 1], acc)
