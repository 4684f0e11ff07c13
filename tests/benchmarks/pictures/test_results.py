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


def test_pictures_show_what_was_measured(
    picture: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    score = {"total": 2.0, "heading": 1.5, "inclination": 0.7}
    names = ("host", "vqf", "complementary")
    trace = {
        "trial": "37_made_up",
        "t_s": [0.1 * index for index in range(100)],
        "moving": [index > 20 for index in range(100)],
        "errors_deg": dict.fromkeys(names, [1.0] * 99 + [None]),
    }
    trials = {"37_made_up": dict.fromkeys(names, score)}
    measured = {"data": {"trials": trials, "trace": trace}}
    (tmp_path / "recordings.json").write_text(json.dumps(measured))
    monkeypatch.setattr(picture, "RESULTS", tmp_path)
    monkeypatch.setattr(picture, "PICTURES", tmp_path)
    assert picture.main() == 0
    drawn = (tmp_path / "time.svg").read_text()
    for words in ("imu-probe, ATmega328P: 2.0°", "VQF, doubles: 2.0°"):
        assert words in drawn
    assert "Madgwick" not in drawn
    errors = (tmp_path / "errors.svg").read_text()
    assert "37 made up" in errors
    # Each colour has one for dark pages.
    theme = importlib.import_module("benchmarks.pictures.theme")
    for light, dark in (
        (theme.LIGHT.ours, theme.DARK.ours),
        (theme.LIGHT.ground, theme.DARK.ground),
    ):
        assert f"fill: {light}" in errors
        assert f'[style*="fill: {light}"]{{fill:{dark} !important}}' in errors


def test_without_measurements_it_says_what_to_run(
    picture: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "RESULTS", picture.PROJECT / "nowhere")
    with pytest.raises(SystemExit, match="make bench"):
        picture.main()
