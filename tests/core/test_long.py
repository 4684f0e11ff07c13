# SPDX-License-Identifier: MIT
"""Hours of generated motion through the probe's C, under the sanitizer that stops at
any overflow: a unit quaternion, no step that nothing explains, no drift."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ONE, ffi, lib
from core.long_motion import (
    BLOCK_S,
    LSB,
    MATRIX,
    MPU9250,
    PER_BLOCK,
    RATE_HZ,
    Block,
    T,
    calibration,
    felt,
    minutes,
)
from imud import rotation
from length import choose

pytestmark = pytest.mark.timeout(900)

MINUTES = choose(everyday=20, long=12 * 60)
HOURS = -(-MINUTES // 60)

# A step between poses is at most what the gyroscope said, bias removed, over 5 ms, and
# what a frame's two corrections may add, degrees. Numbers from core/fusion/fuse.c.
#
# The level follows the low-passed specific force F once in 100 ms. F moves by at most
# 0.45 / s of how far the force may be from it sideways (the total variation of the
# low-pass' response, 0.95 / s of its corner), and the force is seen as a mean over the
# frame, which leaves 0.4 m/s2 of these hands' sway.
LEVEL_STEP = 0.15
# The heading takes, on a field of 20 uT, at most 6 uT times P / (P + 50 uT2); P is
# below 2 uT2 while readings come, and grows by 0.3 deg2 a second without them.
BIAS_DEG_S = 1.0  # here, and what the filter may take for it

# What is observable, degrees, once it had the time for it.
TILT, TILT_RMS = 0.8, 0.1
TILT_AFTER_CLIPPING_S = 25
HEADING, HEADING_RMS = 2.0, 0.3
HEADING_AFTER_DISTURBANCE_S = 30
HEADING_AFTER_CLIPPING_S = 90
STARTED_S = 5


def heading_step(seconds_without_field: float) -> float:
    horizontal_ut = 20.0
    spread = 2.0 + 0.3 * seconds_without_field * (DEGREE * horizontal_ut) ** 2
    return 6.0 / horizontal_ut / DEGREE * spread / (spread + 50.0)


@dataclass
class Watch:
    """Looks at the poses of one minute after the other."""

    last: desk.Array = field(default_factory=lambda: np.array([[ONE, 0, 0, 0]]))
    since_clipping_s: float = 1e9
    since_disturbance_s: float = 1e9
    longest_s: float = 0.0  # without an undisturbed field, of the minute before

    def look(
        self,
        index: int,
        block: Block,
        samples: desk.Array,
        q: desk.Array,
        is_starting: desk.Array,
    ) -> desk.Array:
        """Squared errors of tilt and heading, NaN where nothing is asked."""
        assert np.abs(desk.norms(q) / ONE - 1).max() < 1e-6
        truth = block.quat[1:]
        is_clipped = samples["gyr_clipped"] | samples["acc_clipped"]
        since_clipping = seconds_since(is_clipped, self.since_clipping_s)
        is_disturbed = ~block.has_mag | (desk.norms(block.extra_field) > 0)
        since_disturbance = seconds_since(is_disturbed, self.since_disturbance_s)
        without = seconds_since(~is_disturbed, self.longest_s)
        has_started = index * BLOCK_S + T[1:, 0] > STARTED_S

        rate = samples["gyr"] * LSB["gyr"] @ MATRIX["gyr"].T / DEGREE
        allowed = (desk.norms(rate) + BIAS_DEG_S) / RATE_HZ
        allowed += heading_step(max(self.longest_s, float(without.max())))
        is_lost = since_clipping < TILT_AFTER_CLIPPING_S
        tilt = desk.tilt_deg(q, truth)
        # After clipping it is found again, and flagged.
        allowed += np.where(is_starting, 180, LEVEL_STEP)
        step = desk.apart_deg(np.concatenate([self.last, q[:-1]]), q)
        assert (step <= allowed)[has_started].all()
        assert not is_starting[~is_lost & has_started].any()

        tilt[is_lost | ~has_started] = np.nan
        assert np.nanmax(tilt, initial=0) < TILT
        heading = desk.heading_deg(q, truth)
        is_free = (since_disturbance < HEADING_AFTER_DISTURBANCE_S) | (
            since_clipping < HEADING_AFTER_CLIPPING_S
        )
        heading[is_free | ~has_started] = np.nan
        assert np.nanmax(heading, initial=0) < HEADING

        self.last = q[-1:]
        self.since_clipping_s = float(since_clipping[-1])
        self.since_disturbance_s = float(since_disturbance[-1])
        self.longest_s = float(without.max())
        return np.stack([tilt, heading]) ** 2


def seconds_since(is_so: desk.Array, before_s: float) -> desk.Array:
    """At each sample, how long ago something last was so."""
    number = np.arange(1, len(is_so) + 1)
    last = np.maximum.accumulate(np.where(is_so, number, 0))
    return np.where(last > 0, number - last, before_s * RATE_HZ + number) / RATE_HZ


class Probe:
    """A `struct pose_tracker` that is fed minutes."""

    def __init__(self) -> None:
        self.calibration = calibration()
        self.c = ffi.new("struct pose_tracker *")
        assert lib.pose_begin(self.c, self.calibration, MPU9250, lib.FILTER_FUSE)

    def feel(self, samples: desk.Array) -> tuple[desk.Array, desk.Array]:
        """Quaternions, and where they are not settled."""
        poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
        results = np.zeros(len(samples), np.int32)
        desk.call(lib.loop_pose, self.c, len(samples), samples, poses, results)
        return poses["q"].copy(), (poses["pose_flags"] & lib.POSE_STARTING) != 0


@pytest.mark.long
def test_for_hours_nothing_overflows_jumps_or_drifts():
    probe, watch = Probe(), Watch()
    squares, looks = np.zeros((2, HOURS, 2))
    for index, block in minutes(MINUTES):
        samples = felt(index, block)
        errors = watch.look(index, block, samples, *probe.feel(samples))
        squares[index // 60] += np.nansum(errors, axis=1)
        looks[index // 60] += np.count_nonzero(~np.isnan(errors), axis=1)
    hourly = np.sqrt(squares / looks)
    # The last hour like the first, and enough of each looked at.
    assert (hourly < (TILT_RMS, HEADING_RMS)).all()
    assert (looks > 0.3 * min(60, MINUTES) * PER_BLOCK).all()


# That a watch sees what it is for.


@pytest.fixture(scope="module")
def seen() -> tuple[Block, desk.Array, desk.Array]:
    """A calm minute after a calm minute, and its poses."""
    probe = Probe()
    for index, block in minutes(2):
        samples = felt(index, block)
        q, _ = probe.feel(samples)
    return block, samples, q


def turned(q: desk.Array, rows: slice, *degrees: float) -> desk.Array:
    turn = rotation.from_rotation_vector(np.array(degrees) * DEGREE)
    out = q.copy()
    out[rows] = np.round(rotation.multiply(turn, q[rows] / ONE) * ONE)
    return out


def test_a_calm_minute_passes(seen):
    block, samples, q = seen
    Watch(last=q[:1]).look(1, block, samples, q, np.zeros(len(q), bool))


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda q: turned(q, slice(5000, None), 0, 0, 1.5),  # one jump
        lambda q: turned(q, slice(None), 1.0, 0, 0),  # a tilt
        lambda q: turned(q, slice(None), 0, 0, 3),  # a heading
        lambda q: np.where(np.arange(len(q))[:, None] == 77, q * (1 + 2e-6), q),
    ],
    ids=["jump", "tilt", "heading", "norm"],
)
def test_a_spoilt_minute_does_not(seen, spoilt):
    block, samples, q = seen
    bad = spoilt(q)
    with pytest.raises(AssertionError):
        Watch(last=bad[:1]).look(1, block, samples, bad, np.zeros(len(bad), bool))
