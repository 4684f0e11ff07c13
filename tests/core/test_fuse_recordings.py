# SPDX-License-Identifier: MIT
"""The filter on recordings with optical truth."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.common import scoring
from core import desk
from core.desk import ONE, lib
from core.fuse_desk import rms, twin
from core.scenes import Filter, Scene
from imud.virtual import motion, sensors


def read_by_the_chip(recording: motion.Motion, rate_hz: int = 200) -> Scene:
    """What an MPU-9250 would give: means over its low-pass's window, at its rate."""
    records = len(recording)
    known = np.arange(records) / recording.rate_hz
    t = np.arange(int(records / recording.rate_hz * rate_hz)) / rate_hz
    half = sensors.NOISE_WINDOW_S / 2
    edges = np.clip([t - half, t + half], 0, known[-1])

    def mean(rows: desk.Array) -> desk.Array:
        area = np.concatenate([np.zeros((1, 3)), (rows[1:] + rows[:-1]) / 2])
        area = np.cumsum(area, axis=0) / recording.rate_hz
        low, high = (
            np.stack([np.interp(edge, known, column) for column in area.T], axis=1)
            for edge in edges
        )
        return (high - low) / (edges[1] - edges[0])[:, None]

    # A reading of the magnetometer is 3 ms old on the average.
    nearest = np.rint((t - 0.0031).clip(0) * recording.rate_hz).astype(int)
    return Scene(
        rate_hz,
        mean(recording.gyr),
        mean(recording.acc),
        recording.mag[nearest.clip(0, records - 1)],
        has_mag=np.arange(len(t)) % (rate_hz // 100) == 1,
        quat=np.zeros((len(t), 4)),
    )


@pytest.mark.parametrize(
    "name", ["07_undisturbed_fast_rotation_B", "28_disturbed_stationary_magnet_A"]
)
def test_fixed_point_is_within_0_01_degrees_of_doubles_on_a_recording(
    shared_data, name
):
    felt = read_by_the_chip(motion.load(shared_data / "broad" / f"{name}.npz"))
    found, _, _ = Filter(200).feel(felt)
    assert rms(desk.apart_deg(found, twin(felt))) < 0.01


@pytest.mark.parametrize(
    ("name", "total_deg", "inclination_deg"),
    [
        ("07_undisturbed_fast_rotation_B", 1.5, 0.7),
        ("28_disturbed_stationary_magnet_A", 2.5, 1.2),
    ],
)
def test_a_recording_is_followed_within_degrees(
    shared_data, name, total_deg, inclination_deg
):
    recording = motion.load(shared_data / "broad" / f"{name}.npz")
    felt = read_by_the_chip(recording)
    identity = desk.identity_of()
    samples = felt.samples(identity)
    tracker = desk.ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, desk.EXACT, identity, lib.FILTER_FUSE)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    desk.call(lib.loop_pose, tracker, len(samples), samples, poses, results)
    assert lib.POSE_CALIBRATED in results
    times_s = np.arange(len(samples)) / felt.rate_hz
    score = scoring.score_at(times_s, poses["q"] / ONE, recording)
    assert score.total < total_deg
    assert score.inclination < inclination_deg
