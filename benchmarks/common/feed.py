# SPDX-License-Identifier: MIT
"""The input of every engine: the raw messages of a probe, captured or simulated.

`sampled` simulates a virtual board (sim/run/motion.c, sim/chips/) a thousand times as
fast, with a fixed time of start-up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.common import wire
from imud.gravity import GRAVITY_M_S2
from imud.params.trusted import CALIBRATED
from imud.rotation import FloatArray
from imud.virtual.motion import BoolArray, Motion
from imud.wire import messages, schema
from imud.wire.messages import Message

AVERAGING = 0.443  # length of a moving average times its -3 dB bandwidth
NO_READING = -(2**15)  # on the wire
FORCE_MAX_M_S2 = 16.0 * GRAVITY_M_S2  # what accelerometers are set to


@dataclass(frozen=True, slots=True)
class Clock:
    """A sensor that measures at its own rate; each sample takes its last reading."""

    rate_hz: float
    phase_s: float  # of one reading, from the start of the motion
    taken_after_s: float  # from a sample's interrupt until the reading is taken

    def last(self, times_s: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Time of the reading that each sample takes, and whether it is a new one."""
        ticks = np.floor((times_s + self.taken_after_s - self.phase_s) * self.rate_hz)
        is_new = np.diff(ticks, prepend=ticks[0] - 1.0) > 0
        return self.phase_s + ticks / self.rate_hz, is_new


@dataclass(frozen=True, slots=True)
class Chip:
    """A sensor as the firmware sets it up and as its model reads.

    Times and phases depend on the build: the end of the sensor's set-up differs by some
    milliseconds between images.
    """

    board: str
    sensor: str
    who_am_i: tuple[int, int]
    rate_hz: float
    first_sample_s: float  # after the start of the motion
    taken_before_s: float  # before a sample's interrupt
    # Bandwidth in Hz and delay in s, for motions without a sensor's low-pass.
    gyr_lowpass: tuple[float, float]
    acc_lowpass: tuple[float, float]
    gyr_lsb: float  # rad/s
    acc_lsb: float  # m/s2
    mag_lsb: float  # uT
    mag_counts_max: int
    # Without a clock the accelerometer measures with the gyroscope. The magnetometer
    # does for every second sample, from the second on, felt_before_s before the
    # interrupt.
    acc_clock: Clock | None = None
    mag_clock: Clock | None = None
    felt_before_s: float = 0.0
    mag_asa: tuple[int, int, int] | None = None  # factory adjustment, in our axes

    @property
    def mag_adjust(self) -> FloatArray:
        """The factors of the readings, which are rounded before and after."""
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

# LSM9DS0 data sheet, tables 3 and 21; CTRL_REG1_XM, CTRL_REG2_XM and CTRL_REG5_XM as
# the firmware writes them. A moving average lags by half its length.
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
POSE_RATE_HZ = 100  # a probe's default


@dataclass(frozen=True)
class Samples:
    """Equally spaced samples in SI units, in the probe's frame."""

    rate_hz: float
    gyr: FloatArray  # rad/s
    acc: FloatArray  # m/s2
    mag: FloatArray  # uT; NaN without a new reading

    def __len__(self) -> int:
        return len(self.gyr)

    @cached_property
    def has_mag(self) -> BoolArray:
        return np.asarray(np.isfinite(self.mag).all(axis=1))

    @cached_property
    def mag_held(self) -> FloatArray:
        """The last reading so far; the first one before there is any."""
        latest = np.where(self.has_mag, np.arange(len(self)), -1)
        latest = np.maximum.accumulate(latest)
        first = int(np.argmax(self.has_mag))
        return np.asarray(self.mag[np.where(latest < 0, first, latest)])


@dataclass(frozen=True)
class Feed:
    """A probe's hello and raw messages, and the samples after which it sent a pose."""

    hello: bytes
    raws: Sequence[bytes]
    pose_after: Sequence[int]  # indexes of `raws`
    pose_sequence: Sequence[int]
    start_us: int  # device time at the start of the motion
    params: bytes = b""  # the records in force

    @cached_property
    def rows(self) -> wire.Rows:
        return wire.to_rows("raw", self.raws)

    @cached_property
    def times_s(self) -> FloatArray:
        """Sample times from the start of the motion, of less than 71 minutes."""
        since_us = self.rows["time_us"].astype(np.float64) - self.start_us
        return np.asarray(since_us * 1e-6)

    @property
    def pose_times_s(self) -> FloatArray:
        return np.asarray(self.times_s[np.asarray(self.pose_after, int)])

    @cached_property
    def samples(self) -> Samples:
        known: Mapping[str, Any] = message_of(self.hello).fields
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


def sampled(motion: Motion, chip: Chip = MPU9250, params: bytes = CALIBRATED) -> Feed:
    """The messages that a virtual board with these params sends for a motion."""
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
    # Converters clip before their low-pass; a recording has gone through both.
    most = np.inf if motion.is_recorded else FORCE_MAX_M_S2
    force = np.clip(motion.acc, -most, most)
    gyr = means(motion.gyr, motion.rate_hz, taken, *gyr_window) / chip.gyr_lsb
    acc = means(force, motion.rate_hz, acc_taken, *acc_window) / chip.acc_lsb
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
    return Feed(
        hello(chip), wire.to_contents(rows), after, after, start_us=0, params=params
    )


def posed_after(count: int, rate_hz: float) -> Sequence[int]:
    """Indexes of the samples after which a pose is sent."""
    due = np.floor((np.arange(1, count + 1) * POSE_RATE_HZ) / rate_hz)
    poses: list[int] = np.flatnonzero(np.diff(due, prepend=0.0) > 0).tolist()
    return poses


def values(records: FloatArray, at: FloatArray) -> FloatArray:
    """Records interpolated linearly at fractional indexes, held at the ends."""
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
    """Exact means over windows whose centres are a delay before each time."""
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
    """The hello of a board with this sensor, once the sensor runs."""
    x, y, z = chip.mag_asa or (0, 0, 0)
    return messages.hello_of(
        firmware="host",
        board=chip.board,
        sensor=chip.sensor,
        who_am_i=chip.who_am_i,
        mag_adjust=(y, x, z),  # in the chip's axes
        sample_rate=int(chip.rate_hz),
        pose_rate=POSE_RATE_HZ,
        raw_rate=int(chip.rate_hz),
        acc_lsb=chip.acc_lsb,
        gyr_lsb=chip.gyr_lsb,
        mag_lsb=chip.mag_lsb,
        boot_count=1,
        filter="fuse",
    )


def with_filter(content: bytes, name: str) -> bytes:
    """The hello of the same probe with another filter."""
    old = message_of(content)
    fields = dict(old.fields) | {"filter": name}
    return messages.encode("hello", fields, old.sequence, old.time_us)


def message_of(content: bytes) -> Message:
    """Decode content that is known to be good."""
    message = messages.decode(content)
    assert isinstance(message, Message)
    return message
