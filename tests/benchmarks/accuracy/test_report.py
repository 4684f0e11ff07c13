# SPDX-License-Identifier: MIT
"""The benchmark's report of given results, and its command line."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import recordings, report
from benchmarks.accuracy.report import Figure, Result
from benchmarks.common import scoring
from benchmarks.common.scoring import Coverage, Score, Trial
from imud.virtual import motion, sensors

SUMMARY = {"crashed": False, "late": 0, "cycles_worst": 70000}


def result(
    name: str = "28_x",
    ours: float = 1.0,
    unequal: int = 0,
    lost: int = 0,
    tilt: float = 0.95,
) -> Result:
    zeros = np.zeros((2, 3))
    trial = Trial(
        Path(f"{name}.npz"),
        motion.Motion(100.0, zeros, zeros, zeros),
        ("all_trials", "disturbed"),
    )
    scores = {
        "nano": Score(ours, 2.0, 0.5),
        "vqf": Score(2.0, 4.0, 1.0),
        "vqf-offline": Score(1.5, 2.0, 0.4),
    }
    biased = {"host": Score(3.0, 3.0, 1.0), "vqf": Score(5.0, 5.0, 1.0)}
    share = Coverage(tilt, 0.9, 0.0, 0.0)
    return Result(
        trial, scores, {"nano": share}, biased, None, 10, unequal, lost, SUMMARY
    )


def test_ratios_are_of_the_means_and_named_by_what_they_reach() -> None:
    found = {each.name: each for each in report.figures([result(), result(ours=1.2)])}
    total = found["total / VQF"]
    assert total.value == pytest.approx(1.1 / 2.0)
    assert total.verdict == "goal"
    assert found["heading / VQF, disturbed group"].value == pytest.approx(0.5)
    assert found["total / VQF, a magnet on the probe"].verdict == "must"
    assert found["inclination / offline VQF"].value == pytest.approx(1.25)
    assert found["inclination / offline VQF"].verdict == "must"
    assert found["tilt inside 1.96 sigma, %, disturbed"].value == pytest.approx(95.0)
    assert "tilt inside 1.96 sigma, %, undisturbed" not in found


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (87.99, "MISSED"),
        (88.0, "must"),
        (92.99, "must"),
        (93.0, "goal"),
        (97.0, "goal"),
        (97.01, "must"),
        (99.5, "must"),
        (99.51, "MISSED"),
        (math.nan, "MISSED"),
    ],
)
def test_a_figure_beside_its_limits(value: float, verdict: str) -> None:
    assert Figure("", value, (88.0, 99.5), (93.0, 97.0)).verdict == verdict


def test_without_vqf_there_are_no_ratios_and_without_ours_no_figures() -> None:
    one = result()
    alone = Result(
        one.trial, {"nano": one.scores["nano"]}, one.coverage, {}, None, 0, 0, 0, {}
    )
    assert not [each for each in report.figures([alone]) if "VQF" in each.name]
    other = Result(one.trial, {"vqf": one.scores["vqf"]}, {}, {}, None, 0, 0, 0, {})
    assert not list(report.figures([other]))


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        ({"unequal": 3}, "3 DIFFER"),
        ({"lost": 2}, "2 samples or messages lost"),
        ({"tilt": 0.5}, "1 figures are outside"),
    ],
)
def test_what_must_not_be_is_said_and_makes_the_exit_code_1(
    bad: dict[str, float], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    good = [result()]
    tilt = "tilt inside 1.96 sigma, %, disturbed"
    judged = [each for each in report.figures(good) if each.name == tilt]
    assert recordings.end(good, judged, "nano") == 0
    assert "equal in every bit" in capsys.readouterr().out
    spoiled = [result(**bad)]
    judged = [each for each in report.figures(spoiled) if each.name == tilt]
    assert recordings.end(spoiled, judged, "nano") == 1
    assert word in capsys.readouterr().out


def test_json_has_no_nan(tmp_path: Path) -> None:
    path = tmp_path / "out" / "accuracy.json"
    report.write([result(tilt=math.nan)], {"engines": ("nano",)}, path)

    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(path.read_text(), parse_constant=refuse)
    assert found["coverage"]["disturbed"]["nano"]["tilt"] is None
    assert found["means_deg"]["all"]["nano"]["total"] == 1.0


def test_a_recording_of_ones_own_is_measured_without_an_image(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = sensors.generate(16.0, seed=2)
    recording = tmp_path / "37_hand.npz"
    made.save(recording)
    output = tmp_path / "accuracy.json"
    words = [str(recording), "--engines", "host", "madgwick", "--output", str(output)]
    assert recordings.main(words) == 0
    printed = capsys.readouterr().out
    assert "not judged" in printed
    found = json.loads(output.read_text())
    assert found["means_deg"]["all"]["host"]["total"] < 3.0
    assert found["bit_equal"] == {"poses": 0, "unequal": 0}
    trace = found["trace"]
    assert trace["trial"] == "37_hand"
    assert len(trace["t_s"]) == len(trace["errors_deg"]["madgwick"]["heading"]) == 160
    assert found["folds_deg"] == {}


@pytest.mark.parametrize("board", ["nano", "f405"])
def test_a_magnet_makes_heading_worse_in_every_direction_but_never_tilts(
    tmp_path: Path, board: str
) -> None:
    made = sensors.generate(16.0, seed=2)
    path = tmp_path / "hand.npz"
    made.save(path)
    found = [
        recordings.measure(path, recordings.Settings(board, ("host",), bias_ut, ""))
        for bias_ut in (0.0, 10.0)
    ]
    plain, biased = (each.scores["host"] for each in found)
    assert biased.heading > plain.heading + 2.0
    assert biased.inclination == pytest.approx(plain.inclination, abs=0.01)


def test_another_boards_image_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        recordings.parse(["--board", "f405", "--engines", "nano", "host"])
    assert "that of --board f405" in capsys.readouterr().err
    args = recordings.parse(["--board", "f405"])
    assert args.engines[0] == "f405"
    assert "nano" not in args.engines
    assert args.output.name == "accuracy-f405.json"
    assert recordings.parse([]).output.name == "accuracy.json"


def test_absent_recordings_are_skipped_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recordings.main([str(tmp_path / "nowhere")]) == 0
    assert capsys.readouterr().out.count("\n") == 1
    assert recordings.main([str(tmp_path)]) == 2


def test_folds_are_tabled_apart(capsys: pytest.CaptureFixture[str]) -> None:
    report.print_tables([result("28_x"), result("34_x", ours=3.0)], ["nano", "vqf"])
    output = capsys.readouterr().out
    assert "fold B (1)" in output
    assert "fold C (1)" in output
    assert "fold A" not in output
    assert scoring.FOLDS["fold B"][-1] == "34"
