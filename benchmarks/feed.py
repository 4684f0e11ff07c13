# SPDX-License-Identifier: MIT
"""What every engine is fed: the raw messages of a probe, sent or made up.

`sampled` makes them as a virtual board does (sim/motion.c, sim/chips/), a thousand
times as fast and for one moment of its start-up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import wire

from imud.rotation import FloatArray
from imud.virtual.motion import GRAVITY_M_S2, BoolArray, Motion
from imud.wire import messages, schema
from imud.wire.messages import Message

AVERAGING = 0.443  # times 1/bandwidth: a moving average with that -3 dB point
NO_READING = -(2**15)  # on the wire


@dataclass(frozen=True, slots=True)
class Clock:
    """Measurements at a rate of their own, of which a sample takes the last."""

    rate_hz: float
    phase_s: float  # of one of them, from the start of the motion
    taken_after_s: float  # a sample's interrupt: when it is read

    def last(self, times_s: FloatArray) -> tuple[FloatArray, BoolArray]:
        """When that was which each sample takes, and whether none took it before."""
        ticks = np.floor((times_s + self.taken_after_s - self.phase_s) * self.rate_hz)
        is_new = np.diff(ticks, prepend=ticks[0] - 1.0) > 0
        return self.phase_s + ticks / self.rate_hz, is_new


@dataclass(frozen=True, slots=True)
class Chip:
    """A sensor as the firmware sets it up and as its model reads.

    Moments depend on the build: when an image had set its sensor up, by some
    milliseconds, and with that the phases.
    """

    board: str
    sensor: str
    who_am_i: tuple[int, int]
    rate_hz: float
    first_sample_s: float  # after the start of the motion
    taken_before_s: float  # a sample's interrupt
    # Bandwidth and delay, for motions that no sensor's low-pass has touched.
    gyr_lowpass: tuple[float, float]
    acc_lowpass: tuple[float, float]
    gyr_lsb: float  # rad/s
    acc_lsb: float  # m/s2
    mag_lsb: float  # uT
    mag_counts_max: int
    # None: with the gyroscope. The other: every second sample, from the second on, felt
    # so long before its interrupt.
    acc_clock: Clock | None = None
    mag_clock: Clock | None = None
    felt_before_s: float = 0.0
    mag_asa: tuple[int, int, int] | None = None  # the factory's, in our axes

    @property
    def mag_adjust(self) -> FloatArray:
        """The factors that readings are multiplied by: rounded before and after."""
        return (np.array(self.mag_asa or (128, 128, 128)) - 128) * 0.5 / 128 + 1


# RM-MPU-9250A-00, 4.6 and 4.8; AK8963 data sheet, 8.3. The chip reads its magnetometer
# before it interrupts.
MPU9250 = Chip(
    board="nano",
    sensor="mpu9250",
    who_am_i=(0x71, 0x48),
    rate_hz=200.0,
    first_sample_s=0.745655,
    taken_before_s=0.000255,
    gyr_lowpass=(92.0, 3.9e-3),
    acc_lowpass=(99.0, 2.88e-3),
    gyr_lsb=float(np.radians(2000.0)) / 32768,
    acc_lsb=16.0 * GRAVITY_M_S2 / 32768,
    mag_lsb=0.15,
    mag_counts_max=32760,
    felt_before_s=0.006333,
    mag_asa=(178, 176, 166),
)

# DS of the LSM9DS0, tables 3 and 21; CTRL_REG1_XM, CTRL_REG2_XM and CTRL_REG5_XM as the
# firmware writes them. A moving average lags by half of itself.
LSM9DS0 = Chip(
    board="f405",
    sensor="lsm9ds0",
    who_am_i=(0xD4, 0x49),
    rate_hz=380.0,
    first_sample_s=1.103271,
    taken_before_s=0.000001,
    gyr_lowpass=(100.0, 0.5 * AVERAGING / 100.0),
    acc_lowpass=(194.0, 0.5 * AVERAGING / 194.0),
    gyr_lsb=float(np.radians(0.070)),
    acc_lsb=0.732e-3 * GRAVITY_M_S2,
    mag_lsb=0.008,
    mag_counts_max=32767,
    acc_clock=Clock(800.0, phase_s=0.000826, taken_after_s=0.000352),
    mag_clock=Clock(100.0, phase_s=0.001, taken_after_s=0.000626),
)
POSE_RATE_HZ = 100  # at which a probe starts


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


def sampled(motion: Motion, chip: Chip = MPU9250) -> Feed:
    """What a virtual board sends of a motion."""
    count = int((motion.seconds - chip.first_sample_s) * chip.rate_hz)
    times = chip.first_sample_s + np.arange(count) / chip.rate_hz
    taken = times - chip.taken_before_s
    acc_taken, acc_rate_hz = taken, chip.rate_hz
    if chip.acc_clock:
        acc_taken, _ = chip.acc_clock.last(times)
        acc_rate_hz = chip.acc_clock.rate_hz
    felt, is_new = times - chip.felt_before_s, np.arange(count) % 2 == 1
    if chip.mag_clock:
        felt, is_new = chip.mag_clock.last(times)
    gyr_window, acc_window = (
        (1.0 / rate_hz, 0.0)
        if motion.is_recorded
        else (AVERAGING / bandwidth_hz, delay_s)
        for rate_hz, (bandwidth_hz, delay_s) in (
            (chip.rate_hz, chip.gyr_lowpass),
            (acc_rate_hz, chip.acc_lowpass),
        )
    )
    rows = wire.empty_rows("raw", count)
    rows["sequence"] = np.arange(count)
    rows["time_us"] = np.rint(times * 1e6)
    gyr = means(motion.gyr, motion.rate_hz, taken, *gyr_window) / chip.gyr_lsb
    acc = means(motion.acc, motion.rate_hz, acc_taken, *acc_window) / chip.acc_lsb
    field = values(motion.mag, felt * motion.rate_hz)
    mag = np.rint(np.rint(field / chip.mag_lsb / chip.mag_adjust) * chip.mag_adjust)
    rows["gyr"] = np.clip(np.rint(gyr), -(2**15), 2**15 - 1)
    rows["acc"] = np.clip(np.rint(acc), -(2**15), 2**15 - 1)
    is_new &= np.abs(mag).max(axis=1) <= chip.mag_counts_max
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
    after = posed_after(count, chip.rate_hz)
    return Feed(hello(chip), wire.to_contents(rows), after, after, start_us=0)


def posed_after(count: int, rate_hz: float) -> Sequence[int]:
    """The samples with which the shares of a pose make another whole one."""
    due = np.floor((np.arange(1, count + 1) * POSE_RATE_HZ) / rate_hz)
    poses: list[int] = np.flatnonzero(np.diff(due, prepend=0.0) > 0).tolist()
    return poses


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


def hello(chip: Chip = MPU9250) -> bytes:
    """Of a board with this sensor, once it runs."""
    x, y, z = chip.mag_asa or (0, 0, 0)
    fields = {
        "protocol_version": schema.PROTOCOL_VERSION,
        "schema_fingerprint": schema.FINGERPRINT,
        "firmware": "host",
        "board": chip.board,
        "probe_id": bytes(8),
        "sensor": chip.sensor,
        "who_am_i": chip.who_am_i,
        "mag_adjust": (y, x, z),  # in the chip's axes
        "self_test": (),
        "sample_rate": int(chip.rate_hz),
        "pose_rate": POSE_RATE_HZ,
        "raw_rate": int(chip.rate_hz),
        "acc_lsb": chip.acc_lsb,
        "gyr_lsb": chip.gyr_lsb,
        "mag_lsb": chip.mag_lsb,
        "boot_count": 1,
        "reset_cause": (),
        "filter": "fuse",
        "reset_address": 0,
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
