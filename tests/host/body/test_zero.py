# SPDX-License-Identifier: MIT
"""The zero of joints whose axis is upright in the pose that they are zeroed in."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.limb import chains, made_chain
from imud import rotation
from imud.body import chain, fused, heading, live, session, state, tracks
from imud.rotation import FloatArray
from length import choose

RATE_HZ = 100.0
UTC_S = 1.7e9
UP = np.array([0.0, 0.0, 1.0])
GRAVITY = np.array([0.0, 0.0, 9.80665])
PAIR = """
name = "pair"
[segments.one]
probe = "one"
[segments.two]
parent = "one"
joint = "hinge"
probe = "two"
"""


@pytest.mark.long
def test_hinges_that_were_upright_at_the_start_state_their_error():
    scored = []
    for seed in choose(everyday=(20,), long=(20, 21, 22)):
        made = made_chain.made(seed, made_chain.ARM, 40.0, is_upright=True)
        found = chains.analysed(made)
        scored += [each for each in chains.scored(made, found) if each.kind == "hinge"]
    inside = [each.inside for each in scored]
    assert np.mean(inside) > 0.9
    # And it is not hidden behind a large one.
    assert np.mean([each.rms for each in scored]) < 6.0


@pytest.mark.nightly
def test_hinges_on_foam_state_their_error():
    """Foam sags with gravity: two probes turn alike for seconds, which looks like a
    heading, and about the axis by more than across it.
    """
    scored = []
    for seed in (20, 21):
        made = made_chain.made(seed, made_chain.ARM, 40.0, is_loose=True)
        found = chains.scored(made, chains.analysed(made))
        scored += [each for each in found if each.kind == "hinge"]
    errors = np.array([each.rms for each in scored])
    # A correction of the heading by the axis alone reaches 4 to 7 degrees.
    assert errors.max() < 7.0
    assert np.mean([each.inside for each in scored]) > 0.9
    assert np.mean([each.stated for each in scored]) < 2.0 * errors.mean()


def felt(turn: FloatArray) -> tracks.Track:
    """What a calibrated probe feels that only turns, world_from_probe (n, 4)."""
    times_s = np.arange(len(turn)) / RATE_HZ
    step = rotation.multiply(rotation.inverse(turn[:-1]), turn[1:])
    gyr = np.gradient(
        np.cumsum(
            np.concatenate([np.zeros((1, 3)), rotation.to_rotation_vector(step)]), 0
        ),
        1.0 / RATE_HZ,
        axis=0,
    )
    back = rotation.inverse(turn)
    random = np.random.default_rng(len(turn))
    acc = rotation.rotate(back, GRAVITY) + random.normal(0.0, 0.02, gyr.shape)
    gyr += random.normal(0.0, 1e-3, gyr.shape)
    return fused.attitudes(times_s, gyr, acc, np.full_like(gyr, np.nan))


@cache
def leaning_late(leans_rad: float) -> tuple[dict[str, tracks.Track], FloatArray]:
    """Two segments with an upright hinge: they rest, bend upright, rest, then lean from
    25 s on while they bend; and the true angle.
    """
    t = np.arange(int(50 * RATE_HZ)) / RATE_HZ
    moves = np.clip(t - 6.0, 0.0, 1.0) * np.clip(18.0 - t, 0.0, 1.0)
    moves = moves + np.clip(t - 25.0, 0.0, 1.0)
    lean = leans_rad * np.clip((t - 25.0) / 5.0, 0.0, 1.0)
    first = rotation.multiply(
        rotation.from_rotation_vector(np.outer(lean, [1.0, 0.0, 0.0])),
        rotation.from_rotation_vector(np.outer(0.4 * np.sin(t) * moves, UP)),
    )
    bend = 0.8 * np.sin(1.7 * t) * moves
    second = rotation.multiply(first, rotation.from_rotation_vector(np.outer(bend, UP)))
    return {"one": felt(first), "two": felt(second)}, bend


def analysed(found: dict[str, tracks.Track]) -> session.BodyAnalysis:
    return session.of(chain.read(PAIR, "pair"), found)


def test_a_zero_that_no_motion_shows_is_withheld_with_the_motion_that_would():
    found = analysed(leaning_late(0.0)[0])
    assert np.isnan(found.posture.angles["two"]).all()
    assert np.isnan(found.posture.sigmas["two"]).all()
    assert any(
        "two: the zero of its angle is unknown: turn the whole limb until the axis "
        "between one and two is level" in each
        for each in found.remarks
    )


def test_motion_shows_the_zero_later():
    found = analysed(leaning_late(1.2)[0])
    assert np.isfinite(found.posture.angles["two"]).mean() > 0.9
    assert not any("zero" in each for each in found.remarks)


def restarted(found: dict[str, tracks.Track]) -> dict[str, tracks.Track]:
    """The same, but the second probe says nothing for 4.3 s before the lean, and then
    has another heading.
    """
    track = found["two"]
    quat = rotation.multiply(heading.about_up(np.array(1.0)), track.quat)
    quat[track.times_s < 20.0] = track.quat[track.times_s < 20.0]
    is_there = (track.times_s < 20.0) | (track.times_s >= 24.3)
    return {**found, "two": replace(track, quat=quat).rows(is_there)}


def told_live(
    found: dict[str, tracks.Track],
) -> list[tuple[float, state.BodyState]]:
    """What a live body says of the tracks, some times a second."""
    body, told = live.LiveBody(chain.read(PAIR, "pair")), []
    for moment, time_s in enumerate(found["one"].times_s.tolist()):
        for name, track in found.items():
            for row in np.flatnonzero(track.times_s == time_s).tolist():
                w, x, y, z = track.quat[row].tolist()
                sigmas = float(track.tilt_sigma[row]), float(track.heading_sigma[row])
                body.histories[name].add_pose(UTC_S + time_s, (w, x, y, z), sigmas)
                p, q, r = track.gyr[row].tolist()
                a, b, c = track.acc[row].tolist()
                body.histories[name].add_raw(UTC_S + time_s, (p, q, r), (a, b, c))
        if moment % 20 == 0:
            told.append((time_s - live.DELAY_S, body.state(UTC_S + time_s)))
    return told


def test_a_live_zero_is_withheld_until_motion_shows_it_and_right_from_then_on():
    found, bend = leaning_late(1.2)
    told = told_live(found)
    aligned = [(time_s, each) for time_s, each in told if each.stage == "running"]
    early = [each for time_s, each in aligned if time_s < 25.0]
    assert early
    assert all(each.joints[0].angles_deg is None for each in early)
    assert all("the zero of its angle" in each.remarks[0] for each in early)
    late = [(time_s, each) for time_s, each in aligned if time_s > 38.0]
    assert not any(each.remarks for _, each in late)
    off, sigmas = [], []
    for time_s, each in late:
        angles, stated = each.joints[0].angles_deg, each.joints[0].sigmas_deg
        truth = math.degrees(float(np.interp(time_s, found["one"].times_s, bend)))
        off.append(angles["angle"] - truth)
        sigmas.append(stated["angle"])
    assert np.sqrt(np.mean(np.square(off))) < 5.0
    assert (np.abs(off) < 1.96 * np.array(sigmas)).mean() > 0.9


def test_no_motion_after_a_restart_shows_the_zero_before_it():
    posed = analysed(restarted(leaning_late(1.2)[0])).posture
    assert np.isnan(posed.angles["two"]).all()


def test_the_search_for_a_live_zero_ends_when_a_probe_falls_silent():
    told = told_live(restarted(leaning_late(1.2)[0]))
    after = [each for time_s, each in told if time_s > 24.5]
    assert all(each.joints[0].angles_deg is None for each in after)
    assert all(each.remarks.count(live.LOST) == 1 for each in after)


def test_a_live_zero_that_nothing_shows_is_said_to_stay_unknown(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(live, "ALIGN_S", 30.0)
    told = told_live(leaning_late(0.0)[0])
    last = told[-1][1]
    assert last.joints[0].angles_deg is None
    assert live.LOST in last.remarks


@pytest.mark.parametrize("turn_rad", [0.3, -0.5])
def test_the_slide_of_a_filter_is_no_turn_of_its_probe(turn_rad: float):
    """A filter that learns where north is turns its poses, and rates say no turn."""
    t = np.arange(int(10 * RATE_HZ)) / RATE_HZ
    slide = turn_rad * np.clip((t - 3.0) / 4.0, 0.0, 1.0)
    quat = rotation.from_rotation_vector(np.outer(slide + 0.5 * np.sin(t), UP))
    gyr = np.outer(0.5 * np.cos(t), UP)
    none = np.full(len(t), 0.01)
    found = tracks.slides(tracks.Track(t, quat, gyr, none, none))
    np.testing.assert_allclose(found, slide, atol=0.01)
