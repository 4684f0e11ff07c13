# SPDX-License-Identifier: MIT
"""Rests and paths of feet that walk and run, with their errors."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.common.feed import sampled
from benchmarks.limb import feet, legs, made_gait
from benchmarks.limb.feet import track_of
from benchmarks.limb.made_gait import GAITS
from imud.body import contact, stance
from imud.body.contact import FootPath
from imud.body.feet import Foot
from imud.body.tracks import Track
from imud.body.zero_velocity import Clipped, Step, ZeroVelocity
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual import leg
from length import choose

STRIDES = 12
RUN = GAITS["run"]
SENSOR = made_gait.Sensor(stand_s=4.0)
UP = np.array([0.0, 0.0, GRAVITY_M_S2])
SIGNS = np.array([1.0, -1.0, 1.0])


@cache
def walked() -> tuple[made_gait.Walk, Track]:
    """A walk and track for all facts."""
    walk = made_gait.made(GAITS["walk"], 9, 33)
    return walk, track_of(walk)


def cut(track: Track, from_s: float, to_s: float) -> Track:
    """Without the samples in between."""
    return track.rows((track.times_s < from_s) | (track.times_s > to_s))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("name", "off_most"),
    [("run, bare", 0.015), ("in a room", 0.01), ("mixed, bare", 0.03)],
)
def test_a_runners_path_without_a_compass_is_right_within_what_it_states(
    name: str, off_most: float
):
    """Rests tell apart what scales and axes of a gyroscope do to it: before, a run was
    off by 3 % of its way, and a mixed one by 6 %.
    """
    scored = [feet.measure_case(feet.CASES[name], seed) for seed in (30, 31)]
    assert sum(e.found for e in scored) >= 0.98 * sum(e.rests for e in scored)
    assert np.mean([each.off for each in scored]) < off_most
    assert np.mean([each.inside for each in scored]) > 0.93


def test_a_foot_that_stands_at_the_end_stays_where_it_is():
    """It moved by 1.3 m when an accelerometer's bias was taken for a lean."""
    walk = made_gait.made(GAITS["walk"], STRIDES, 0, made_gait.BARE)
    found = contact.path(track_of(walk))
    first, last = found.rests[-1]
    assert found.times_s[last] - found.times_s[first] > 1.5
    assert np.linalg.norm(found.place[last] - found.place[first]) < 0.15


def test_each_sensor_has_a_range_of_its_own():
    values = np.random.default_rng(0).normal(0.0, 3.0, (100, 3))
    values[20:24, 0], values[50:53, 2] = -20.0, 30.0
    at_end = stance.clipped(values, 15.0)
    assert np.flatnonzero(at_end).tolist() == [20, 21, 22, 23, 50, 51, 52]
    assert not stance.clipped(values, 40.0).any()


def test_a_clipped_force_costs_no_heading():
    headings = []
    for clipped in (Clipped(force=True), Clipped(rate=True)):
        made = ZeroVelocity(np.array([1.0, 0.0, 0.0, 0.0]), 0.01, 0.0)
        for index in range(10):
            rate = np.array([0.0, 0.0, 0.8 * index])
            made.advance(0.005, rate, UP, Clipped() if index < 5 else clipped)
        headings.append(float(np.sqrt(made.covariance[8, 8])))
    assert headings[0] < 1e-2
    assert headings[1] > 0.03


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", GAITS)
def test_rests_are_found_and_the_stated_error_holds_from_strolling_to_sprinting(
    name: str,
):
    seeds = choose(everyday=(30, 31), long=(30, 31, 32))
    scored = [feet.measure(GAITS[name], seed, 20) for seed in seeds]
    assert sum(each.found for each in scored) >= 0.95 * sum(e.rests for e in scored)
    assert sum(each.false for each in scored) <= 1
    assert np.mean([each.off for each in scored]) < 0.03
    assert np.mean([each.inside for each in scored]) > 0.93
    true, stated = (
        np.hypot.reduce([getattr(each, key) for each in scored])
        for key in ("true_m", "stated_m")
    )
    assert stated < 3.0 * true


def test_a_fixed_threshold_finds_few_rests_of_who_runs():
    """What the threshold of a walk, 40 deg/s and 1.5 m/s2, makes of running."""
    walk = made_gait.made(RUN, STRIDES, 32, SENSOR)
    calm = np.linalg.norm(walk.gyr, axis=1) < np.radians(40.0)
    calm &= np.abs(np.linalg.norm(walk.acc, axis=1) - GRAVITY_M_S2) < 1.5
    edges = np.flatnonzero(np.diff(calm.astype(int), prepend=0, append=0))
    spans = [
        (walk.times_s[a], walk.times_s[b - 1])
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if walk.times_s[b - 1] - walk.times_s[a] >= 0.12
    ]
    met = [
        any(begin < end and stop > start for begin, stop in spans)
        for start, end in walk.contacts
    ]
    assert sum(met) <= 4
    assert feet.score(walk).found >= STRIDES


