# SPDX-License-Identifier: MIT
"""Chains of segments, alignment, headings in step, angles, the path of a foot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imud import rotation
from imud.body import (
    angles,
    chain,
    contact,
    heading,
    hinge,
    level,
    mounting,
    posture,
    tracks,
)
from imud.body.hinge import AlignmentRefused
from imud.body.tracks import Track
from imud.errors import ConfigError
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

STEP = 10  # records of the leg at 100 Hz
BODY = chain.read(leg.CHAIN, "leg.toml")
EXACT = leg.Manner(walk_s=9.0, wobble_deg=0.0, play_deg=0.0, is_disturbed=False)
LOOSE = leg.Manner(walk_s=9.0)


@cache
def leg_of(manner: leg.Manner, seed: int = 1) -> leg.Leg:
    return leg.made(seed, manner)


@cache
def tracks_of(manner: leg.Manner, every: int = STEP) -> Mapping[str, Track]:
    """True attitudes with headings that differ, and what the sensors measure."""
    found = {}
    for turn, (name, motion) in enumerate(leg_of(manner).motions.items()):
        times_s = np.arange(0, len(motion), every) / RATE_HZ
        wrong = heading.about_up(np.full(len(times_s), math.radians(20.0 * turn)))
        sigma = np.full((2, len(times_s)), math.radians(1.0))
        bias = level.biases(motion.gyr, motion.acc, RATE_HZ)
        found[name] = Track(
            times_s,
            rotation.multiply(wrong, motion.quat[::every]),
            (motion.gyr - bias)[::every],
            sigma[0],
            sigma[1] + math.radians(20.0),
            motion.acc[::every],
        )
    return found


def parts(
    found: Mapping[str, Track], stages: leg.Stages
) -> tuple[dict[str, Track], dict[str, Track]]:
    """Of standing, and of the motion that aligns."""
    span = stages["squat"][0], stages["raise"][1]
    return (
        {name: each.between(1.0, 5.0) for name, each in found.items()},
        {name: each.between(*span) for name, each in found.items()},
    )


def rms_deg(found: FloatArray, truth: FloatArray) -> float:
    return float(np.degrees(np.sqrt(np.nanmean((found - truth) ** 2))))


SHANK_PROBE = 'probe = "shank"'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (SHANK_PROBE, 'probe = "thigh"', r"leg:12: .*thigh is already on thigh"),
        ('parent = "thigh"', 'parent = "foot"', "a cycle: shank > foot > shank"),
        (
            'parent = "thigh"',
            'parent = "hip"',
            "no segment hip, only thigh, shank",
        ),
        ('parent = "thigh"\n', "", "it has no parent, like thigh"),
        ('joint = "knee"', 'joint = "kneee"', '"kneee" is not "hip", "knee"'),
        ('joint = "knee"', 'at = "hole"', "thigh has no mark hole, only end"),
        (
            "length_m = 0.42",
            "lenght_m = 0.42",
            r"did you mean \[segments.thigh\] length_m",
        ),
        ("length_m = 0.42", "length_m = -1.0", "is not a number"),
        ("probe =", "# probe =", "no segment has a probe"),
        (leg.CHAIN, "", "it has no segments"),
        (leg.CHAIN, "[", "is not TOML"),
        ('name = "right-leg"', 'name = "a/b"', r"leg:1: name: use only letters"),
        (SHANK_PROBE, 'probe = ["a", "b"]', "probe: .* is not text"),
        (SHANK_PROBE, 'probe = "a"\nprobe = "b"', "is not TOML"),
    ],
)
def test_an_impossible_chain_is_reported_on_one_line(old: str, new: str, words: str):
    with pytest.raises(ConfigError, match=words) as caught:
        chain.read(leg.CHAIN.replace(old, new), "leg")
    assert "\n" not in str(caught.value)


def test_a_tree_may_branch_at_marks():
    text = """[segments.pelvis]
    probe = "p"
    marks = {left = [0.0, 0.0, -0.1], right = [0.0, 0.0, 0.1]}
    [segments.a]
    parent = "pelvis"
    at = "left"
    length_m = 0.4
    [segments.b]
    parent = "pelvis"
    at = "right"
    """
    body = chain.read(text, "tree")
    upright = np.array([[1.0, 0, 0, 0]])
    found = posture.places(body, {each.name: upright for each in body.segments})
    assert found["a.end"].tolist() == [[0.0, -0.4, -0.1]]
    assert found["b.start"].tolist() == [[0.0, 0.0, 0.1]]


def test_angles_are_those_that_made_the_turn():
    random = np.random.default_rng(3)
    given = random.uniform(-1.2, 1.2, (50, 3))
    joint = chain.JOINTS["knee"]
    parent = rotation.from_rotation_vector(random.normal(0.0, 1.0, (50, 3)))
    for side in ("right", "left"):
        child = rotation.multiply(parent, angles.from_angles(given, joint, side))
        found = angles.joint_angles(parent, child, joint, side)
        np.testing.assert_allclose(found, given, atol=1e-9)


def test_a_knee_that_bends_back_and_a_hip_that_moves_out_are_positive():
    upright = rotation.IDENTITY
    back = rotation.from_rotation_vector(np.array([0.0, 0.0, -0.5]))
    knee = angles.joint_angles(upright, back, chain.JOINTS["knee"], "right")
    assert knee == pytest.approx([0.5, 0.0, 0.0])
    # About x ahead a right leg's end goes to the left, which is in; a left one's out.
    aside = rotation.from_rotation_vector(np.array([0.3, 0.0, 0.0]))
    hip = angles.joint_angles(upright, aside, chain.JOINTS["hip"], "left")
    assert hip == pytest.approx([0.0, 0.3, 0.0])


def test_a_motion_aligns_probes_whatever_way_they_sit():
    made, found = leg_of(EXACT), tracks_of(EXACT)
    standing, moving = parts(found, made.stages)
    aligned = mounting.by_motion(BODY, standing, moving)
    seen = posture.of(BODY, found, aligned.mounts)
    walking = seen.times_s > made.stages["walk"][0]
    at = np.arange(len(seen.times_s)) * STEP
    for joint in ("shank", "foot"):
        off = rms_deg(seen.angles[joint][walking], made.angles[joint][at][walking])
        assert off < 1.5, joint


@pytest.mark.nightly
def test_loose_probes_are_wrong_by_what_they_state():
    made, found = leg_of(LOOSE), tracks_of(LOOSE)
    aligned = mounting.by_motion(BODY, *parts(found, made.stages))
    seen = posture.of(BODY, found, aligned.mounts)
    walking = seen.times_s > made.stages["walk"][0]
    truth = made.angles["shank"][::STEP]
    off = np.abs(seen.angles["shank"] - truth)[walking, 0]
    assert 0.5 < np.degrees(np.sqrt((off**2).mean())) < 4.0
    assert (off < 1.96 * seen.sigmas["shank"][walking, 0]).mean() > 0.85


def test_a_probe_worn_upside_down_is_told_and_measured():
    made, found = leg_of(EXACT), dict(tracks_of(EXACT))
    aligned = mounting.by_motion(BODY, *parts(found, made.stages))
    assert not aligned.remarks
    # The usual probe has x up the leg: half a turn about its z turns it over.
    over = rotation.from_rotation_vector(np.array([0.0, 0.0, math.pi]))
    one = found["shank"]
    quat, gyr = rotation.multiply(one.quat, over), rotation.rotate(over, one.gyr)
    assert one.acc is not None
    found["shank"] = replace(
        one, quat=quat, gyr=gyr, acc=rotation.rotate(over, one.acc)
    )
    aligned = mounting.by_motion(BODY, *parts(found, made.stages))
    assert any("shank is upside down" in each for each in aligned.remarks)
    seen = posture.of(BODY, found, aligned.mounts)
    truth = made.angles["shank"][::STEP]
    assert rms_deg(seen.angles["shank"][:, 0], truth[:, 0]) < 1.5


def test_without_standing_still_nothing_is_aligned():
    found = tracks_of(LOOSE)
    walking = {name: each.between(30.0, 38.0) for name, each in found.items()}
    with pytest.raises(AlignmentRefused, match="stand still"):
        mounting.by_pose(BODY, walking, 0.0)
    none = {name: each.between(-2.0, -1.0) for name, each in found.items()}
    with pytest.raises(AlignmentRefused, match="no pose to align by"):
        mounting.by_pose(BODY, none, 0.0)


def test_standing_shows_no_hinge():
    standing, _ = parts(tracks_of(LOOSE), leg_of(LOOSE).stages)
    with pytest.raises(AlignmentRefused, match="thigh and shank: it turned at"):
        mounting.by_motion(BODY, standing, standing)


def test_left_and_right_need_no_heading():
    made, found = leg_of(EXACT), dict(tracks_of(EXACT))
    first, last = made.stages["walk"]
    one = found["foot"]
    # A heading that iron turned round, of which the probe states no doubt.
    turned = rotation.multiply(
        heading.about_up(np.full(len(one.quat), math.radians(150.0))), one.quat
    )
    found["foot"] = replace(one, quat=turned, heading_sigma=one.heading_sigma * 4.0)
    standing, moving = parts(found, made.stages)
    walking = {name: each.between(first, last) for name, each in found.items()}
    aligned = mounting.by_motion(BODY, standing, moving, walking=walking)
    seen = posture.of(BODY, found, aligned.mounts)
    truth = made.angles["foot"][::STEP]
    rows = seen.times_s > first
    assert rms_deg(seen.angles["foot"][rows, 0], truth[rows, 0]) < 1.5


def test_two_free_probes_are_no_hinge():
    random = np.random.default_rng(1)
    with pytest.raises(AlignmentRefused, match="no hinge fits"):
        hinge.axis(random.normal(0, 3, (500, 3)), random.normal(0, 3, (500, 3)), 100.0)


def test_a_centre_is_found_from_forces():
    random = np.random.default_rng(2)
    rate_hz, count = 200.0, 2000
    t = np.arange(count) / rate_hz
    joint = np.stack([np.sin(t), np.cos(2 * t), 9.8 + np.sin(3 * t)], 1)
    given = []
    for place in ((0.1, -0.2, 0.05), (-0.15, 0.1, 0.0)):
        waves = random.uniform(1.0, 6.0, (3, 3))
        gyr = np.stack([np.sin(np.outer(t, w)).sum(1) for w in waves], 1) * 1.5
        quat = level.strapdown(gyr, rate_hz)
        force = rotation.rotate(rotation.inverse(quat), joint)
        change = np.gradient(gyr, 1 / rate_hz, axis=0)
        arm = -np.array(place)
        force = force + np.cross(change, arm) + np.cross(gyr, np.cross(gyr, arm))
        given.append((gyr, force))
    found = hinge.centre(given[0], given[1], rate_hz)
    np.testing.assert_allclose(found.parent, (0.1, -0.2, 0.05), atol=0.01)
    np.testing.assert_allclose(found.child, (-0.15, 0.1, 0.0), atol=0.01)
    still = [(gyr * 1e-3, force) for gyr, force in given]
    with pytest.raises(AlignmentRefused, match="move it faster"):
        hinge.centre(still[0], still[1], rate_hz)


def test_a_missing_probe_is_missing_and_never_still():
    found = tracks_of(LOOSE)
    gone = {name: each for name, each in found.items()}
    one = gone["shank"]
    kept = (one.times_s < 10.0) | (one.times_s > 11.0)
    times_s = one.times_s
    gone["shank"] = tracks.joined(one_of(one, kept), times_s)
    seen = posture.of(
        BODY,
        gone,
        mounting.by_pose(BODY, parts(found, leg_of(LOOSE).stages)[0], 0.0).mounts,
    )
    is_lost = (times_s > 10.01) & (times_s < 10.99)
    assert np.isnan(seen.angles["shank"][is_lost]).all()
    assert np.isnan(seen.quats["shank"][is_lost]).all()
    assert np.isnan(seen.angles["foot"][is_lost]).all()
    assert np.isfinite(seen.quats["thigh"][is_lost]).all()
    assert np.isfinite(seen.angles["foot"][times_s > 11.02]).all()


def one_of(track: Track, rows: FloatArray) -> Track:
    return Track(
        track.times_s[rows],
        track.quat[rows],
        track.gyr[rows],
        track.tilt_sigma[rows],
        track.heading_sigma[rows],
        track.acc[rows],
    )


def test_strides_are_as_long_as_they_are():
    made, foot = leg_of(LOOSE), tracks_of(LOOSE, 5)["foot"]
    first, last = made.stages["walk"]
    walked = contact.path(foot.between(first - 1.0, last + 1.0))
    at = [round(walked.times_s[(a + b) // 2] * RATE_HZ) for a, b in walked.rests]
    truth = np.linalg.norm(np.diff(made.ankle[at], axis=0)[:, :2], axis=1)
    assert len(truth) >= 6
    np.testing.assert_allclose(walked.strides, truth, rtol=0.03)
    with pytest.raises(ValueError, match="needs raw samples"):
        contact.path(replace(foot, acc=None))


@pytest.mark.parametrize("rate_hz", [40, 100])
def test_raw_samples_become_attitudes_from_40_hz_up(rate_hz: int):
    motion = leg_of(LOOSE).motions["shank"]
    every = round(RATE_HZ / rate_hz)
    mean = motion.gyr[: len(motion) // every * every].reshape(-1, every, 3).mean(1)
    # A sensor's own low-pass: the mean around each sample.
    acc = motion.acc[: len(mean) * every].reshape(-1, every, 3).mean(1)
    found = level.attitudes(mean, acc, RATE_HZ / every)
    truth = motion.quat[every // 2 :: every][: len(mean)]
    up = np.array([0.0, 0.0, 1.0])
    seen, real = (
        rotation.rotate(rotation.inverse(each), up) for each in (found.quat, truth)
    )
    off = np.degrees(np.arccos(np.clip((seen * real).sum(1), -1.0, 1.0)))
    assert np.sqrt((off**2).mean()) < 3.0


def test_fewer_samples_than_40_a_second_are_refused():
    with pytest.raises(ValueError, match="40 are needed"):
        level.attitudes(np.zeros((90, 3)), np.ones((90, 3)), 30.0)


def test_poses_alone_have_rates():
    turning = np.outer(np.arange(200) * 0.01, [0.3, -0.2, 0.5])
    none = np.zeros(200)
    quat = rotation.from_rotation_vector(turning)
    found = tracks.of_poses(np.arange(200) * 0.01, quat, none, none)
    np.testing.assert_allclose(
        found.gyr, np.broadcast_to([0.3, -0.2, 0.5], (200, 3)), atol=1e-9
    )
