# SPDX-License-Identifier: MIT
"""What is told of many legs, joints and feet."""

from __future__ import annotations

import math

import pytest

from benchmarks.limb import chains, feet, legs


def test_the_worst_leg_is_one_aligned_by_motion():
    rows = [
        {legs.MOTION: {"knee flexion": 1.0, "inside": 90.0}, "other": {"inside": 9.0}},
        {legs.MOTION: {"knee flexion": 3.0, "inside": 80.0}, "other": {"inside": 5.0}},
    ]
    mean, worst, other = legs.summary(rows)
    assert (mean["knee flexion"], worst["knee flexion"]) == (2.0, 3.0)
    assert (mean["inside"], worst["inside"], other["inside"]) == (85.0, 80.0, 7.0)


def test_joints_whose_angle_is_withheld_are_counted_and_not_scored():
    nan = math.nan
    (hinge,) = chains.summary(
        "fixed",
        [
            chains.Score("hinge", 3.0, 0.9, 4.0, 0.2),
            chains.Score("hinge", 4.0, 1.0, 4.0, 0.0),
            chains.Score("hinge", nan, nan, nan, 1.0),
        ],
    )
    assert (hinge["number"], hinge["never stated"]) == (3, 1)
    assert hinge["withheld"] == pytest.approx(40.0)
    assert hinge["error"] == pytest.approx(math.sqrt(12.5))
    assert (hinge["worst"], hinge["inside"]) == (4.0, 95.0)
    (none,) = chains.summary("fixed", [chains.Score("free", nan, nan, nan, 1.0)])
    assert "error" not in none


def test_rests_are_shares_of_all_feet():
    scores = [
        feet.Score(20, 20, 0, 0.01, 1.0, 0.3, 0.5),
        feet.Score(20, 18, 1, 0.03, 0.9, 0.4, 0.5),
    ]
    found = feet.summary("walk", scores)
    assert (found["found"], found["false"], found["worst"]) == (95.0, 1, 3.0)
    assert found["true"] == pytest.approx(math.sqrt(0.125))
    assert found["least"] == 90.0