def test_missing_samples_end_what_is_known_and_are_said():
    walk, track = walked()
    middle_s = walk.contacts[6][1] + 0.2
    found = contact.path(cut(track, middle_s, middle_s + 0.4))
    after = found.times_s > middle_s + 0.4
    assert np.isnan(found.place[after]).all()
    assert np.isnan(found.sigmas[after]).all()
    assert len(found.rests) == 7
    assert any("0.4 s of samples are missing at" in each for each in found.remarks)


def test_few_missing_samples_cost_certainty_but_not_the_place():
    walk, track = walked()
    middle_s = walk.contacts[6][1] + 0.2
    whole = contact.path(track)
    found = contact.path(cut(track, middle_s, middle_s + 0.06))
    assert len(found.rests) == len(whole.rests)
    assert np.linalg.norm(found.place[-1] - whole.place[-1]) < 0.3


def test_a_long_time_without_rest_is_reported_with_the_position_error():
    walk = made_gait.made(RUN, STRIDES, 34, SENSOR)
    track = track_of(walk)
    # A foot that shakes while it stands, as on a machine: no rest in the air.
    shaken, random = track.gyr.copy(), np.random.default_rng(0)
    ends_s = walk.contacts[0][1], walk.contacts[-1][0]
    rows = (track.times_s > ends_s[0]) & (track.times_s < ends_s[1])
    shaken[rows] += random.normal(0.0, 6.0, (int(rows.sum()), 3))
    found = contact.path(replace(track, gyr=shaken))
    assert any(
        "no rest for" in each and "is then up to" in each for each in found.remarks
    )
    truth = walk.place - walk.place[0]
    off = np.abs(found.place - truth)[rows]
    assert (off[-1] < 3.0 * found.sigmas[rows][-1]).all()
    assert (np.diff(found.sigmas[rows][:, 0]) >= -1e-9).all()


def test_what_never_rests_has_no_place():
    count = 2000
    random = np.random.default_rng(1)
    track = Track(
        np.arange(count) / 200.0,
        np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        random.normal(0.0, 3.0, (count, 3)),
        np.full(count, 0.01),
        np.full(count, np.nan),
        random.normal(0.0, 5.0, (count, 3)) + UP,
    )
    found = contact.path(track)
    assert np.isnan(found.place).all()
    assert found.rests == ()
    assert found.remarks == ("it never rests, so its position is unknown",)


def test_an_even_glide_is_no_rest():
    """A foot carried at 0.5 m/s feels what one feels that stands."""
    rate_hz, glide_m_s = 200.0, 0.5
    stand, glide = 600, 100
    push = np.zeros((stand + 40 + glide, 3))
    push[stand : stand + 40, 0] = glide_m_s * rate_hz / 40.0
    count = len(push)
    track = Track(
        np.arange(count) / rate_hz,
        np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        np.zeros((count, 3)),
        np.full(count, 0.002),
        np.full(count, 0.01),
        push + UP,
    )
    found = contact.path(track.rows(np.arange(count) < stand + 40 + 30))
    assert len(found.rests) == 1
    assert found.place[-1][0] == pytest.approx(0.125, abs=0.02)


def test_live_and_recorded_feet_agree():
    walk = made_gait.made(GAITS["fast walk"], 6, 35, SENSOR)
    track = contact.faced(track_of(walk))
    assert track.acc is not None
    inside = np.zeros((len(track.gyr), 2))
    columns = [track.times_s[:, None], track.gyr, track.acc, inside]
    rows = np.concatenate(columns, axis=1)
    foot = Foot()
    for first in range(0, len(rows), 8):
        pose = track.quat[first], float(track.tilt_sigma[first])
        heading = float(track.heading_sigma[first])
        foot.update(rows[first : first + 8], (*pose, heading))
    found: FootPath = contact.path(track)
    state = foot.state()
    assert state.rests == len(found.rests)
    assert state.place_m is not None
    assert state.place_sigma_m is not None
    np.testing.assert_allclose(state.place_m, found.place[found.rests[-1][1]], atol=0.2)
    assert foot.remark() is None
    assert state.is_down


