# SPDX-License-Identifier: MIT
"""Strokes: how far the probe moves, how sure that is, and when it can't be known."""

from __future__ import annotations

import numpy as np
import pytest

from core import stroke_desk as desk
from core.desk import ffi, lib
from core.stroke_desk import MICRO, NULL, SIGMA, Measured, Tracker, ends, names
from imud import rotation
from imud.virtual.stroking import A4, Plan

REST, BUTTON = lib.STROKE_END_REST, lib.STROKE_END_BUTTON
ONE = Plan(strokes=1)


@pytest.fixture(scope="module")
def scene() -> Measured:
    """Three strokes of 10 cm in 1 s."""
    return desk.measured(Plan(strokes=3), 1)


@pytest.fixture(scope="module")
def single() -> Measured:
    return desk.measured(ONE, 2)


def at(scene: Measured, seconds: float) -> int:
    """The sample that many seconds after the start of the first stroke."""
    return scene.index(scene.strokes[0].start_s + seconds)


@pytest.mark.parametrize("is_by_button", [False, True])
def test_strokes_of_10_cm_in_1_s_are_found_to_6_mm(
    scene: Measured, is_by_button: bool
) -> None:
    tracker = Tracker(is_by_button=is_by_button)
    strokes, _ = tracker.feel(scene.samples, scene.held() if is_by_button else None)
    assert names(strokes) == [BUTTON if is_by_button else REST] * 3
    assert np.linalg.norm(desk.errors(tracker, scene, strokes), axis=1).max() < 0.006
    assert ends(strokes)["stroke"].tolist() == [1, 2, 3]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("support", ["supported", "paper", "air"])
def test_true_errors_are_inside_the_stated_sigma(support: str) -> None:
    apart = []
    for seed in range(3):
        scene = desk.measured(Plan(strokes=8, support=support), seed)
        tracker = Tracker(is_by_button=True)
        strokes, _ = tracker.feel(scene.samples, scene.held())
        assert names(strokes) == [BUTTON] * 8
        sigma = ends(strokes)["displacement_sigma"][:, [0, 0, 1]] * SIGMA
        apart.append(desk.errors(tracker, scene, strokes) / sigma)
    share = np.mean(np.abs(apart) < 1.96)
    # 72 numbers, of which 95 % should be: 4 standard deviations below.
    assert share > 0.85
    assert np.std(apart) > 0.4  # nor are they stated much too large


def test_a_slow_stroke_along_a_ruler_is_not_cut_short() -> None:
    for seed in range(4):
        scene = desk.measured(Plan(seconds=2.0, turn_deg=0.0, strokes=2), seed)
        tracker = Tracker()
        strokes, _ = tracker.feel(scene.samples)
        assert names(strokes) == [REST, REST]
        assert (
            np.linalg.norm(desk.errors(tracker, scene, strokes), axis=1).max() < 0.025
        )


def test_a_running_stroke_is_told_every_window_and_its_sigma_grows(
    single: Measured,
) -> None:
    strokes, after = Tracker(is_by_button=True).feel(single.samples, single.held())
    assert (strokes["end"][:-1] == lib.STROKE_END_RUNNING).all()
    assert (np.diff(after) == desk.WINDOW).all()
    assert len(strokes) >= 10
    running = strokes["displacement_sigma"][:-1, 0].astype(int)
    assert (np.diff(running) >= 0).all()
    assert (
        running[-1] > 1.5 * strokes["displacement_sigma"][-1, 0]
    )  # the end tells much
    final = np.linalg.norm(strokes["displacement"][-1])
    assert abs(np.linalg.norm(strokes["displacement"][-2]) - final) * MICRO < 0.03


def test_a_rest_of_a_minute_is_no_stroke(single: Measured) -> None:
    still = np.tile(single.samples[:1200], 10)
    still["time_us"] = np.arange(len(still)) * 5000
    strokes, _ = Tracker().feel(still)
    assert len(strokes) == 0


def test_how_much_a_rest_sways_is_a_mean_that_forgets(single: Measured) -> None:
    """A sum would grow with each window, and with it what a stroke states."""
    still = np.tile(single.samples[:1200], 10)
    still["time_us"] = np.arange(len(still)) * 5000
    tracker = Tracker()
    tracker.feel(still[:3600])
    early = tracker.c.stroke.sway_q30
    assert early > 100
    tracker.feel(still[3600:])
    assert 0.3 * early < tracker.c.stroke.sway_q30 < 3.0 * early


# What ends a stroke without a result.


def test_a_stroke_without_end_is_too_long_and_has_no_length() -> None:
    scene = desk.measured(Plan(seconds=8.0, length_m=1.0, strokes=1), 3)
    tracker = Tracker(is_by_button=True)
    strokes, after = tracker.feel(scene.samples, scene.held())
    assert names(strokes) == [lib.STROKE_END_TOO_LONG]
    assert (ends(strokes)["displacement"] == NULL).all()
    assert (ends(strokes)["displacement_sigma"] == 2**16 - 1).all()
    assert (ends(strokes)["path"] == NULL).all()
    assert after[-1] - after[0] <= 50 * desk.WINDOW


