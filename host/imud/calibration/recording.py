# SPDX-License-Identifier: MIT
"""The readings that a calibration works on: raw samples gathered at about 100 Hz."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import msgspec
import numpy as np
import numpy.typing as npt

from imud.rotation import FloatArray

RATE_HZ = 100.0  # of a recording, at least: samples are averaged down towards it
GAP_S = 0.1  # samples missing for no longer than this are interpolated
COUNT_MAX = 32767  # of a reading: 16 bits

Counts = tuple[int, int, int]
IntArray = npt.NDArray[np.intp]


class Scale(msgspec.Struct, frozen=True):
    """The value of one count of each sensor, and the number of samples a second.
    `is_sparse`: they are not all that the sensor made.
    """

    acc_m_s2: float
    gyr_rad_s: float
    mag_ut: float
    rate_hz: float
    is_sparse: bool = False


class Sample(msgspec.Struct, frozen=True):
    """One raw sample in counts; `mag` is None where the magnetometer had nothing new.

    `is_clipped`: the probe reports that a sensor reached the end of its range.
    """

    t_us: int  # device time, unrolled
    acc: Counts
    gyr: Counts
    mag: Counts | None = None
    temperature_c: float | None = None
    is_clipped: bool = False


@dataclass(frozen=True, slots=True)
class SensorRecording:
    """Readings at a constant rate in nominal units, which are counts times the value of
    a count. Vectors have the shape (n, 3) and are in the body frame.
    """

    step_s: float
    acc: FloatArray  # m/s2
    gyr: FloatArray  # rad/s, mean over the step
    mag: FloatArray  # uT; NaN where there was no reading in that step
    mag_late_s: FloatArray  # (n,) the reading's time since the beginning of its step
    breaks: tuple[int, ...] = ()  # steps before which samples are missing
    temperature_c: float | None = None  # mean of the die

    def __len__(self) -> int:
        return len(self.acc)

    @property
    def seconds(self) -> float:
        """Its duration without missing samples."""
        return len(self) * self.step_s

    @property
    def mag_early_s(self) -> float:
        """How long before the ends of their steps the magnetometer's readings are."""
        late_s = self.mag_late_s[np.isfinite(self.mag[:, 0])]
        return self.step_s - float(late_s.mean()) if len(late_s) else 0.0

    def is_whole(self, start: int, end: int) -> bool:
        """Whether no samples are missing between two steps."""
        return not any(start < at <= end for at in self.breaks)

    def since(self, start: int) -> SensorRecording:
        """The steps from `start` on."""
        return replace(
            self,
            acc=self.acc[start:],
            gyr=self.gyr[start:],
            mag=self.mag[start:],
            mag_late_s=self.mag_late_s[start:],
            breaks=tuple(at - start for at in self.breaks if at > start),
        )


# Columns of a gatherer's rows: sums of counts, the magnetometer's, how late it came.
ACC, GYR, MAG, LATE, COLUMNS = slice(3), slice(3, 6), slice(6, 9), 9, 10


class Gatherer:
    """Collects samples into a recording of `rate_hz` at least, if they come so fast."""

    def __init__(self, scale: Scale, rate_hz: float = RATE_HZ) -> None:
        self.scale = scale
        self._per_step = max(1, math.floor(scale.rate_hz / rate_hz + 0.05))
        self._last: Sample | None = None
        self._rows = np.empty((1024, COLUMNS))
        self._count = 0  # steps that are whole
        self._in_step = 0  # samples of the step under way
        self._breaks: list[int] = []
        self._warmth_sum, self._warmth_count = 0.0, 0
        self._ticks = 0  # periods over which `_elapsed_us` was measured
        self._elapsed_us = 0
        self.clipped = 0  # samples that a sensor clipped
        self._samples = 0

    def __len__(self) -> int:
        """Steps so far."""
        return self._count

    @property
    def step_s(self) -> float:
        """The mean length of a step by the device's clock."""
        period_s = 1.0 / self.scale.rate_hz
        if self._ticks:
            period_s = self._elapsed_us / self._ticks / 1e6
        return self._per_step * period_s

    def add(self, sample: Sample) -> None:
        """Takes the next sample. Older or repeated ones are left out."""
        last = self._last
        if last is not None:
            if sample.t_us <= last.t_us:
                return
            elapsed_us = sample.t_us - last.t_us
            if elapsed_us > GAP_S * 1e6:
                self._breaks.append(self._count)
                self._in_step = 0
            else:
                ticks = max(1, round(elapsed_us * self.scale.rate_hz / 1e6))
                self._ticks += ticks
                self._elapsed_us += elapsed_us
                for between in _between(last, sample, ticks):
                    self._put(between)
        self._last = sample
        self._put(sample)
        if sample.temperature_c is not None:
            self._warmth_sum += sample.temperature_c
            self._warmth_count += 1
        self._samples += 1
        self.clipped += is_clipped(sample)

    def turn(self, matrix: FloatArray) -> None:
        """Turns all readings so far into other axes."""
        for part in (ACC, GYR, MAG):
            self._rows[:, part] = self._rows[:, part] @ matrix.T

    def _put(self, sample: Sample) -> None:
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        row = self._rows[self._count]
        if self._in_step == 0:
            row[:] = 0.0
            row[MAG] = math.nan
        row[ACC] += sample.acc
        row[GYR] += sample.gyr
        self._in_step += 1
        if sample.mag is not None:
            row[MAG], row[LATE] = sample.mag, self._in_step
        if self._in_step == self._per_step:
            self._count += 1
            self._in_step = 0

    @property
    def clipped_share(self) -> float:
        """The share of samples in which a sensor was at the end of its range."""
        return self.clipped / max(1, self._samples)

    def recording(self) -> SensorRecording:
        """All steps so far."""
        rows = self._rows[: self._count]
        warmth = self._warmth_sum / self._warmth_count if self._warmth_count else None
        return SensorRecording(
            self.step_s,
            rows[:, ACC] * (self.scale.acc_m_s2 / self._per_step),
            rows[:, GYR] * (self.scale.gyr_rad_s / self._per_step),
            rows[:, MAG] * self.scale.mag_ut,
            rows[:, LATE] * (self.step_s / self._per_step),
            tuple(self._breaks),
            warmth,
        )

    @classmethod
    def of(cls, scale: Scale, samples: Iterable[Sample]) -> Self:
        """A gatherer with all of these samples."""
        made = cls(scale)
        for sample in samples:
            made.add(sample)
        return made


def is_clipped(sample: Sample) -> bool:
    """Whether a sensor was at the end of its range."""
    return sample.is_clipped or max(map(abs, (*sample.acc, *sample.gyr))) >= COUNT_MAX


def _between(last: Sample, sample: Sample, ticks: int) -> Iterator[Sample]:
    """The samples that are missing between two, along a straight line."""
    for tick in range(1, ticks):
        share = tick / ticks

        def along(start: Counts, end: Counts, share: float = share) -> Counts:
            x, y, z = (
                round(a + share * (b - a)) for a, b in zip(start, end, strict=True)
            )
            return x, y, z

        yield Sample(0, along(last.acc, sample.acc), along(last.gyr, sample.gyr))
