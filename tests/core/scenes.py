# SPDX-License-Identifier: MIT
"""Motions with known attitude, as the filter and the probe get to feel them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from core.desk import (
    DEGREE,
    FIELD,
    FORCE,
    RATE,
    Array,
    G,
    call,
    dtype_of,
    ffi,
    lib,
    rounded,
)
from imud import rotation

MEASUREMENT = dtype_of("struct measurement")
SAMPLE = dtype_of("struct sample")
ORIENTATION = dtype_of("struct quat")
QUALITY = dtype_of("struct attitude_quality")
SIGMAS = ("tilt_sigma_cdeg", "heading_sigma_cdeg")
FLAGS = (
    "starting",
    "at_rest",
    "mag_disturbed",
    "mag_absent",
    "heading_free",
    "field_impossible",
    "field_unlike",
    "force_impossible",
)

MAG_HZ = 100
# What the chips of the house add at rest, root mean square: MPU-9250 data sheet,
# tables 1 and 2, at 92 Hz; the magnetometer as measured.
GYR_NOISE = 0.1 * DEGREE
ACC_NOISE = 8e-3 * G
MAG_NOISE = 0.6


@dataclass
class Scene:
    """Rows in SI units at a constant rate, and the attitude they come from."""

    rate_hz: int
    gyr: Array
    acc: Array
    mag: Array
    has_mag: Array
    quat: Array

    def __len__(self) -> int:
        return len(self.gyr)

    def __getitem__(self, rows: slice) -> Scene:
        parts = (self.gyr, self.acc, self.mag, self.has_mag, self.quat)
        return Scene(self.rate_hz, *(part[rows].copy() for part in parts))

    @property
    def interval_us(self) -> Array:
        return np.full(len(self), round(1e6 / self.rate_hz), np.uint32)

    def measurements(self) -> Array:
        out = np.zeros(len(self), MEASUREMENT)
        out["gyr_rad_s_q25"] = rounded(self.gyr * RATE)
        out["acc_m_s2_q21"] = rounded(self.acc * FORCE)
        out["mag_ut_q18"] = rounded(self.mag * FIELD)
        out["has_mag"] = self.has_mag
        return out

    def samples(self, identity: object, start_us: int = 0) -> Array:
        """Counts of a sensor, held at the ends of their range."""
        out = np.zeros(len(self), SAMPLE)
        step_us = 1_000_000 / self.rate_hz
        out["time_us"] = start_us + np.round(np.arange(len(self)) * step_us)
        for name, rows, lsb in (
            ("gyr", self.gyr, identity.gyr_lsb_nrad_s * 1e-9),
            ("acc", self.acc, identity.acc_lsb_nm_s2 * 1e-9),
            ("mag", self.mag, identity.mag_lsb_pt * 1e-6),
        ):
            out[name] = np.clip(np.round(rows / lsb), -(2**15), 2**15 - 1)
        out["has_mag"] = self.has_mag
        return out


def earth(dip_deg: float = 66.0, field_ut: float = 49.0) -> Array:
    """The field of a place, east, north, up."""
    dip = dip_deg * DEGREE
    return field_ut * np.array([0, np.cos(dip), -np.sin(dip)])


def scene(
    quat: Array,
    rate_hz: int,
    *,
    seed: int = 0,
    field_ut: Array | None = None,
    gyr_bias_deg_s: tuple[float, float, float] = (0, 0, 0),
    noise: float = 1.0,
    sway_m_s2: float = 0.0,
) -> Scene:
    """What is felt on the way through attitudes: rates are means since the one before.

    `field_ut` is the field of the world, a row or a row an attitude.
    """
    random = np.random.default_rng(seed)
    count = len(quat)
    back = rotation.inverse(quat)
    turn = rotation.to_rotation_vector(rotation.multiply(back[:-1], quat[1:]))
    gyr = np.concatenate([np.zeros((1, 3)), turn * rate_hz])
    force = np.tile([0.0, 0.0, G], (count, 1))
    t = np.arange(count)[:, None] / rate_hz
    force += sway_m_s2 * np.sin(2 * np.pi * np.array([0.9, 1.3, 2.1]) * t)
    field = earth() if field_ut is None else field_ut
    rows = [
        gyr + np.array(gyr_bias_deg_s) * DEGREE,
        rotation.rotate(back, force),
        rotation.rotate(back, np.broadcast_to(field, (count, 3))),
    ]
    for index, sigma in enumerate((GYR_NOISE, ACC_NOISE, MAG_NOISE)):
        rows[index] = rows[index] + noise * sigma * random.standard_normal((count, 3))
    reading = np.arange(count + 1) * MAG_HZ // rate_hz
    return Scene(rate_hz, *rows, has_mag=reading[1:] > reading[:-1], quat=quat)


def at_rest(
    seconds: float, rate_hz: int = 200, quat: Array = rotation.IDENTITY
) -> Array:
    """One attitude, held."""
    return np.tile(quat, (round(seconds * rate_hz), 1))


def tumble(
    seconds: float, rate_hz: int, seed: int, start: Array = rotation.IDENTITY
) -> Array:
    """4 s of rest, then turns of up to 2000 deg/s about changing axes, and rests."""
    random = np.random.default_rng(seed)
    count = round(seconds * rate_hz)
    t = np.arange(count) / rate_hz
    quat = np.tile(start, (count, 1))
    begun = 4.0
    while begun < seconds:
        lasts = random.uniform(0.4, 1.5)
        peak = np.exp(random.uniform(np.log(30), np.log(2000))) * DEGREE
        axis = random.standard_normal(3)
        axis /= np.linalg.norm(axis)
        u = np.clip((t - begun) / lasts, 0, 1)
        # Least jerk: its peak is 15/8 of its mean.
        step = u**3 * (10 - 15 * u + 6 * u**2) * peak * lasts * 8 / 15
        quat = rotation.multiply(
            quat, rotation.from_rotation_vector(step[:, None] * axis)
        )
        begun += lasts + (random.uniform(1.5, 3.0) if random.random() < 0.3 else 0)
    return quat


def with_flags(quality: Array) -> Array:
    """The same with its flags by name: `is_starting` and so on."""
    names = [f"is_{flag}" for flag in FLAGS]
    out = np.zeros(
        len(quality),
        [
            *((name, np.uint16) for name in SIGMAS),
            *((name, np.bool_) for name in names),
        ],
    )
    for name in SIGMAS:
        out[name] = quality[name]
    for name, flag in zip(names, FLAGS, strict=True):
        out[name] = quality["flags"] & getattr(lib, f"POSE_{flag.upper()}") != 0
    return out


class Filter:
    """A `struct fuse` and what it says, sample by sample."""

    def __init__(self, rate_hz: int, gyr_delay_us: int = 3900) -> None:
        self.c = ffi.new("struct fuse *")
        lib.fuse_init(self.c, rate_hz, gyr_delay_us)

    def run(
        self, measurements: Array, interval_us: Array
    ) -> tuple[Array, Array, Array]:
        """Orientations and levels as stored, and the qualities."""
        count = len(measurements)
        orientation, level = np.zeros((2, count), ORIENTATION)
        quality = np.zeros(count, QUALITY)
        call(
            lib.loop_fuse,
            self.c,
            count,
            measurements,
            interval_us,
            orientation,
            level,
            quality,
        )
        return orientation, level, with_flags(quality)

    def feel(self, scene: Scene) -> tuple[Array, Array, Array]:
        return self.run(scene.measurements(), scene.interval_us)

    def set_bias(self, bias_deg_s: tuple[float, float, float]) -> None:
        steps = rounded(np.array(bias_deg_s) * DEGREE * RATE).tolist()
        lib.fuse_set_bias(self.c, ffi.new("struct vector *", steps))

    @property
    def bias_deg_s(self) -> Array:
        bias = self.c.state.bias_rad_s_q25
        return np.array([bias.x, bias.y, bias.z]) / RATE / DEGREE


class Attitude:
    """A `struct attitude` of the filter that is named, and what it says."""

    def __init__(self, name: str, rate_hz: int = 200, gyr_delay_us: int = 3900) -> None:
        self.c = ffi.new("struct attitude *")
        # What memory held before must not matter.
        ffi.memmove(self.c, b"\xa5" * ffi.sizeof(self.c[0]), ffi.sizeof(self.c[0]))
        kind = getattr(lib, f"FILTER_{name.upper()}")
        lib.attitude_init(self.c, kind, rate_hz, gyr_delay_us)

    def run(self, measurements: Array, interval_us: Array) -> tuple[Array, Array]:
        """Orientations as stored, and the qualities."""
        count = len(measurements)
        orientation = np.zeros(count, ORIENTATION)
        quality = np.zeros(count, QUALITY)
        call(
            lib.loop_attitude,
            *(self.c, count, measurements, interval_us, orientation, quality),
        )
        return orientation, with_flags(quality)

    def feel(self, scene: Scene) -> tuple[Array, Array]:
        return self.run(scene.measurements(), scene.interval_us)

    def set_bias(self, bias_deg_s: tuple[float, float, float]) -> None:
        steps = rounded(np.array(bias_deg_s) * DEGREE * RATE).tolist()
        lib.attitude_set_bias(self.c, ffi.new("struct vector *", steps))