@pytest.mark.nightly
def test_a_button_that_is_jammed_for_an_hour_tells_one_stroke(single: Measured) -> None:
    held = np.zeros(len(single.samples), bool)
    held[at(single, -0.1) :] = True
    tracker = Tracker(is_by_button=True)
    strokes, _ = tracker.feel(single.samples, held)
    hour = np.tile(single.samples[-400:], 60 * 30)
    hour["time_us"] = np.arange(len(hour)) * 5000
    hour["time_us"] += single.samples["time_us"][-1] + 5000
    more, _ = tracker.feel(hour, np.ones(len(hour), bool))
    assert names(strokes) + names(more) == [lib.STROKE_END_TOO_LONG]


def test_a_long_gap_in_time_ends_a_stroke(single: Measured) -> None:
    samples = single.samples.copy()
    samples["time_us"][at(single, 0.5) :] += 400_000
    strokes, _ = Tracker(is_by_button=True).feel(samples, single.held())
    assert names(strokes) == [lib.STROKE_END_GAP]


def test_a_thrown_probe_is_too_fast(single: Measured) -> None:
    samples = single.samples.copy()
    begin = at(single, 0.2)
    samples["acc"][begin : begin + 60] += 6000  # 29 m/s2
    strokes, _ = Tracker(is_by_button=True).feel(samples, single.held())
    assert names(strokes) == [lib.STROKE_END_TOO_FAST]


def test_a_restart_in_the_midst_forgets_the_stroke(single: Measured) -> None:
    tracker = Tracker(is_by_button=True)
    half = at(single, 0.5)
    tracker.feel(single.samples[:half], single.held()[:half])
    assert lib.pose_begin(tracker.c, desk.CALIBRATED, desk.MPU9250, lib.FILTER_FUSE)
    strokes, _ = tracker.feel(single.samples[half:], single.held()[half:])
    assert len(strokes) == 0


# The button.


NEAR, MOVING = lib.STROKE_END_TOO_NEAR, lib.STROKE_END_MOVING


@pytest.mark.parametrize(
    ("pressed", "told"),
    [
        ([(-0.5, -0.3)], []),  # a click
        ([(0.0, 0.5), (0.52, 1.1)], [BUTTON]),  # it bounces
        ([(0.0, 0.5), (0.62, 1.1)], [NEAR, MOVING]),
        ([(0.0, 0.5), (0.7, 1.1)], [NEAR, MOVING]),
        ([(0.0, 0.5), (0.65, 0.7)], [NEAR]),  # let go at once
    ],
)
def test_presses_are_told_apart(
    single: Measured, pressed: list[tuple[float, float]], told: list[int]
) -> None:
    spans = [(at(single, begin), at(single, end)) for begin, end in pressed]
    tracker = Tracker(is_by_button=True)
    strokes, _ = tracker.feel(single.samples, held_for(len(single.samples), *spans))
    found = ends(strokes)
    assert names(strokes) == told
    assert found["stroke"].tolist() == list(range(1, len(told) + 1))
    assert (found["displacement"][found["end"] == NEAR] == NULL).all()
    if told == [BUTTON]:
        assert np.linalg.norm(desk.errors(tracker, single, strokes)) < 0.006


# Presses that measure nothing say why.


def held_for(count: int, *spans: tuple[int, int]) -> np.ndarray:
    held = np.zeros(count, bool)
    for begin, end in spans:
        held[begin:end] = True
    return held


def test_each_press_before_the_first_rest_says_so_and_a_click_does_not(
    single: Measured,
) -> None:
    never = single.samples[:1200].copy()
    never["gyr"] += np.arange(1200)[:, None] % 400 * 20  # it is never at rest
    presses = [(at, at + 104) for at in range(10, 1100, 140)]
    tracker = Tracker(is_by_button=True)
    strokes, after = tracker.feel(never, held_for(1200, *presses, (1180, 1200)))
    assert names(strokes) == [lib.STROKE_END_NO_REST] * len(presses)
    assert strokes["stroke"].tolist() == list(range(1, len(presses) + 1))
    assert (strokes["displacement"] == NULL).all()
    assert (strokes["path"] == NULL).all()
    assert (strokes["windows"] == 0).all()
    # Each while it is held, when the stroke would have begun.
    for told, (begin, end) in zip(after, presses, strict=True):
        assert begin + 80 <= told < end


def test_a_press_at_which_samples_are_missing_says_so(single: Measured) -> None:
    samples = single.samples.copy()
    begin = at(single, -0.2)
    samples["has_gap"][begin : begin + 120] = True
    held = held_for(len(samples), (begin, begin + 120))
    strokes, _ = Tracker(is_by_button=True).feel(samples, held)
    assert names(strokes) == [lib.STROKE_END_GAP]


