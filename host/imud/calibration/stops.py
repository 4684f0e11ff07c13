# SPDX-License-Identifier: MIT
"""The rests of a probe in a recording."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from imud.calibration.recording import SensorRecording
from imud.rotation import FloatArray

BLOCK_S = 0.25
SHORTEST = 3  # blocks of a stop

# A block is still if all of these are smaller. Noise of an MPU-9250 averaged down to
# 100 Hz: 0.1 deg/s and 0.1 m/s2 over three axes; a hand's tremor is many times that.
RATE_RAD_S = math.radians(1.0)  # its mean rate, but for the bias
SHAKING_RAD_S = math.radians(0.6)  # standard deviation of the rate
SHAKING_M_S2 = 0.2  # standard deviation of the force
QUIETEST = 4  # blocks whose mean rate is the bias


@dataclass(frozen=True, slots=True)
class StaticInterval:
    """Steps of a recording from `start` up to but without `end`."""

    start: int
    end: int

    def __len__(self) -> int:
        return self.end - self.start

    @property
    def middle(self) -> int:
        """The step in its middle."""
        return (self.start + self.end) // 2


@dataclass(frozen=True, slots=True)
class Blocks:
    """A recording in pieces of BLOCK_S."""

    size: int  # steps of a block
    is_still: FloatArray  # 1.0 or 0.0, one for each block

    @classmethod
    def of(cls, recording: SensorRecording) -> Blocks:
        """Finds the still blocks of a recording."""
        size = max(2, round(BLOCK_S / recording.step_s))
        count = len(recording) // size
        if count == 0:
            return cls(size, np.zeros(0))
        gyr = recording.gyr[: count * size].reshape(count, size, 3)
        acc = recording.acc[: count * size].reshape(count, size, 3)
        rate = gyr.mean(axis=1)
        gyr_shake = np.linalg.norm(gyr.std(axis=1), axis=1)
        acc_shake = np.linalg.norm(acc.std(axis=1), axis=1)
        quiet = np.argsort(gyr_shake + 0.1 * acc_shake)[:QUIETEST]
        bias = np.median(rate[quiet], axis=0)
        is_still = (
            (np.linalg.norm(rate - bias, axis=1) < RATE_RAD_S)
            & (gyr_shake < SHAKING_RAD_S)
            & (acc_shake < SHAKING_M_S2)
        )
        for at in recording.breaks:
            if at // size < count:
                is_still[at // size] = False
        return cls(size, is_still.astype(float))

    def stops(self) -> list[StaticInterval]:
        """Runs of SHORTEST still blocks or more."""
        edges = np.flatnonzero(np.diff(self.is_still, prepend=0.0, append=0.0))
        return [
            StaticInterval(int(start) * self.size, int(end) * self.size)
            for start, end in zip(edges[::2], edges[1::2], strict=True)
            if end - start >= SHORTEST
        ]


def find_stops(recording: SensorRecording) -> list[StaticInterval]:
    """The stretches of a recording in which the probe lay still, in order."""
    return Blocks.of(recording).stops()


def lasting(
    stops: Iterable[StaticInterval], recording: SensorRecording, seconds: float
) -> list[StaticInterval]:
    """Those of at least this duration, less half a block."""
    least = seconds - BLOCK_S / 2
    return [each for each in stops if len(each) * recording.step_s >= least]
