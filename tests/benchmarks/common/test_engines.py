# SPDX-License-Identifier: MIT
"""Every engine on a motion of our own, whose attitude is known exactly."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.common import engines, feed, scoring
from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.virtual import motion

HOUSE = ("fuse", "complementary", "mahony", "madgwick", "dcm_pi")


@cache
def turned() -> motion.Motion:
    """Level at a heading of 120 degrees, then 30 degrees about each axis, at rest after
    each: an engine whose world is not east, north, up is far off.
    """
    rate_hz, hold = 300.0, 3.0
    start = rotation.from_heading_pitch_roll(np.radians(120.0), 0.0, 0.0)
    quats, here = [np.tile(start, (round(20 * rate_hz), 1))], start
    step = np.linspace(0.0, 1.0, round(rate_hz))[:, None]
    smooth = step**3 * (10.0 - 15.0 * step + 6.0 * step**2)
    for axis in np.eye(3):
        turn = rotation.from_rotation_vector(smooth * axis * np.radians(30.0))
        quats.append(rotation.multiply(here, turn))
        here = quats[-1][-1]
        quats.append(np.tile(here, (round(hold * rate_hz), 1)))
    quat = np.concatenate(quats)
    back = rotation.inverse(quat)
    ahead = rotation.multiply(back[:-1], quat[1:])
    rate = rotation.to_rotation_vector(ahead) * rate_hz
    count = len(quat)
    up = np.tile([0.0, 0.0, GRAVITY_M_S2], (count, 1))
    field = np.tile([0.0, 20.0, -44.0], (count, 1))
    noise = np.random.default_rng(1).standard_normal((2, count, 3))
    return motion.Motion(
        rate_hz,
        gyr=np.concatenate([rate, np.zeros((1, 3))]),
        acc=rotation.rotate(back, up) + 0.02 * noise[0],
        mag=rotation.rotate(back, field) + 0.3 * noise[1],
        quat=quat,
        movement=np.arange(count) > 18 * rate_hz,
    )


@cache
def fed() -> feed.Feed:
    return feed.sampled(turned())


@pytest.mark.parametrize("name", engines.ENGINES)
def test_each_engine_answers_in_the_same_world(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "FUSION_GAIN", 0.5)  # settles within these seconds
    found = engines.ENGINES[name](fed())
    assert len(found.times_s) == len(found.quats)
    assert np.linalg.norm(found.quats, axis=1) == pytest.approx(1.0, abs=1e-3)
    known = np.arange(len(turned())) / turned().rate_hz
    assert turned().quat is not None
    # At rest after the last turn, when even the slowest has settled.
    late = found.times_s > turned().seconds - 1.0
    truth = rotation.interpolate(found.times_s[late], known, turned().quat)
    assert scoring.errors(found.quats[late], truth).total.max() < 2.0


def test_the_filters_of_the_house_are_five_and_not_one() -> None:
    found = [engines.core(fed(), name).quats for name in HOUSE]
    for index, one in enumerate(found):
        for other in found[:index]:
            assert np.abs(one - other).max() > 1e-6


def test_poses_come_after_the_samples_that_the_probe_sent_them_after() -> None:
    made = fed()
    contents = engines.replayed(made, "fuse")
    rows = engines.wire.to_rows("pose", contents)
    assert rows["sequence"].tolist() == list(made.pose_sequence)
    assert rows["time_us"].tolist() == made.rows["time_us"][1::2].tolist()


def test_a_sigma_that_is_not_stated_is_not_a_number() -> None:
    made = fed()
    found = engines.core(made, "fuse")
    # Nothing has told the heading yet, then the magnetometer does.
    assert np.isnan(found.heading_sigma_deg[0])
    assert np.isfinite(found.heading_sigma_deg[-1])
