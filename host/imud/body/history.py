# SPDX-License-Identifier: MIT
"""The recent poses and samples of one probe of a live body, by UTC."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imud.body import tracks
from imud.body.tracks import GAP_S, Track
from imud.rotation import FloatArray

UNSETTLED = np.radians(10.0)  # tilt of a filter that has not settled
RAW_GAP_S = 0.05  # samples are interpolated over no more
# A look at so many moments finds the gyroscope's bias.
BIAS_ROWS = 100


@dataclass(slots=True)
class ProbeHistory:
    """The poses and samples of one probe; older ones than `kept_s` are dropped."""

    kept_s: float
    poses: deque[tuple[float, ...]] = field(default_factory=deque)
    raws: deque[tuple[float, ...]] = field(default_factory=deque)
    bound_us: int | None = None
    is_dated: bool = True  # the UTC of its last pose is known
    turned_s: float = math.inf  # since when its heading may be another
    _device_us: int = 0
    _flags: frozenset[str] = frozenset()
    bias_rad_s: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def last_s(self) -> float | None:
        return self.poses[-1][0] if self.poses else None

    def has(self, time_s: float) -> bool:
        """Whether its attitude at that time is known."""
        later_s = math.inf
        for row in reversed(self.poses):
            if row[0] <= time_s:
                return row[0] == time_s or later_s - row[0] <= GAP_S
            later_s = row[0]
        return False

    def look(self, time_s: float, device_us: int, flags: Sequence[str]) -> None:
        """Whether it has restarted, or got an origin or lost one, before the pose of
        that time, the device's time, and flags.
        """
        now = frozenset(flags) & {"starting", "tared"}
        changed = now ^ self._flags
        is_new = "tared" in changed or "starting" in changed & now
        if self.poses and (is_new or device_us < self._device_us):
            self.turned_s = min(self.turned_s, time_s)
        self._device_us, self._flags = device_us, now

    def add_pose(
        self,
        time_s: float,
        quat: tuple[float, float, float, float],
        sigmas: tuple[float, float],
    ) -> None:
        """A pose; `sigmas` of tilt and heading in rad, NaN: not known. One that is not
        later than the last is left out.
        """
        tilt, heading = sigmas
        tilt = UNSETTLED if tilt != tilt else tilt
        _append(self.poses, (time_s, *quat, tilt, heading), self.kept_s)

    def add_raw(
        self,
        time_s: float,
        gyr: tuple[float, float, float],
        acc: tuple[float, float, float],
        flags: Sequence[str] = (),
    ) -> None:
        """A rate, rad/s, and a specific force, m/s2, in the probe's frame."""
        clipped = ("gyr_clipped" in flags, "acc_clipped" in flags)
        _append(self.raws, (time_s, *gyr, *acc, *clipped), self.kept_s)

    def samples(self, after_s: float, until_s: float) -> FloatArray:
        """The samples then, rows of time, rates without bias, forces, and whether each
        of both is clipped: (n, 9).
        """
        found = []
        for row in reversed(self.raws):
            if row[0] <= after_s:
                break
            if row[0] <= until_s:
                found.append(row)
        rows = np.array(found[::-1]).reshape(-1, 9)
        rows[:, 1:4] -= self.bias_rad_s
        return rows

    def track(self, times_s: FloatArray, gap_s: float = GAP_S) -> Track | None:
        """Its track at rising times; None if there are no poses near them. A gap of
        more than `gap_s` is missing.
        """
        rows = _near(self.poses, times_s, gap_s)
        if len(rows) < 2:
            return None
        made = tracks.of_poses(rows[:, 0], rows[:, 1:5], rows[:, 5], rows[:, 6])
        found = tracks.joined(made, times_s, gap_s)
        raws = _near(self.raws, times_s, RAW_GAP_S)
        if len(raws) < 2:
            return found
        is_far = (times_s < raws[0, 0]) | (times_s > raws[-1, 0])
        after = np.clip(np.searchsorted(raws[:, 0], times_s), 1, len(raws) - 1)
        is_far |= raws[after, 0] - raws[after - 1, 0] > RAW_GAP_S
        columns = [np.interp(times_s, raws[:, 0], each) for each in raws[:, 1:7].T]
        values = np.stack(columns, axis=1)
        values[is_far] = np.nan
        if is_far.all():
            return found
        # Poses turn, too, where a filter corrects its heading: their rates are right in
        # the median only, which shows the bias.
        off = values[:, :3] - found.gyr
        off = off[np.isfinite(off).all(axis=1)]
        if len(off) >= BIAS_ROWS:
            self.bias_rad_s = np.median(off, axis=0)
        rates = values[:, :3] - self.bias_rad_s
        gyr = np.where(is_far[:, None], found.gyr, rates)
        return replace(found, gyr=gyr, acc=values[:, 3:])


def _append(
    rows: deque[tuple[float, ...]], row: tuple[float, ...], kept_s: float
) -> None:
    if rows and row[0] <= rows[-1][0]:
        return
    rows.append(row)
    while row[0] - rows[0][0] > kept_s:
        rows.popleft()


def _near(
    rows: deque[tuple[float, ...]], times_s: FloatArray, margin_s: float
) -> FloatArray:
    """The rows from `margin_s` before the first time to as long after the last."""
    first, last = times_s[0] - margin_s, times_s[-1] + margin_s
    found = []
    for row in reversed(rows):
        if row[0] < first:
            break
        if row[0] <= last:
            found.append(row)
    return np.array(found[::-1])
