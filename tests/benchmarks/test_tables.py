# SPDX-License-Identifier: MIT
"""Tables of documents are those that benchmarks measured and kept."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import tables
from benchmarks.tables import Table

STROKES = Table(
    "cases", {"case": "", "median": ".2f"}, [("one", 0.125), ("two", None)], "Strokes"
)
SHOWN = (
    "Text.\n\n<!-- table: strokes/cases -->\n| case | median |\n|---|---|\n"
    "| one | 0.12 |\n| two | - |\n<!-- end -->\n\nMore.\n"
)


def test_each_table_of_a_document_is_as_it_was_measured() -> None:
    different = [
        path.name
        for path in tables.documents()
        if tables.updated(path.read_text("utf-8")) != path.read_text("utf-8")
    ]
    assert not different, "write tables by make bench, not by hand"


def test_results_hold_what_documents_show() -> None:
    shown = {each for path in tables.documents() for each in tables.shown(path)}
    kept = {
        (path.stem, name)
        for path in tables.KEPT.glob("*.json")
        for name in tables.kept(path.stem)
    }
    assert kept == shown


def test_the_readme_has_no_comment() -> None:
    assert "<!--" not in (tables.PROJECT / "README.md").read_text("utf-8")


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A document that shows a table of strokes which nobody has measured yet."""
    monkeypatch.setattr(tables, "DOCUMENTS", tmp_path)
    monkeypatch.setattr(tables, "KEPT", tmp_path / "results")
    page = tmp_path / "strokes.md"
    page.write_text("Text.\n\n<!-- table: strokes/cases -->\n<!-- end -->\n\nMore.\n")
    return page


def test_a_measured_table_is_written_where_it_is_shown(desk: Path) -> None:
    tables.keep("strokes", [STROKES, Table("others", {"case": ""}, [("one",)])])
    assert desk.read_text() == SHOWN
    kept = json.loads((tables.KEPT / "strokes.json").read_text())
    assert kept == {"cases": [["case", "median"], ["one", "0.12"], ["two", "-"]]}
    assert tables.updated(SHOWN) == SHOWN


def test_a_terminal_shows_it_in_columns() -> None:
    lines = STROKES.as_text().splitlines()
    assert lines == ["Strokes", "case  median", "one     0.12", "two        -"]