def test_a_live_foot_reports_a_missing_rest_and_restarts_after_a_loss():
    foot, pose = Foot(), (np.array([1.0, 0.0, 0.0, 0.0]), 0.01, float("nan"))
    times_s = np.arange(2000) / 200.0
    rows = np.zeros((2000, 9))
    rows[:, 0] = times_s
    rows[:, 6] = GRAVITY_M_S2
    rows[400:, 1] = 3.0 * np.sin(20.0 * times_s[400:])
    foot.update(rows, pose)
    remark = foot.remark()
    assert remark.startswith("no rest for 8 s: its position error is up to ")
    assert not foot.state().is_down
    rows[:100, 0] += times_s[-1] + 0.005
    sure = deepcopy(foot)
    sure.update(rows[:100], pose)
    rows[:100, 7] = 1.0
    foot.update(rows[:100], pose)
    assert foot.remark().startswith("beyond the range of its sensors")
    assert foot._walker.sigmas.max() > 2.0 * sure._walker.sigmas.max()
    foot.lose()
    assert foot.state().place_m is None
    assert foot.remark() is None


def test_poses_alone_tell_rests_and_no_places():
    foot = Foot()
    for index in range(100):
        foot.turn(index / 25.0, np.array([0.0, 3.0 if 40 < index < 60 else 0.0, 0.0]))
    state = foot.state()
    assert state.rests == 2
    assert state.is_down
    assert (state.place_m, state.stride_m, state.place_sigma_m) == (None, None, None)


def test_how_well_speeds_agree_stretches_the_error():
    """A sensor that is noisier than it should be is found out at its rests."""
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    grown = []
    for off_m_s in (0.001, 0.15):
        made = ZeroVelocity(quat, 0.01, 0.0)
        for index in range(1200):
            made.advance(0.005, np.zeros(3), UP)
            if index % 200 == 199:
                # There and back: always the same way, and it were the forces' bias.
                made.speed = made.speed + off_m_s * SIGNS * (-1.0) ** (index // 200)
                assert made.agrees(np.zeros(3), 0.01, is_new=True, must=math.inf)
                made.stand(np.zeros(3), 0.01)
        grown.append(float(made.sigmas.max()))
    assert grown[1] > 2.0 * grown[0]


def test_what_a_rest_corrects_is_the_way_since_the_last_in_spite_of_missing_rows(
    monkeypatch: pytest.MonkeyPatch,
):
    walk, track = walked()
    track = track.rows(walk.times_s < walk.contacts[8][0])
    hole = int(np.searchsorted(walk.times_s, walk.contacts[6][1] + 0.2))
    gyr = track.gyr.copy()
    gyr[hole : hole + 8] = np.nan

    def marked(steps: list[Step], *_: object) -> tuple[FloatArray, FloatArray]:
        return np.full((len(steps), 3), 100.0), np.zeros((len(steps), 3))

    monkeypatch.setattr(contact, "smoothed", marked)
    found = contact.path(replace(track, gyr=gyr))
    assert np.isnan(found.place[hole : hole + 8]).all()
    swing = found.place[found.rests[6][1] + 1 : hole, 0]
    assert (swing > 50.0).all()
    assert (found.place[hole + 8 : found.rests[7][0], 0] > 50.0).all()


def test_a_foot_begins_where_its_attitude_is_known():
    track = contact.faced(walked()[1])
    walker, none = contact.Walker(), np.full(4, np.nan)
    for row in range(400):
        known = none if row < 200 else track.quat[row]
        samples = track.gyr[row], track.acc[row]
        walker.update(track.times_s[row], 0.005, samples, (known, 0.01, 0.02))
        assert (walker.filter is None) == (row < 200)
    assert np.isfinite(walker.sigmas).all()


def test_a_foot_that_stands_while_the_filter_starts_has_a_path():
    """A filter that was just powered on states no tilt error for 2.7 s."""
    walk, track = walked()
    track = track.rows(walk.times_s < walk.contacts[5][0])
    starts = track.times_s < track.times_s[0] + 2.7
    tilt, heading = (
        np.where(starts, np.nan, each)
        for each in (track.tilt_sigma, track.heading_sigma)
    )
    found = contact.path(replace(track, tilt_sigma=tilt, heading_sigma=heading))
    assert len(found.rests) >= 4
    assert np.isfinite(found.place[found.rests[-1][1]]).all()
    assert np.isfinite(found.sigmas[found.rests[-1][1]]).all()


def test_a_foot_that_rolls_off_slowly_has_not_landed_again():
    """Of leg 205 it took the end of many a roll for a step of 9 cm."""
    made = leg.made(205, leg.Manner(walk_s=60.0))
    feeds = {name: sampled(each) for name, each in made.motions.items()}
    random = np.random.default_rng([205, 0xC10C])
    given = {name: legs.dated(f.times_s, random) for name, f in feeds.items()}
    foot = replace(legs.track_of(feeds["foot"]), times_s=given["foot"])
    begin_s = made.stages["walk"][0]
    found = contact.path(foot.between(begin_s - 1.0, begin_s + 13.0))
    whole = found.strides[1:-1]
    assert len(whole) >= 8
    assert whole.min() > 0.9 * whole.max()