def test_a_filter_without_strokes_and_other_params_say_so(single: Measured) -> None:
    tracker = Tracker(is_by_button=True)
    half = at(single, 0.5)
    tracker.feel(single.samples[:half], single.held()[:half])
    lib.pose_set_tip(tracker.c, ffi.addressof(tracker.c.tip), False)
    strokes, _ = tracker.feel(single.samples[half : half + 1])
    assert names(strokes) == [lib.STROKE_END_CHANGED]
    other = Tracker(is_by_button=True)
    assert lib.pose_begin(other.c, desk.CALIBRATED, desk.MPU9250, lib.FILTER_MAHONY)
    lib.pose_set_tip(other.c, ffi.addressof(other.c.tip), True)
    strokes, _ = other.feel(single.samples, single.held())
    assert names(strokes) == [lib.STROKE_END_NO_FILTER]


def test_without_the_option_the_button_makes_no_stroke(single: Measured) -> None:
    strokes, _ = Tracker().feel(single.samples, single.held())
    other, _ = Tracker().feel(single.samples)
    assert np.array_equal(strokes, other)


# Path, tip and normal.


def test_a_path_adds_up_and_the_tip_is_at_the_end_of_it() -> None:
    arm = (0.12, 0.02, -0.01)
    scene = desk.measured(Plan(strokes=3, corners=A4), 5, arm)
    tracker = Tracker(
        is_by_button=True,
        tip_um=tuple(round(each * 1e6) for each in arm),
        axis=(-(2**14), 0, 0),
    )
    held = scene.held()
    first = at(scene, -0.3)
    tracker.feel(scene.samples[:first], held[:first])
    assert list(tracker.pose().position) == [NULL] * 3
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_HEADING)
    assert np.abs(list(tracker.pose().position)).max() < 100  # um
    strokes, _ = tracker.feel(scene.samples[first:], held[first:])
    assert names(strokes) == [BUTTON] * 3
    pose = tracker.pose()
    # From the first corner of the sheet to the last, seen from the origin's heading.
    turn = desk.heading_of(tracker, scene)
    ways = [stroke.tip_way_m for stroke in scene.strokes]
    found = desk.turned_back(np.array(list(pose.position)) * MICRO, turn)
    assert np.linalg.norm(found - np.sum(ways, axis=0)) < 0.015
    assert pose.pose_flags & lib.POSE_TARED
    normal = np.array(list(pose.normal)) / 2**14
    back = -np.array(rotation.rotate(tracker.quat(), np.array([1.0, 0.0, 0.0])))
    assert np.allclose(normal, back, atol=2e-4)
    sigma = ends(strokes)["path_sigma"]
    assert (np.diff(sigma[:, 0].astype(int)) > 0).all()


def test_undoing_the_origin_leaves_no_position(single: Measured) -> None:
    tracker = Tracker(tip_um=(0, 0, 0))
    tracker.feel(single.samples[:1400])
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_FULL)
    assert list(tracker.pose().position) != [NULL] * 3
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_NONE)
    assert list(tracker.pose().position) == [NULL] * 3


def test_without_a_tip_there_is_no_position_but_a_path(single: Measured) -> None:
    tracker = Tracker(is_by_button=True)
    strokes, _ = tracker.feel(single.samples, single.held())
    assert (ends(strokes)["path"] != NULL).all()  # from the press on
    assert np.array_equal(ends(strokes)["path"], ends(strokes)["displacement"])
    assert list(tracker.pose().position) == [NULL] * 3
    assert list(tracker.pose().normal) == [-(2**15)] * 3


# What the filter learns from strokes.


def bias_deg_s(tracker: Tracker) -> np.ndarray:
    bias = tracker.c.attitude.fuse.state.bias_rad_s_q25
    return np.degrees(np.array([bias.x, bias.y, bias.z]) / 2**25)


def test_a_slow_turn_is_not_taken_for_bias_held_or_not() -> None:
    scene = desk.measured(Plan(seconds=2.0), 1)
    first = at(scene, -0.3)
    last = scene.index(scene.strokes[-1].end_s)  # the rest behind it would tell
    held = scene.held()
    by_button, between = Tracker(is_by_button=True), Tracker()
    moved = []
    for tracker, button in ((by_button, held), (between, held & False)):
        tracker.feel(scene.samples[:first], button[:first])
        before = bias_deg_s(tracker)
        tracker.feel(scene.samples[first:last], button[first:last])
        moved.append(np.abs(bias_deg_s(tracker) - before).max())
    assert max(moved) < 0.1


def test_strokes_teach_the_filter_the_bias() -> None:
    scene = desk.measured(Plan(seconds=2.0, strokes=6, turn_deg=1.0), 4)
    first = at(scene, -0.3)
    samples, held = scene.samples.copy(), scene.held()
    tracker = Tracker(is_by_button=True)
    tracker.feel(samples[:first], held[:first])
    before = bias_deg_s(tracker)
    lsb_deg_s = np.degrees(desk.MPU9250.gyr_lsb_nrad_s * 1e-9)
    samples["gyr"][first:, 1] += round(0.25 / lsb_deg_s)
    step = round(0.25 / lsb_deg_s) * lsb_deg_s
    tracker.feel(samples[first:], held[first:])
    # The tilt by an axis that is not upright shows; half of it is in two strokes.
    assert bias_deg_s(tracker)[1] - before[1] > 0.5 * step
    assert np.abs(bias_deg_s(tracker) - before - [0, step, 0]).max() < 0.6 * step
