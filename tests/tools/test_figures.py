# SPDX-License-Identifier: MIT
"""Figures in documents are those of the benchmarks' results (tools/figures.py)."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
import figures

ROOT = figures.ROOT

# Documents that cite results.
CHECKED = {
    "README",
    "accuracy",
    "calibration",
    "calibration-methods",
    "card",
    "check",
    "clock",
    "f405",
    "faults",
    "fleet",
    "honesty",
    "imud",
    "limb",
    "limb-methods",
    "limits",
    "mega",
    "micropython",
    "motions",
    "page",
    "pico",
    "pose",
    "proof",
    "ros2",
    "security",
    "since-origin",
    "strokes",
    "strokes-methods",
    "tip",
}

RESULTS = {
    "is": {
        "a": {"x": 1.494, "y": 2.0},
        "b, c": 0.996,
        "n": 50123.4,
        "no": "x",
        "null": None,
    }
}


@pytest.mark.parametrize("path", figures.documents(), ids=lambda path: path.stem)
def test_each_figure_equals_the_results(path: Path) -> None:
    assert list(figures.differences(path.read_text("utf-8"))) == []


def test_the_documents_in_checked_have_markers() -> None:
    for name in CHECKED:
        path = ROOT / ("README.md" if name == "README" else f"docs/{name}.md")
        assert figures.figures(path.read_text("utf-8")), name


def test_a_document_that_cites_a_benchmark_is_checked() -> None:
    cites = re.compile(r"make bench|benchmarks/(?!pictures)\w+/\w+\.py")
    citing = {
        path.stem
        for path in (ROOT / "docs").glob("*.md")
        if cites.search(path.read_text("utf-8"))
    }
    free = {"README", "change", "architecture", "motion-files", "glossary", "safety"}
    assert citing - free <= CHECKED


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "benchmarks" / "results").mkdir(parents=True)
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "RESULTS", tmp_path / "benchmarks" / "results")
    for name, value in RESULTS.items():
        (figures.RESULTS / f"{name}.json").write_text(json.dumps(value))
    figures.results.cache_clear()
    yield
    figures.results.cache_clear()


TABLE = """\
<!-- figures: is
a:{{x,y}}; _
-
n; b, c * 100
@ x; y = a:@ over a:y
-->
| | one | two |
|---|---|---|
| of 9 | **{0}** / {1} | 7 |
| of 8 | 3 | 4 |
| last | {2} cycles | {3} % |
| x | 0.75 | |
| y | 1.00 | |
"""


@pytest.mark.usefixtures("planted")
@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<!-- figure: is:a:x -->1.49 degrees", []),
        ("<!-- figure: is:b, c * 100 -->**99.6** %", []),
        ("one\n or <!-- figure: is:a:x -->1.5", []),
        ("one\n or <!-- figure: is:a:x -->1.50", ["2: 1.50, but is:a:x is 1.49"]),
        ("<!-- figure: is:null -->2", ["1: 2, but is:null is -"]),
        ("<!-- figures: is\nnull\n-->\n|a|\n|---|\n| b | - |\n", []),
        ("<!-- figure: is:a:z -->1", ["1: is:a:z: there is no z"]),
        ("<!-- figure: is:no -->1", ["1: is:no is no number"]),
        ("<!-- figure: x:a -->1", ["1: there is no benchmarks/results/x.json"]),
        (TABLE.format("1.5", "2.0", "50 123", "99.6"), []),
        (
            TABLE.format("1.6", "2.0", "50 124", "99.6"),
            [
                "9: 1.6, but is:a:x is 1.5",
                "11: 50 124, but is:n is 50 123",
            ],
        ),
    ],
)
def test_a_figure_that_differs_is_reported_with_its_line(
    text: str, told: list[str]
) -> None:
    assert list(figures.differences(text)) == told


@pytest.mark.usefixtures("planted")
def test_figures_that_differ_are_updated() -> None:
    bad, good = (
        TABLE.format(*each)
        for each in (("1.6", "2.1", "50 124", "0.1"), ("1.5", "2.0", "50 123", "99.6"))
    )
    assert figures.updated(bad) == good
    assert figures.updated(good) == good


@pytest.mark.usefixtures("planted")
@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<!-- figure: is:a:x -->about 1", "no number follows"),
        ("one\n<!-- figure: is:a:x -->1.5", "put a word on the line before"),
        ("<!-- figures: is\na:x\n-->\nwords", "no table follows the figures of is"),
        (
            "<!-- figures: is\na:x\n-->\n| a |\n|---|\n| b | 1 2 |\n",
            "1 places, 2 numbers",
        ),
        (
            "<!-- figures: is\n-\n-\n-->\n|a|\n|---|\n| b |\n",
            "no row of the table for -",
        ),
        (
            "<!-- figures: is\n-\n-->\n|a|\n|---|\n| b |\n| c |\n",
            "no places for the row",
        ),
    ],
)
def test_a_marker_that_does_not_fit_is_refused(text: str, told: str) -> None:
    with pytest.raises(figures.BadFigureError, match=re.escape(told)):
        list(figures.differences(text))
