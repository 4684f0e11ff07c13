# SPDX-License-Identifier: MIT
"""What every engine is fed: the raw messages of a probe, sent or made up.

`sampled` makes them as the virtual Nano does (sim/motion.c, sim/chips/mpu9250.c), a
thousand times as fast and for one moment of its start-up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import wire

from imud import messages, schema
from imud.messages import Message
from imud.motion import GRAVITY_M_S2, BoolArray, Motion
from imud.rotation import FloatArray

RATE_HZ = 200.0
MAG_EVERY = 2  # samples a reading of the magnetometer
POSE_EVERY = 2  # samples a pose, at the rate a probe starts with

# When an image had set up its sensor, after the start of the motion, and how long
# before a sample's interrupt the sample was taken and the field was measured: the
# first and the last depend on the build by up to 5 and 10 ms.
FIRST_SAMPLE_S = 0.745655
TAKEN_BEFORE_S = 0.000255  # the chip reads its AK8963 before it interrupts
FELT_BEFORE_S = 0.006333

# Of motions that no sensor's low-pass has touched: bandwidth and delay of the settings
# that the firmware chooses (RM-MPU-9250A-00, 4.6 and 4.8).
GYR_LOWPASS = (92.0, 3.9e-3)
ACC_LOWPASS = (99.0, 2.88e-3)
AVERAGING = 0.443  # times 1/bandwidth: a moving average with that -3 dB point

GYR_LSB_RAD_S = np.radians(2000.0) / 32768
ACC_LSB_M_S2 = 16.0 * GRAVITY_M_S2 / 32768
MAG_LSB_UT = 0.15
# The factory's adjustment, in our axes: readings are rounded before and after it.
MAG_ADJUST = (np.array([178, 176, 166]) - 128) * 0.5 / 128 + 1
MAG_COUNTS_MAX = 32760  # AK8963 data sheet, 8.3
NO_READING = -(2**15)  # on the wire


@dataclass(frozen=True)
class Samples:
    """Equally spaced samples in SI units, for filters that know no counts."""

    rate_hz: float
    gyr: FloatArray  # rad/s
    acc: FloatArray  # m/s2
    mag: FloatArray  # uT; NaN where the magnetometer had nothing new

    def __len__(self) -> int:
        return len(self.gyr)

    @cached_property
    def has_mag(self) -> BoolArray:
        return np.asarray(np.isfinite(self.mag).all(axis=1))

    @cached_property
    def mag_held(self) -> FloatArray:
        """The last reading; before the first, the first."""
        latest = np.where(self.has_mag, np.arange(len(self)), -1)
        latest = np.maximum.accumulate(latest)
        first = int(np.argmax(self.has_mag))
        return np.asarray(self.mag[np.where(latest < 0, first, latest)])


@dataclass(frozen=True)
class Feed:
    """A probe's hello and raw messages, and after which of them it sent a pose."""

    hello: bytes
    raws: Sequence[bytes]
    pose_after: Sequence[int]  # indexes of `raws`
    pose_sequence: Sequence[int]
    start_us: int  # device time at the start of the motion

    @cached_property
    def rows(self) -> wire.Rows:
        return wire.to_rows("raw", self.raws)

    @cached_property
    def times_s(self) -> FloatArray:
        """Of the samples, from the start of the motion; shorter than 71 minutes."""
        since_us = self.rows["time_us"].astype(np.float64) - self.start_us
        return np.asarray(since_us * 1e-6)

    @property
    def pose_times_s(self) -> FloatArray:
        return np.asarray(self.times_s[np.asarray(self.pose_after, int)])

    @cached_property
    def samples(self) -> Samples:
        known: Mapping[str, Any] = said(self.hello).fields
        mag = self.rows["mag"] * known["mag_lsb"]
        mag[self.rows["mag"][:, 0] == NO_READING] = np.nan
        return Samples(
            known["sample_rate"],
            gyr=self.rows["gyr"] * known["gyr_lsb"],
            acc=self.rows["acc"] * known["acc_lsb"],
            mag=mag,
        )


def with_bias(motion: Motion, bias_ut: FloatArray) -> Motion:
    """The same motion with a magnet on the probe."""
    return replace(motion, mag=motion.mag + bias_ut)


