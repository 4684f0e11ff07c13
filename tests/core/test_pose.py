# SPDX-License-Identifier: MIT
"""Samples to poses: flags, sigmas, the origin, and the same bits every time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ONE, ffi, lib
from core.scenes import Scene, at_rest, scene, tumble
from imud import rotation

MPU9250 = desk.identity_of()
POSE = desk.dtype_of("struct message_pose")
FULL, HEADING, NONE = (
    lib.POSE_ORIGIN_FULL,
    lib.POSE_ORIGIN_HEADING,
    lib.POSE_ORIGIN_NONE,
)
NOT_KNOWN = 2**16 - 1


class Tracker:
    """A `struct pose_tracker` of an MPU-9250 without calibration."""

    def __init__(self, fill: int = 0) -> None:
        self.c = ffi.new("struct pose_tracker *")
        size = ffi.sizeof(self.c[0])
        ffi.memmove(self.c, bytes([fill]) * size, size)
        assert lib.pose_begin(self.c, desk.EXACT, MPU9250, lib.FILTER_FUSE)

    def feel(self, samples: desk.Array) -> tuple[desk.Array, desk.Array]:
        """A pose and a result a sample."""
        poses = np.zeros(len(samples), POSE)
        results = np.zeros(len(samples), np.int32)
        desk.call(lib.loop_pose, self.c, len(samples), samples, poses, results)
        return poses, results

    def step(self, samples: desk.Array) -> None:
        """Take samples without a pose in between."""
        for one in samples:
            sample = ffi.new("struct sample *")
            ffi.buffer(sample)[:] = one.tobytes()
            lib.pose_step(self.c, sample)

    def read(self) -> Any:
        pose = ffi.new("struct message_pose *")
        lib.pose_read(self.c, pose)
        return pose

    def quat(self) -> desk.Array:
        return np.array(list(self.read().q)) / ONE

    def set_origin(self, origin: int) -> None:
        lib.pose_set_origin(self.c, origin)


def felt(quat: desk.Array, **options: Any) -> Scene:
    return scene(quat, 200, **options)


def has(poses: desk.Array, flag: int) -> desk.Array:
    return poses["pose_flags"] & flag != 0


@pytest.mark.parametrize(
    ("kind", "lag_s"),
    [
        (lib.SENSOR_MPU9250, 0.005),
        (lib.SENSOR_LSM9DS0, 0.001),
        (lib.SENSOR_LSM6DSOX, 0.005629),
        (lib.SENSOR_LSM6DSV16X, 0.005726),
    ],
)
def test_the_lag_that_each_magnetometer_starts_from(kind, lag_s):
    tracker = Tracker()
    identity = desk.identity_of(kind=kind)
    assert lib.delays_of_kind(identity)
    assert lib.pose_begin(tracker.c, desk.EXACT, identity, lib.FILTER_FUSE)
    lag_q35 = tracker.c.attitude.fuse.state.lag_s_q35
    assert lag_q35 / 2**35 == pytest.approx(lag_s, abs=1e-6)


@pytest.mark.parametrize("kind", [lib.SENSOR_NONE, lib.SENSOR_LSM6DSV16X + 1, 255])
def test_the_delays_of_a_kind_without_a_driver_are_not_known(kind):
    assert not lib.delays_of_kind(desk.identity_of(kind=kind))


def test_the_first_pose_knows_nothing_and_says_so():
    tracker = Tracker()
    poses, _ = tracker.feel(felt(at_rest(0.005)).samples(MPU9250))
    assert poses["pose_flags"][0] == (
        lib.POSE_STARTING
        | lib.POSE_UNCALIBRATED
        | lib.POSE_MAG_ABSENT
        | lib.POSE_HEADING_FREE
    )
    assert poses["tilt_sigma"][0] == poses["heading_sigma"][0] == NOT_KNOWN


def test_position_and_normal_are_not_available():
    poses, _ = Tracker().feel(felt(at_rest(1)).samples(MPU9250))
    assert (poses["position"] == -(2**31)).all()
    assert (poses["normal"] == -(2**15)).all()


def test_sigmas_are_null_while_starting_and_known_afterwards():
    poses, _ = Tracker().feel(felt(at_rest(6)).samples(MPU9250))
    starting = has(poses, lib.POSE_STARTING)
    # Until the calibration, then while the field of the place is learned.
    assert starting.tolist() == [True] * 907 + [False] * 293
    assert ((poses["heading_sigma"] == NOT_KNOWN) == starting).all()
    # The tilt does not wait for the field of the place.
    levelled = np.flatnonzero(poses["tilt_sigma"] != NOT_KNOWN)
    assert levelled.tolist() == list(range(levelled[0], 1200))
    assert lib.CALIBRATOR_SAMPLES < levelled[0] < 540
    for name in ("tilt_sigma", "heading_sigma"):
        assert poses[name][907] < 500  # 5 degrees


def test_the_calibration_comes_once_after_its_window_and_removes_the_bias():
    bias = (5.0, -8.0, 3.0)
    tracker = Tracker()
    samples = felt(at_rest(10), gyr_bias_deg_s=bias).samples(MPU9250)
    poses, results = tracker.feel(samples)
    done = lib.CALIBRATOR_SAMPLES - 1
    assert np.flatnonzero(results).tolist() == [done]
    assert results[done] == lib.POSE_CALIBRATED
    uncalibrated = has(poses, lib.POSE_UNCALIBRATED)
    assert uncalibrated[:done].all()
    assert not uncalibrated[done:].any()
    found = tracker.c.attitude.fuse.state.calibrated_rad_s_q25
    found_deg_s = np.array([found.x, found.y, found.z]) / desk.RATE / DEGREE
    assert np.abs(found_deg_s - bias).max() < 0.02
    level = np.tile(rotation.IDENTITY, (len(poses), 1))
    assert desk.tilt_deg(poses["q"], level)[-1] < 0.5
    assert has(poses, lib.POSE_AT_REST)[-1]


def test_motion_before_the_calibration_is_reported_and_delays_it():
    samples = felt(at_rest(6)).samples(MPU9250)
    samples["gyr"][300:310, 1] += 800
    poses, results = Tracker().feel(samples)
    moved = np.flatnonzero(results == lib.POSE_MOVED)
    assert moved.tolist() == list(range(300, 310))
    done = 309 + lib.CALIBRATOR_SAMPLES
    assert results[done] == lib.POSE_CALIBRATED
    assert has(poses, lib.POSE_UNCALIBRATED)[done - 1]
    assert not has(poses, lib.POSE_UNCALIBRATED)[done]


@pytest.mark.parametrize(
    ("field", "flag"),
    [
        ("acc_clipped", lib.POSE_CLIPPED),
        ("gyr_clipped", lib.POSE_CLIPPED),
        ("has_gap", lib.POSE_GAP),
    ],
)
def test_a_flag_of_one_sample_stands_in_the_next_pose_and_in_no_other(field, flag):
    samples = felt(at_rest(0.1)).samples(MPU9250)
    samples[field][3] = True
    tracker = Tracker()
    tracker.step(samples[:3])
    assert not tracker.read().pose_flags & flag
    tracker.step(samples[3:10])  # six samples later
    assert tracker.read().pose_flags & flag
    assert not tracker.read().pose_flags & flag
    tracker.step(samples[10:])
    assert not tracker.read().pose_flags & flag


def test_clipping_is_not_a_gap_nor_a_gap_clipping():
    samples = felt(at_rest(0.015)).samples(MPU9250)
    samples["gyr_clipped"][1] = True
    samples["has_gap"][2] = True
    poses, _ = Tracker().feel(samples)
    assert has(poses, lib.POSE_CLIPPED).tolist() == [False, True, False]
    assert has(poses, lib.POSE_GAP).tolist() == [False, False, True]


def test_a_magnet_and_a_lost_magnetometer_are_flagged():
    motion = felt(at_rest(20))
    motion.mag[2000:3000] += (40, 0, 30)
    motion.has_mag[3000:] = False
    poses, _ = Tracker().feel(motion.samples(MPU9250))
    assert not has(poses, lib.POSE_MAG_DISTURBED)[600:2000].any()
    assert has(poses, lib.POSE_MAG_DISTURBED)[2200:3000].all()
    assert not has(poses, lib.POSE_MAG_ABSENT)[40:3000].any()
    assert has(poses, lib.POSE_MAG_ABSENT)[3240:].all()


def test_a_gap_in_time_is_integrated_and_flagged():
    motion = felt(at_rest(4), noise=0)
    motion.has_mag[:] = False
    motion.gyr[700, 2] = 100 * DEGREE
    samples = motion.samples(MPU9250)
    samples["time_us"][700:] += 40_000
    samples["has_gap"][700] = True
    poses, _ = Tracker().feel(samples)
    assert has(poses, lib.POSE_GAP)[700]
    # 45 ms of 100 deg/s.
    turned = desk.apart_deg(poses["q"][699:700], poses["q"][701:702])[0]
    assert turned == pytest.approx(4.5, abs=0.02)


def test_after_a_long_gap_the_orientation_is_found_anew_and_the_bias_is_kept():
    over = rotation.from_rotation_vector(np.array([2.0, 0.0, 0.0]))
    quat = np.vstack([at_rest(6), at_rest(6, quat=over)])
    motion = felt(quat, noise=0)
    motion.gyr[:] = np.array([0.5, -0.4, 0.3]) * DEGREE  # nothing but a bias
    samples = motion.samples(MPU9250)
    samples["time_us"][1200:] += 400_000
    poses, _ = Tracker().feel(samples)
    assert not has(poses, lib.POSE_STARTING)[1199]
    assert has(poses, lib.POSE_STARTING)[1200]
    assert poses["tilt_sigma"][1200] == NOT_KNOWN
    assert desk.apart_deg(poses["q"][1220:1221], over * ONE)[0] < 1.0
    assert desk.apart_deg(poses["q"][-1:], over * ONE)[0] < 0.2
    assert not has(poses, lib.POSE_UNCALIBRATED)[1200]


def test_nothing_depends_on_when_the_first_sample_comes():
    motion = felt(tumble(8, 200, 1))
    first, _ = Tracker().feel(motion.samples(MPU9250))
    for start_us in (1, 123_456_789, 2**32 - 1_000_000):
        samples = motion.samples(MPU9250)
        samples["time_us"] += np.uint32(start_us)
        again, _ = Tracker().feel(samples)
        assert np.array_equal(first, again)


# The origin.


@pytest.fixture
def turned() -> tuple[Tracker, Tracker, desk.Array]:
    """Two trackers after the same motion, and what comes next."""
    samples = felt(tumble(16, 200, 21), sway_m_s2=0.5).samples(MPU9250)
    trackers = Tracker(), Tracker()
    for tracker in trackers:
        tracker.feel(samples[:2000])
    return *trackers, samples[2000:]


def test_at_the_full_origin_the_pose_is_the_identity(turned):
    tracker, _, _ = turned
    assert desk.apart_deg(tracker.quat(), rotation.IDENTITY) > 20
    tracker.set_origin(FULL)
    pose = tracker.read()
    assert np.abs(np.array(list(pose.q)) - [2**30, 0, 0, 0]).max() <= 8
    assert pose.pose_flags & lib.POSE_TARED


def test_from_the_full_origin_on_the_pose_is_the_turn_since_then(turned):
    tared, plain, samples = turned
    origin = plain.quat()
    tared.set_origin(FULL)
    poses, _ = tared.feel(samples)
    truth, _ = plain.feel(samples)
    wanted = rotation.multiply(truth["q"] / ONE, rotation.inverse(origin))
    assert np.abs(poses["q"] / ONE - wanted).max() < 2e-8
    assert desk.apart_deg(wanted[:1], wanted[-1:])[0] > 20
    assert has(poses, lib.POSE_TARED).all()


def test_the_heading_origin_takes_the_heading_alone(turned):
    tared, plain, samples = turned
    x_axis = np.array([1.0, 0, 0])
    tared.set_origin(HEADING)
    ahead = rotation.rotate(tared.quat(), x_axis)
    assert abs(np.arctan2(ahead[1], ahead[0])) < 1e-5
    before = rotation.rotate(plain.quat(), x_axis)
    back = rotation.from_heading_pitch_roll(-np.arctan2(before[1], before[0]), 0, 0)
    poses, _ = tared.feel(samples)
    truth, _ = plain.feel(samples)
    wanted = rotation.multiply(back, truth["q"] / ONE)
    assert desk.apart_deg(poses["q"], wanted).max() < 1e-3
    assert desk.tilt_deg(poses["q"], truth["q"]).max() < 1e-5
    assert has(poses, lib.POSE_TARED).all()


def test_an_origin_that_is_undone_leaves_no_trace(turned):
    tared, plain, samples = turned
    tared.set_origin(FULL)
    tared.set_origin(HEADING)
    tared.set_origin(NONE)
    assert np.array_equal(tared.feel(samples)[0], plain.feel(samples)[0])


def test_an_origin_set_again_replaces_the_one_before(turned):
    tared, other, samples = turned
    tared.set_origin(HEADING)
    for tracker in (tared, other):
        tracker.feel(samples[:100])
        tracker.set_origin(FULL)
    assert np.array_equal(tared.feel(samples[100:])[0], other.feel(samples[100:])[0])


# The same bits.


def test_two_runs_give_the_same_bits_whatever_memory_held_before():
    samples = felt(tumble(60, 200, 31), seed=4).samples(MPU9250)
    samples["has_gap"][[1500, 9000]] = True
    first, results = Tracker().feel(samples)
    assert lib.POSE_CALIBRATED in results
    for fill in (0, 0xA5, 0xFF):
        again, same = Tracker(fill).feel(samples)
        assert np.array_equal(first, again)
        assert np.array_equal(results, same)


def test_reading_a_pose_changes_none_but_the_latched_flags():
    samples = felt(tumble(10, 200, 32)).samples(MPU9250)
    often, seldom = Tracker(), Tracker()
    poses, _ = often.feel(samples)
    seldom.step(samples)
    assert list(seldom.read().q) == poses["q"][-1].tolist()
