# SPDX-License-Identifier: MIT
"""Bad input to strokes: none leads to a place that is wrong and not said to be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from core import stroke_desk as desk
from core.stroke_desk import MICRO, NULL, Measured, Tracker, ends, lib, names
from imud.virtual.stroking import Plan

Bad = Callable[[desk.desk.Array, desk.desk.Array, int], int]


@pytest.fixture(scope="module")
def single() -> Measured:
    return desk.measured(Plan(strokes=1), 5)


def is_pressed_late(_: desk.desk.Array, held: desk.desk.Array, start: int) -> int:
    held[: start + 80] = False
    return lib.STROKE_END_MOVING


def is_released_early(_: desk.desk.Array, held: desk.desk.Array, start: int) -> int:
    held[start + 90 :] = False
    return lib.STROKE_END_MOVING


def is_held_for_long(_: desk.desk.Array, held: desk.desk.Array, start: int) -> int:
    held[start:] = True
    return lib.STROKE_END_TOO_LONG


def is_thrown(samples: desk.desk.Array, _: desk.desk.Array, start: int) -> int:
    """It falls freely for 0.5 s while it spins, and hits the floor."""
    fall = samples[start + 60 : start + 160]
    fall["acc"] = 0
    fall["gyr"] += np.array([3000, -4000, 5000], np.int16)  # 400 deg/s
    samples["acc"][start + 160 : start + 164] = 2**15 - 1
    samples["acc_clipped"][start + 160 : start + 164] = True
    return lib.STROKE_END_CLIPPED


def is_spun(samples: desk.desk.Array, _: desk.desk.Array, start: int) -> int:
    samples["gyr_clipped"][start + 100] = True
    return lib.STROKE_END_CLIPPED


def is_disturbed(samples: desk.desk.Array, _: desk.desk.Array, start: int) -> int:
    samples["has_gap"][start + 120] = True
    return lib.STROKE_END_GAP


@pytest.mark.parametrize(
    "bad",
    [
        *(is_pressed_late, is_released_early, is_held_for_long),
        *(is_thrown, is_spun, is_disturbed),
    ],
)
def test_after_a_stroke_without_length_no_place_is_known(
    single: Measured, bad: Bad
) -> None:
    # The rest behind the stroke continues for 10 s.
    index = np.append(
        np.arange(len(single.samples)),
        np.arange(2000) % 300 + len(single.samples) - 300,
    )
    samples, held = single.samples[index], single.held()[index]
    samples["time_us"] = np.arange(len(samples)) * 5000
    start = single.index(single.strokes[0].start_s)
    end = bad(samples, held, start)
    tracker = Tracker(is_by_button=True, tip_um=(0, 0, 100_000))
    tracker.feel(samples[: start - 100], held[: start - 100])
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_HEADING)
    assert list(tracker.pose().position) != [NULL] * 3
    strokes, _ = tracker.feel(samples[start - 100 :], held[start - 100 :])
    assert names(strokes) == [end]
    assert (ends(strokes)["displacement"] == NULL).all()
    assert (ends(strokes)["path"] == NULL).all()
    assert list(tracker.pose().position) == [NULL] * 3


def test_a_press_that_bounces_begins_one_stroke(single: Measured) -> None:
    held = single.held()
    press = int(np.flatnonzero(held)[0])
    held[press + 3 : press + 6] = False
    held[press + 9 : press + 11] = False
    tracker = Tracker(is_by_button=True)
    strokes, _ = tracker.feel(single.samples, held)
    assert names(strokes) == [lib.STROKE_END_BUTTON]
    assert np.linalg.norm(desk.errors(tracker, single, strokes)) < 0.006


def test_a_lost_magnetometer_keeps_the_place(single: Measured) -> None:
    samples = single.samples.copy()
    samples["has_mag"][single.index(single.strokes[0].start_s + 0.3) :] = False
    tracker = Tracker(is_by_button=True, tip_um=(0, 0, 0))
    first = single.index(single.strokes[0].start_s) - 100
    tracker.feel(samples[:first], single.held()[:first])
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_HEADING)
    strokes, _ = tracker.feel(samples[first:], single.held()[first:])
    way = ends(strokes)["displacement"][0] * MICRO
    place = np.array(list(tracker.pose().position)) * MICRO
    assert np.linalg.norm(place - way) < 1e-4
    assert np.linalg.norm(way) == pytest.approx(0.1, abs=0.006)


def placed(single: Measured, **tip: tuple[int, int, int]) -> tuple[Tracker, int]:
    """A probe just before a stroke by the button, and the origin where it is."""
    tracker = Tracker(is_by_button=True, **tip)
    start = single.index(single.strokes[0].start_s) - 100
    tracker.feel(single.samples[:start], single.held()[:start])
    lib.pose_set_origin(tracker.c, lib.POSE_ORIGIN_HEADING)
    return tracker, start


def test_a_tip_that_is_set_again_keeps_the_place_and_another_does_not(
    single: Measured,
) -> None:
    tracker, _ = placed(single, tip_um=(1000, 0, 100_000))
    here = list(tracker.pose().position)
    assert here != [NULL] * 3
    tip = desk.ffi.new("struct pose_tip *", tracker.c.tip)
    lib.pose_set_tip(tracker.c, tip, True)
    assert list(tracker.pose().position) == here
    tip.axis[2] = 1
    lib.pose_set_tip(tracker.c, tip, True)
    assert list(tracker.pose().position) == [NULL] * 3


def test_a_moving_tip_has_another_place_in_each_pose(single: Measured) -> None:
    """Between two windows of 20 samples it continues as fast as in the last one."""
    tracker, start = placed(single, tip_um=(0, 0, 0))
    middle = (single.index(single.strokes[0].end_s) + start + 100) // 2
    places = []
    for at in range(start, middle + desk.WINDOW):
        tracker.feel(single.samples[at : at + 1], single.held()[at : at + 1])
        places.append(list(tracker.pose().position))
    steps = np.diff(np.array(places[-desk.WINDOW :]) * MICRO, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert np.count_nonzero(lengths > 1e-4) >= desk.WINDOW - 2
    # Nor does it fall back where a window is complete, and not yet taken.
    assert lengths.max() < 2 * np.median(lengths)


def test_a_stroke_that_has_just_ended_is_told_though_the_orientation_is_lost(
    single: Measured,
) -> None:
    tracker, start = placed(single)
    samples, held = single.samples.copy(), single.held()
    _, after = tracker.feel(samples[start:], held[start:])
    # Two samples before the last one after which something was told.
    at = start + int(after[-1]) - 1
    tracker, start = placed(single)
    tracker.feel(samples[start:at], held[start:at])
    assert tracker.c.work == lib.POSE_WORK_TELL
    samples["time_us"][at:] += 300_000
    strokes, _ = tracker.feel(samples[at : at + 1], held[at : at + 1])
    assert names(strokes) == [lib.STROKE_END_BUTTON]
    assert tracker.c.work == lib.POSE_WORK_NONE


def test_a_filter_begins_without_a_fault() -> None:
    # Tracker() fills its memory with something else first.
    assert Tracker().c.fault == lib.STROKE_END_RUNNING
