# SPDX-License-Identifier: MIT
"""The pictures, from figures made by hand."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def picture() -> ModuleType:
    """Imported when it is used, because matplotlib takes long."""
    return importlib.import_module("benchmarks.pictures.results")


def test_words_that_would_overlap_move_up_and_keep_their_order(
    picture: ModuleType,
) -> None:
    found = picture.apart([1.0, 0.1, 0.15, 0.2], 0.1)
    assert found == pytest.approx([1.0, 0.1, 0.2, 0.3])


def test_smoothing_keeps_the_level_and_leaves_out_what_was_not_seen(
    picture: ModuleType,
) -> None:
    errors = [2.0] * 50 + [None] * 5 + [2.0] * 50
    assert picture.smoothed(errors, 0.1) == pytest.approx([2.0] * 105)


def write(folder: Path) -> None:
    score = {"total": 2.0, "heading": 1.5, "inclination": 0.7}
    names = ("host", "vqf", "complementary")
    trace = {
        "trial": "37_made_up",
        "t_s": [0.1 * index for index in range(100)],
        "moving": [index > 20 for index in range(100)],
        "errors_deg": {name: [1.0] * 99 + [None] for name in names},
    }
    scores = {name: score for name in names}
    measured = {
        "means_deg": {"all": scores},
        "trials": {"37_made_up": scores},
        "trace": trace,
    }
    (folder / "recordings.json").write_text(json.dumps({"data": measured}))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "there", "absent"),
    [
        ("time", ["imu-probe, ATmega328P: 2.0°", "VQF, doubles: 2.0°"], "Madgwick"),
    ],
)
def test_a_picture_shows_what_was_measured_and_nothing_else(
    picture: ModuleType,
    name: str,
    there: list[str],
    absent: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write(tmp_path)
    monkeypatch.setattr(picture, "RESULTS", tmp_path)
    monkeypatch.setattr(picture, "PICTURES", tmp_path)
    assert picture.main([name]) == 0
    drawn = (tmp_path / f"{name}.svg").read_text()
    for words in there:
        assert words in drawn
    assert absent not in drawn
    assert picture.main([name]) == 0
    assert (tmp_path / f"{name}.svg").read_text() == drawn


def test_without_measurements_it_says_what_to_run(
    picture: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "RESULTS", picture.PROJECT / "nowhere")
    monkeypatch.setattr(picture, "PICTURES", tmp_path)
    with pytest.raises(picture.RunFailed, match="make bench"):
        picture.main(["time"])
