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


def is_disturbed(samples: desk.desk.Array, _: desk.desk.Array, start: int) -> int:
    samples["has_gap"][start + 120] = True
    return lib.STROKE_END_GAP


@pytest.mark.parametrize(
    "bad",
    [is_pressed_late, is_released_early, is_held_for_long, is_thrown, is_disturbed],
)
def test_after_a_stroke_without_length_no_place_is_known(
    single: Measured, bad: Bad
) -> None:
    # The rest behind the stroke goes on for 10 s.
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
