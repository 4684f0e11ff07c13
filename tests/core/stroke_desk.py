# SPDX-License-Identifier: MIT
"""Shared by the tests of strokes: samples of a measuring hand, and the messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.strokes import runs
from benchmarks.strokes.runs import motion_of, turned_back
from core import desk
from core.desk import ffi, lib
from core.scenes import SAMPLE
from imud.virtual.motion import Motion
from imud.virtual.sensors import SensorErrors
from imud.virtual.stroking import (
    PRESSED_S,
    RELEASED_S,
    Plan,
    TrueStroke,
    strokes_of,
)

RATE_HZ = 200
WINDOW = 20  # samples
MPU9250 = desk.identity_of()
TOLD = desk.dtype_of("struct message_stroke")
POSE = desk.dtype_of("struct message_pose")
NULL = -(2**31)
MICRO = 1e-6
SIGMA = 1e-5

# A module that has been calibrated, and the noise of the real rests of BROAD.
ERRORS = SensorErrors(0.0856, 5.4, 0.6, 0.5, 0.0, 0.0)

CALIBRATED = ffi.new("struct calibration *")
lib.calibration_clear(CALIBRATED)
CALIBRATED.gyr.matrix[0][1] = 1
CALIBRATED.mag.sigma = 100  # 1 uT: on an uncalibrated one a slow turn is a rest


@dataclass
class Measured:
    """Samples of a hand that measures, and the truth."""

    motion: Motion
    samples: desk.Array
    strokes: list[TrueStroke]

    def index(self, seconds: float) -> int:
        return round(seconds * RATE_HZ)

    def held(self) -> desk.Array:
        """Whether the button is held: from just before each stroke until after it."""
        out = np.zeros(len(self.samples), bool)
        for stroke in self.strokes:
            press = self.index(stroke.start_s + PRESSED_S)
            out[press : self.index(stroke.end_s + RELEASED_S)] = True
        return out


def measured(
    plan: Plan, seed: int, tip_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Measured:
    """The samples of an MPU-9250 while a hand carries out a plan."""
    motion = motion_of(plan, seed, tip_m, ERRORS)
    motion = motion[: len(motion) // 5 * 5]
    return Measured(motion, samples_of(motion), strokes_of(motion))


def samples_of(motion: Motion) -> desk.Array:
    count = len(motion) // 5
    out = np.zeros(count, SAMPLE)
    out["time_us"] = np.arange(count) * 5000
    for name, rows, lsb in (
        ("gyr", motion.gyr, MPU9250.gyr_lsb_nrad_s * 1e-9),
        ("acc", motion.acc, MPU9250.acc_lsb_nm_s2 * 1e-9),
        ("mag", motion.mag, MPU9250.mag_lsb_pt * 1e-6),
    ):
        means = rows.reshape(count, 5, 3).mean(axis=1)
        out[name] = np.clip(np.round(means / lsb), -(2**15), 2**15 - 1)
    out["has_mag"] = np.arange(count) % 2 == 1
    return out


class Tracker:
    """A `struct pose_tracker` of a calibrated MPU-9250: what it tells of strokes."""

    def __init__(
        self,
        *,
        is_by_button: bool = False,
        tip_um: tuple[int, int, int] | None = None,
        axis: tuple[int, int, int] | None = None,
    ) -> None:
        self.c = ffi.new("struct pose_tracker *")
        ffi.memmove(self.c, b"\xa5" * ffi.sizeof(self.c[0]), ffi.sizeof(self.c[0]))
        assert lib.pose_begin(self.c, CALIBRATED, MPU9250, lib.FILTER_FUSE)
        tip = ffi.new("struct pose_tip *")
        tip.offset_um = tip_um or (NULL, 0, 0)
        tip.axis = axis or (-(2**15), 0, 0)
        lib.pose_set_tip(self.c, tip, is_by_button)

    def feel(
        self, samples: desk.Array, held: desk.Array | None = None
    ) -> tuple[desk.Array, desk.Array]:
        """What is told of strokes, and after which samples."""
        found = np.zeros(len(samples) // WINDOW + 2, TOLD)
        after = np.zeros(len(found), np.int32)
        held = np.zeros(len(samples), bool) if held is None else held
        count = desk.call(
            lib.loop_strokes, self.c, len(samples), samples, held, found, after
        )
        return found[:count], after[:count]

    def pose(self) -> Any:
        pose = ffi.new("struct message_pose *")
        lib.pose_read(self.c, pose)
        return pose

    def quat(self) -> desk.Array:
        return np.array(list(self.pose().q)) / desk.ONE


def ends(strokes: desk.Array) -> desk.Array:
    return strokes[strokes["end"] != lib.STROKE_END_RUNNING]


def names(strokes: desk.Array) -> list[int]:
    return [int(end) for end in ends(strokes)["end"]]


def heading_of(tracker: Tracker, scene: Measured) -> float:
    """By how much the filter's heading is wrong at the end, rad."""
    return runs.heading_of(tracker.quat(), scene.motion, len(scene.motion) / 1000.0)


def errors(tracker: Tracker, scene: Measured, strokes: desk.Array) -> desk.Array:
    """Of each stroke, m, without that of the heading."""
    found = turned_back(
        ends(strokes)["displacement"] * MICRO, heading_of(tracker, scene)
    )
    return found - np.array([stroke.way_m for stroke in scene.strokes])
