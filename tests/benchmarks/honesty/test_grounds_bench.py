# SPDX-License-Identifier: MIT
"""The benchmark of stated errors on simulated motions: its figures and its program."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks.accuracy.compared import Outcome, grouped
from benchmarks.common.scoring import Coverage, Score
from benchmarks.honesty import grounds


def outcome(
    group: str = "hand",
    seed: int = 1,
    heading: float = 1.0,
    sigma: float = 1.8,
    inside: tuple[float, float] = (0.97, 0.96),
    first: float = 0.99,
) -> Outcome:
    scores = {"host": Score(1.2, heading, 0.5), "vqf": Score(2.5, 2.0, 1.0)}
    coverage = Coverage(*inside, 0.0, 0.25, 0.4, sigma)
    first_s = Coverage(1.0, first, 0.0, 0.0, 0.4, sigma)
    return Outcome(group, seed, scores, coverage, first_s)


def verdicts(outcomes: list[Outcome]) -> dict[str, tuple[float, str, str]]:
    return {
        each.name: (each.value, each.verdict, each.detail)
        for each in grounds.figures(grouped(outcomes, lambda each: each.group))
    }


def test_the_first_seconds_are_judged_by_the_worst_recording() -> None:
    found = verdicts(
        [
            outcome("shop", 1, first=0.97),
            outcome("one axis", 3, first=0.89),
            outcome("slow turn", 5, first=math.nan),  # states nothing
            outcome("hand", 1, first=0.1),  # calibrated
        ]
    )
    value, verdict, detail = found[
        "uncalibrated, first 10 s, worst recording: inside, %"
    ]
    assert (value, verdict, detail) == (89.0, "MISSED", "one axis 3")


def test_stated_over_true_is_of_the_means_and_names_the_worst_group() -> None:
    found = verdicts(
        [
            outcome("hand", sigma=2.0, heading=1.0),
            outcome("wand", sigma=4.0, heading=1.0),
            outcome("walking", sigma=9.0, heading=1.0),
            outcome("carried", sigma=99.0),
        ]
    )
    good = found["heading, median stated / true rms, good modules"]
    assert good == (3.0, "MISSED", "worst: wand, 4.00")
    walking = found["heading, median stated / true rms, walking"]
    assert walking == (9.0, "MISSED", "worst: walking, 9.00")


def test_shares_inside_are_of_the_worst_group_that_states_any() -> None:
    found = verdicts(
        [
            outcome("dead mag", inside=(0.99, math.nan)),
            outcome("steel", inside=(0.95, 0.5)),
            outcome("steel", seed=3, inside=(0.95, 0.7)),
            outcome("warm", inside=(0.9, 0.99)),
        ]
    )
    assert found["tilt inside 1.96 sigma, %, worst group"] == (90.0, "must", "warm")
    value, verdict, detail = found["heading inside 1.96 sigma, %, worst group"]
    assert value == pytest.approx(60.0)
    assert (verdict, detail) == ("MISSED", "steel")


def test_of_gross_faults_what_is_withheld_is_right() -> None:
    found = verdicts([outcome("strong", inside=(1.0, 0.5))])
    value, *_ = found["heading inside 1.96 sigma, %, worst group"]
    assert value == pytest.approx(25.0 + 75.0 * 0.5)


def test_groups_are_measured(tmp_path: Path) -> None:
    path = tmp_path / "grounds.json"
    words = ["--groups", "one axis", "warm", "--seeds", "1", "--jobs", "1"]
    grounds.main(arguments=[*words, "--output", str(path)])
    rows = json.loads(path.read_text())["tables"]["groups"]["rows"]
    assert [row[0] for row in rows] == ["one axis", "warm"]
