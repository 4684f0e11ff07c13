# SPDX-License-Identifier: MIT
"""Poses of samples that no probe fused, by the firmware's own C.

The C works at 100 samples a second and more: those of other rates are brought to 200 a
second, the field as well.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from imud import _core
from imud.body import level, tracks
from imud.body.tracks import Track
from imud.params.trusted import known_to
from imud.rotation import FloatArray
from imud.wire import messages, raws
from imud.wire.messages import Message

FUSED_HZ = 200  # as the Nano
COUNTS_MAX = 32000
# The coarsest counts that the C takes: rad/s, m/s2, uT.
LSB_MAX = (1.23e-3, 1.96e-2, 0.1575)
# One-sigma errors of calibrated samples: m/s2 and uT.
ACC_SIGMA, MAG_SIGMA = 0.02, 0.3
UNSETTLED = np.radians(10.0)  # tilt while the filter settles
Counts = npt.NDArray[Any]


def attitudes(
    times_s: FloatArray, gyr: FloatArray, acc: FloatArray, mag: FloatArray
) -> Track:
    """The track of samples at rising times: gyr rad/s, acc m/s2, mag uT, (n, 3) each;
    `mag` is NaN where there is no reading. ValueError below level.RATE_MIN_HZ.
    """
    rate_hz = 1.0 / float(np.median(np.diff(times_s)))
    if rate_hz < level.RATE_MIN_HZ * 0.99:
        raise ValueError(
            f"{rate_hz:g} samples a second are too few; {level.RATE_MIN_HZ:g} are "
            "needed"
        )
    count = int((times_s[-1] - times_s[0]) * FUSED_HZ) + 1
    at_s = times_s[0] + np.arange(count) / FUSED_HZ
    field = np.full((count, 3), np.nan)
    there = np.asarray(np.isfinite(mag).all(axis=1))
    if there.any():
        field = between(at_s, times_s[there], mag[there])
    rates, forces = (between(at_s, times_s, each) for each in (gyr, acc))
    rows = _poses(rates, forces, field)
    tilt, heading = np.radians(rows[:, 4:]).T
    tilt = np.where(np.isfinite(tilt), tilt, UNSETTLED)
    poses = Track(at_s, rows[:, :4], rates, tilt, heading)
    found = tracks.joined(poses, np.clip(times_s, at_s[0], at_s[-1]))
    bias = level.biases(gyr, acc, rate_hz)
    return replace(found, times_s=times_s, gyr=gyr - bias, acc=acc)


def between(at_s: FloatArray, times_s: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows at other times: interpolated, or means where more are known."""
    width = max(1, round(len(times_s) / len(at_s)))
    if width > 1:
        kept = np.pad(rows, ((width // 2, (width - 1) // 2), (0, 0)), mode="edge")
        sums = np.cumsum(np.pad(kept, ((1, 0), (0, 0))), axis=0)
        rows = (sums[width:] - sums[:-width]) / width
    return np.stack([np.interp(at_s, times_s, each) for each in rows.T], axis=1)


def _poses(gyr: FloatArray, acc: FloatArray, field: FloatArray) -> FloatArray:
    """Attitude, tilt's and heading's sigma (deg) after each sample of FUSED_HZ."""
    lsbs, counts = zip(*map(_counted, (gyr, acc, field), LSB_MAX), strict=True)
    rows = raws.blank(len(gyr))
    rows["time_us"] = np.arange(len(gyr)) * (10**6 // FUSED_HZ)
    is_new = ~np.isnan(field[:, 0])
    rows["gyr"], rows["acc"], rows["mag"][is_new] = *counts[:2], counts[2][is_new]
    replay = _core.Replay(hello(lsbs), known_to(ACC_SIGMA, MAG_SIGMA))
    poses = []
    for raw in rows:
        replay.step(raw.tobytes())
        poses.append(_pose(replay.pose(0, 0)))
    return np.array(poses)


def _counted(rows: FloatArray, lsb_max: float) -> tuple[float, Counts]:
    """The unit of a count, so that the largest value fits, and the counts."""
    largest = float(np.max(np.nan_to_num(np.abs(rows))))
    lsb = round(min(lsb_max, max(largest, 1e-2) / COUNTS_MAX), 9)
    counts = np.clip(np.rint(np.nan_to_num(rows) / lsb), -COUNTS_MAX, COUNTS_MAX)
    return lsb, counts.astype("<i2")


def _pose(content: bytes) -> tuple[float, ...]:
    fields: dict[str, Any] = dict(cast(Message, messages.decode(content)).fields)
    sigmas = (fields["tilt_sigma"], fields["heading_sigma"])
    numbers = (np.nan if each is None else each for each in sigmas)
    return (*fields["q"], *numbers)


def hello(lsbs: tuple[float, ...]) -> bytes:
    """The hello of a probe with such counts."""
    gyr, acc, mag = lsbs
    return messages.hello_of(
        firmware="host",
        board="nano",
        sensor="mpu9250",
        who_am_i=(0x71, 0x48),
        mag_adjust=(128, 128, 128),
        sample_rate=FUSED_HZ,
        pose_rate=FUSED_HZ,
        raw_rate=FUSED_HZ,
        acc_lsb=acc,
        gyr_lsb=gyr,
        mag_lsb=mag,
        boot_count=1,
        filter="fuse",
    )
