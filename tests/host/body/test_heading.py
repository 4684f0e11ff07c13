# SPDX-License-Identifier: MIT
"""What joints show of the headings of the probes beside them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imud.body import heading


def turned_by(play_deg: float, sigma: float) -> heading.HeadingFilter:
    """The filter after 30 s of an axis that both see 0.4 rad apart."""
    times_s = np.arange(3000) / 100.0
    parent = np.broadcast_to([1.0, 0.0, 0.0], (3000, 3))
    child = np.broadcast_to([math.cos(0.4), -math.sin(0.4), 0.0], (3000, 3))
    sights = [
        heading.magnetic(np.full((3000, 2), sigma)),
        heading.of_axis(parent, child, math.radians(play_deg)),
    ]
    step = heading.HeadingFilter()
    found = heading.follow(step, times_s, np.ones(3000, bool), sights)
    assert found[0][-1] == step.turn
    return step


def test_a_hinge_brings_headings_into_step():
    step = turned_by(4.0, math.nan)
    assert step.turn == pytest.approx(0.4, abs=0.01)
    assert step.sigma < math.radians(5.0)


def test_a_heading_that_states_no_doubt_is_believed():
    assert abs(turned_by(40.0, 0.001).turn) < 0.01


def test_what_comes_later_is_known_from_the_beginning():
    times_s = np.arange(1000) / 100.0
    is_there = np.ones(1000, bool)
    is_there[300:320] = False
    seen = np.where(times_s < 5.0, np.nan, math.radians(3.0) ** 2)
    sights = [heading.Sight(np.full((1000, 1), 0.3), seen, 0.5)]
    turns, sigmas = heading.follow(heading.HeadingFilter(), times_s, is_there, sights)
    assert turns[0] == 0.0
    turns, sigmas = heading.smoothed(times_s, turns, sigmas)
    np.testing.assert_allclose(turns[is_there], 0.3, atol=0.01)
    assert np.isnan(turns[~is_there]).all()
    assert sigmas[0] < math.radians(3.0)


@pytest.mark.parametrize(("away_s", "is_kept"), [(2.98, True), (3.02, False)])
def test_a_probe_that_was_away_may_be_back_with_another_heading(
    away_s: float, is_kept: bool
):
    times_s = np.arange(1000) / 100.0
    is_there = (times_s < 2.0) | (times_s > 2.0 + away_s)
    seen = np.where((times_s < 2.0) | (times_s > 8.0), math.radians(3.0) ** 2, np.nan)
    turned = np.where(times_s < 2.0, 0.3, 1.3)
    sights = [heading.Sight(turned[:, None], seen, 0.5)]
    live = heading.follow(heading.HeadingFilter(), times_s, is_there, sights)
    assert bool(live[1][600] < math.radians(10.0)) == is_kept
    turns, sigmas = heading.smoothed(times_s, *live)
    if not is_kept:
        np.testing.assert_allclose(turns[is_there], turned[is_there], atol=0.01)
        assert np.nanmax(sigmas) < math.radians(4.0)


def test_an_upright_axis_and_a_weak_force_show_nothing():
    upright = np.array([[0.0, 0.0, 1.0]])
    assert np.isnan(heading.of_axis(upright, upright, 0.1).variance).all()
    weak = np.array([[0.1, 0.0, 9.8]])
    assert np.isnan(heading.of_forces(weak, weak, 0.1).variance).all()
    strong = np.array([[3.0, 0.0, 9.8]])
    seen = heading.of_forces(strong, strong[:, [1, 0, 2]], 0.1)
    assert seen.turns[0] == pytest.approx([-math.pi / 2])
    assert seen.variance[0] == pytest.approx(2.0 * 0.1**2 / 9.0)


def test_of_two_turns_the_one_near_what_is_known_counts():
    parent = np.array([[1.0, 0.0, 0.0]])
    child = np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    sight = heading.of_angle(parent, child, math.cos(0.5), 0.05)
    assert sorted(sight.turns[0]) == pytest.approx([-0.8, 0.2])
    step = heading.HeadingFilter(turn=0.25, variance=0.1**2)
    step.update(0.0, [(sight.turns[0].tolist(), 1e-6, 0.5)])
    assert step.turn == pytest.approx(0.2, abs=1e-3)
