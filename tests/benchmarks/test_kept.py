# SPDX-License-Identifier: MIT
"""What stays of a benchmark's results, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import kept


@pytest.mark.parametrize(
    ("part", "found"),
    [
        (kept.cycles, {"seconds": 30.0}),
        (kept.micropython, {"seconds": 3.0}),
        (kept.pico, {"seconds": 9.0}),
        (kept.faults, {"failed": 1}),
    ],
)
def test_partial_results_are_refused(part, found) -> None:
    with pytest.raises(kept.NotWholeError):
        part(found)


def test_floats_are_rounded_and_counts_are_not() -> None:
    found = {"a": [0.123456789, 12345678, None, "x"], "b": {"c": 1234567.8}}
    assert kept.rounded(found) == {
        "a": [0.123457, 12345678, None, "x"],
        "b": {"c": 1234570.0},
    }


def test_only_results_of_this_run_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    monkeypatch.setattr(kept, "FOLDER", kept.PROJECT / "build" / "kept-by-a-test")
    source = tmp_path / "cycles.json"
    source.write_text(
        json.dumps({"seconds": 120.0, "figures": {}, "summary": {}, "commanded": []})
    )
    written = source.stat().st_mtime
    kept.keep_all("nano", written + 1.0)
    kept.keep_all("pico", written)
    assert capsys.readouterr().out == ""
    kept.keep_all("nano", written)
    assert capsys.readouterr().out == "kept: build/kept-by-a-test/nano.json\n"
    # Partial ones are left as they were, and say so.
    source.write_text('{"seconds": 1.0}')
    kept.keep_all("nano", written)
    assert capsys.readouterr().out.startswith("not kept: cycles.json is partial")
    (file,) = kept.FOLDER.iterdir()
    assert json.loads(file.read_text())["command"] == "make bench WHAT=nano"
    file.unlink()
    kept.FOLDER.rmdir()
