# SPDX-License-Identifier: MIT
"""The benchmark of stated errors on a desk: its cases, and how it counts."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.honesty import cases, desk
from benchmarks.honesty.stated import Stated


def test_what_is_inside_or_withheld_is_honest() -> None:
    error = np.array([1.0, 1.97, 3.0, 50.0])
    sigma = np.array([1.0, 1.0, 2.0, np.nan])
    found = Stated.of(error, sigma)
    assert found.honest == 0.75
    assert found.withheld == 0.25
    assert found.stated_deg == 1.0
    assert found.true_deg == pytest.approx(math.sqrt((1 + 1.97**2 + 9 + 2500) / 4))


def test_runs_that_state_nothing_are_left_out_of_what_is_stated() -> None:
    one = Stated.of(np.array([3.0]), np.array([2.0]))
    none = Stated.of(np.array([4.0]), np.array([np.nan]))
    assert math.isnan(none.stated_deg)
    mean = Stated.mean([one, none])
    assert mean == Stated(math.sqrt(12.5), 2.0, 0.5, 1.0)


def test_the_figure_is_of_the_worst_line_and_of_its_worse_error() -> None:
    good, bad = Stated(1.0, 1.0, 0.0, 0.96), Stated(9.0, 1.0, 0.0, 0.4)
    lines = [desk.Line("a", good, good, 0.9), desk.Line("b", bad, good, 0.3)]
    heading, tilt = desk.figures(lines)
    assert (heading.value, heading.verdict) == (40.0, "MISSED")
    assert heading.detail == "b; 1 of 2 lines miss it"
    assert (tilt.value, tilt.verdict) == (96.0, "goal")


def test_a_magnet_and_steel_are_as_strong_as_they_say() -> None:
    plain = cases.hand(3)
    own = cases.own_field(3, 150).mag - plain.mag
    assert np.allclose(np.linalg.norm(own, axis=1), 150.0)
    assert np.allclose(own, own[0])
    room = np.linalg.norm(cases.steel(3, 45).mag - plain.mag, axis=1)
    t = np.arange(len(plain)) / plain.rate_hz
    assert np.allclose(room[t < 10.0], 45.0)
    assert np.allclose(room[t > 12.0], 0.0)


def test_a_reading_averages_a_fast_field() -> None:
    plain = cases.hand(3)
    felt = np.linalg.norm(cases.mains(3, 50.0, 20.0).mag - plain.mag, axis=1)
    assert felt[: round(30.0 * plain.rate_hz)].max() == 0.0
    # sin(x) / x of half a reading's phase, 0.36 pi.
    size = math.sqrt(2.0 * np.mean(felt[felt > 0.0] ** 2))
    assert size == pytest.approx(20.0 * math.sin(1.131) / 1.131, rel=1e-3)


def test_a_turn_at_power_on_has_its_rate_and_ends() -> None:
    felt = cases.turning(3, 6.0)
    t = np.arange(len(felt)) / felt.rate_hz
    rate = np.degrees(felt.gyr[:, 2])
    assert abs(rate[t < 29.0].mean()) == pytest.approx(6.0, abs=0.05)
    assert abs(rate[t > 31.0].mean()) < 0.05


def test_one_group_is_measured(tmp_path: Path) -> None:
    path = tmp_path / "desk.json"
    words = ["--groups", "cold", "--seeds", "1", "--jobs", "1", "--output", str(path)]
    status = desk.main(arguments=words)
    found = json.loads(path.read_text())
    names = [row[0] for row in found["tables"]["cases"]["rows"]]
    assert names[0] == "30 K from calibration, lies, calibrated"
    assert len(names) == 4
    heading, tilt = found["figures"]
    assert status == (min(heading["value"], tilt["value"]) < desk.MUST)
