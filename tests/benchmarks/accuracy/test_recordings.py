# SPDX-License-Identifier: MIT
"""The benchmark on recordings: what it judges, and a recording that it measures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import recordings
from benchmarks.accuracy.recordings import Result
from benchmarks.common import feed
from benchmarks.common.scoring import Coverage, Score, Trial
from imud.virtual import motion, sensors


def result(ours: float = 1.0, unequal: int = 0, tilt: float = 0.95) -> Result:
    zeros = np.zeros((2, 3))
    groups = ("all_trials", "undisturbed", "disturbed", "attached_magnet")
    made = motion.Motion(100.0, zeros, zeros, zeros)
    scores = {
        "nano": Score(ours, 2.0, 0.5),
        "host": Score(ours, 2.0, 0.5),
        "vqf": Score(2.0, 4.0, 1.0),
        "vqf-offline": Score(1.5, 2.0, 0.4),
    }
    biased = {"host": Score(3.0, 3.0, 1.0), "vqf": Score(5.0, 5.0, 1.0)}
    share = {"nano": Coverage(tilt, 0.9, 0.0, 0.0, 0.6, 2.0)}
    trial = Trial(Path("28_x.npz"), made, groups)
    return Result(trial, scores, share, biased, None, 10, unequal, 0, 0)


def test_ratios_are_of_the_means_and_judged_by_what_they_reach() -> None:
    found = {e.name: e for e in recordings.figures([result(), result(ours=1.2)])}
    total = found["total / VQF"]
    assert total.value == pytest.approx(1.1 / 2.0)
    assert total.verdict == "goal"
    assert found["heading / VQF, disturbed group"].value == pytest.approx(0.5)
    assert found["total / VQF, a magnet on the probe"].verdict == "must"
    assert found["inclination / offline VQF"].value == pytest.approx(1.25)
    assert found["tilt inside 1.96 sigma, %, disturbed"].verdict == "goal"


def test_few_errors_inside_and_a_pose_of_other_bits_are_missed() -> None:
    bad = [result(tilt=0.5, unequal=3)]
    found = {each.name: each for each in recordings.figures(bad)}
    assert found["tilt inside 1.96 sigma, %, all"].verdict == "MISSED"
    unequal, lost, crashed = recordings.of_images(bad)
    assert (unequal.value, unequal.verdict) == (3, "MISSED")
    assert lost.verdict == crashed.verdict == "goal"


def test_the_image_stands_for_the_c_that_computes_the_same_poses() -> None:
    errors, papers = recordings.tables_of([result()], "nano")
    names = [row[0] for row in errors.rows]
    assert names[0] == "imu-probe, ATmega328P"
    assert len(names) == 3
    assert not papers.rows


def test_a_recording_of_ones_own_is_measured_without_an_image(
    tmp_path: Path,
) -> None:
    recording, output = tmp_path / "37_hand.npz", tmp_path / "found.json"
    sensors.generate(16.0, seed=2).save(recording)
    words = [str(recording), "--engines", "host", "madgwick", "--output", str(output)]
    assert recordings.main(arguments=words) == 0
    found = json.loads(output.read_text())
    assert found["figures"] == []  # required of public trials
    assert found["data"]["means_deg"]["all"]["host"]["total"] < 3.0
    trace = found["data"]["trace"]
    assert trace["trial"] == "37_hand"
    assert len(trace["t_s"]) == len(trace["errors_deg"]["madgwick"]) == 160


@pytest.mark.parametrize("board", ["nano", "f405"])
def test_a_magnet_makes_heading_worse_but_never_tilts(
    tmp_path: Path, board: str
) -> None:
    plain = sensors.generate(16.0, seed=2)
    moved = feed.with_bias(plain, 10.0 * recordings.DIAGONALS[0])
    scores = []
    for name, made in (("plain", plain), ("moved", moved)):
        made.save(tmp_path / f"{name}.npz")
        found = recordings.measure(tmp_path / f"{name}.npz", board, ["host"])
        scores.append(found.scores["host"])
    assert scores[1].heading > scores[0].heading + 2.0
    assert scores[1].inclination == pytest.approx(scores[0].inclination, abs=0.01)


def test_absent_recordings_are_skipped_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        recordings.main(arguments=[str(tmp_path / "nowhere")])
    assert capsys.readouterr().out.count("\n") == 1
    with pytest.raises(SystemExit, match="no recording"):
        recordings.main(arguments=[str(tmp_path)])