def sampled(motion: Motion) -> Feed:
    """What a virtual Nano sends of a motion; its magnetometer is the second to come."""
    count = int((motion.seconds - FIRST_SAMPLE_S) * RATE_HZ)
    times = FIRST_SAMPLE_S + np.arange(count) / RATE_HZ
    taken = times - TAKEN_BEFORE_S
    period = (1.0 / RATE_HZ, 0.0)
    gyr_window, acc_window = (
        period if motion.is_recorded else (AVERAGING / bandwidth_hz, delay_s)
        for bandwidth_hz, delay_s in (GYR_LOWPASS, ACC_LOWPASS)
    )
    rows = wire.empty_rows("raw", count)
    rows["sequence"] = np.arange(count)
    rows["time_us"] = np.rint(times * 1e6)
    gyr = means(motion.gyr, motion.rate_hz, taken, *gyr_window) / GYR_LSB_RAD_S
    acc = means(motion.acc, motion.rate_hz, taken, *acc_window) / ACC_LSB_M_S2
    field = values(motion.mag, (times - FELT_BEFORE_S) * motion.rate_hz)
    mag = np.rint(np.rint(field / MAG_LSB_UT / MAG_ADJUST) * MAG_ADJUST)
    rows["gyr"] = np.clip(np.rint(gyr), -(2**15), 2**15 - 1)
    rows["acc"] = np.clip(np.rint(acc), -(2**15), 2**15 - 1)
    is_new = (np.arange(count) % MAG_EVERY == 1) & (
        np.abs(mag).max(axis=1) <= MAG_COUNTS_MAX
    )
    rows["mag"] = np.where(is_new[:, None], mag, NO_READING)
    rows["temperature"] = 2500
    flags = np.zeros(count, np.uint8)
    for name, flag in (
        ("gyr", schema.SampleFlags.GYR_CLIPPED),
        ("acc", schema.SampleFlags.ACC_CLIPPED),
    ):
        edge = (np.abs(rows[name].astype(int)) >= 2**15 - 1).any(axis=1)
        flags |= edge.astype(np.uint8) * np.uint8(flag)
    rows["sample_flags"] = flags[:, None]
    after = range(1, count, POSE_EVERY)
    return Feed(hello(), wire.to_contents(rows), after, after, start_us=0)


def values(records: FloatArray, at: FloatArray) -> FloatArray:
    """Values at any places among records, linear between them, held at the ends."""
    # The stream to the emulator has single precision.
    known = records.astype(np.float32).astype(float)
    at = np.clip(at, 0.0, len(known) - 1.0)
    below = np.minimum(at.astype(int), len(known) - 2)
    share = (at - below)[:, None]
    return np.asarray((1.0 - share) * known[below] + share * known[below + 1])


def means(
    records: FloatArray,
    rate_hz: float,
    times_s: FloatArray,
    window_s: float,
    delay_s: float,
) -> FloatArray:
    """Exact means over windows that are centred a delay before each time."""
    known = records.astype(np.float32).astype(float)
    whole = np.cumsum(0.5 * (known[1:] + known[:-1]), axis=0)
    whole = np.concatenate([np.zeros((1, known.shape[1])), whole])

    def integral(at: FloatArray) -> FloatArray:
        inside = np.clip(at, 0.0, len(known) - 1.0)
        below = np.minimum(inside.astype(int), len(known) - 2)
        share = (inside - below)[:, None]
        rise = known[below + 1] - known[below]
        part = share * (known[below] + 0.5 * share * rise)
        outside = (at - inside)[:, None] * np.where(
            (at < inside)[:, None], known[0], known[-1]
        )
        return np.asarray(whole[below] + part + outside)

    middle = (times_s - delay_s) * rate_hz
    half = 0.5 * window_s * rate_hz
    return (integral(middle + half) - integral(middle - half)) / (2.0 * half)


def hello() -> bytes:
    """Of a Nano with an MPU-9250, once it runs."""
    fields = {
        "protocol_version": schema.PROTOCOL_VERSION,
        "schema_fingerprint": schema.FINGERPRINT,
        "firmware": "host",
        "board": "nano",
        "probe_id": bytes(8),
        "sensor": "mpu9250",
        "who_am_i": (0x71, 0x48),
        "mag_adjust": (176, 178, 166),
        "self_test": (),
        "sample_rate": int(RATE_HZ),
        "pose_rate": int(RATE_HZ) // POSE_EVERY,
        "raw_rate": int(RATE_HZ),
        "acc_lsb": ACC_LSB_M_S2,
        "gyr_lsb": float(GYR_LSB_RAD_S),
        "mag_lsb": MAG_LSB_UT,
        "boot_count": 1,
        "reset_cause": (),
        "filter": "fuse",
    }
    return messages.encode("hello", fields, sequence=0, time_us=0)


def with_filter(content: bytes, name: str) -> bytes:
    """A hello of the same probe that runs another filter."""
    old = said(content)
    fields = dict(old.fields) | {"filter": name}
    return messages.encode("hello", fields, old.sequence, old.time_us)


def said(content: bytes) -> Message:
    """The message of content that has been found good."""
    message = messages.decode(content)
    assert isinstance(message, Message)
    return message
