# SPDX-License-Identifier: MIT
"""What is told of many legs, joints and feet."""

from __future__ import annotations

import math

import pytest

from benchmarks.limb import chains, feet, legs


def test_the_worst_leg_is_one_aligned_by_motion():
    rows = [
        {"motion": {"knee flexion": 1.0, "inside": 0.9}, "peer": {"knee flexion": 9.0}},
        {"motion": {"knee flexion": 3.0, "inside": 0.8}, "peer": {"knee flexion": 5.0}},
    ]
    found = legs.summary(rows)
    assert found["means"]["motion"]["knee flexion"] == 2.0
    assert found["means"]["peer"] == {"knee flexion": 7.0}
    assert found["worst"] == {"knee flexion": 3.0, "inside": 0.8}


def test_joints_whose_angle_is_withheld_are_counted_and_not_scored():
    nan = math.nan
    found = chains.summary(
        [
            chains.Score("hinge", 3.0, 2.5, 0.9, 4.0, 0.2),
            chains.Score("hinge", 4.0, 5.0, 1.0, 4.0, 0.0),
            chains.Score("hinge", nan, 2.0, nan, nan, 1.0),
        ]
    )
    hinge = found["hinge"]
    assert (hinge["joints"], hinge["never stated"]) == (3, 1)
    assert hinge["withheld"] == pytest.approx(0.4)
    assert hinge["rms"] == pytest.approx(math.sqrt(12.5))
    assert (hinge["worst"], hinge["inside"]) == (4.0, 0.95)
    assert (hinge["worse than plain"], hinge["worse by"]) == (1, 0.5)
    assert "1 never stated: " in chains.table_of(found)
    none = chains.summary([chains.Score("free", nan, nan, nan, nan, 1.0)])
    assert none["free"]["rms"] is None
    assert chains.table_of(none).endswith("1 never stated")


def test_rests_are_shares_of_all_feet():
    scores = [
        feet.Score(20, 20, 2, 0, 0.01, 1.0, 0.3, 0.5),
        feet.Score(20, 18, 4, 1, 0.03, 0.9, 0.4, 0.5),
    ]
    found = feet.summary(scores)
    assert (found["found"], found["by thresholds"]) == (0.95, 0.15)
    assert (found["false"], found["off worst"]) == (1, 0.03)
    assert found["true m"] == pytest.approx(math.sqrt(0.125))
    assert found["least inside"] == 0.9
