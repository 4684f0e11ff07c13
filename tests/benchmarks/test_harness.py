# SPDX-License-Identifier: MIT
"""What all benchmarks share: limits, exit codes, and which results are kept."""

from __future__ import annotations

import argparse
import json
import math
from functools import partial
from pathlib import Path

import pytest

from benchmarks import harness
from benchmarks.harness import Figure, Report, Table
from benchmarks.tables import as_markdown


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (87.99, "MISSED"),
        (88.0, "must"),
        (92.99, "must"),
        (93.0, "goal"),
        (97.0, "goal"),
        (97.01, "must"),
        (99.51, "MISSED"),
        (math.nan, "MISSED"),
    ],
)
def test_a_figure_beside_its_limits(value: float, verdict: str) -> None:
    assert Figure("", value, (88.0, 99.5), (93.0, 97.0)).verdict == verdict


def measured(args: argparse.Namespace) -> Report:
    seeds = harness.seeds_of(args)
    table = Table("seeds", {"seed": "d"}, [[seed] for seed in seeds])
    return Report([table], [Figure("seeds", len(seeds), (2, 9), (3, 9))])


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    monkeypatch.setattr(harness.tables, "DOCUMENTS", tmp_path)
    monkeypatch.setattr(harness.tables, "KEPT", tmp_path / "kept")
    (tmp_path / "page.md").write_text("<!-- table: made-f405/seeds -->\n<!-- end -->\n")
    return tmp_path


run = partial(
    harness.run,
    *("made", "", measured, harness.options(seeds=2, boards=("nano", "f405"))),
    variants=["board"],
)


def test_only_a_whole_run_is_kept_for_documents(desk: Path) -> None:
    assert run(arguments=["--board", "f405", "--seeds", "3"]) == 0
    found = json.loads((desk / "made-f405.json").read_text())
    assert found["tables"]["seeds"]["rows"] == [[1], [3], [5]]
    assert not (desk / "kept").exists()
    assert run(arguments=["--board", "f405"]) == 0
    kept = json.loads((desk / "kept" / "made-f405.json").read_text())
    assert kept == {"seeds": [["seed"], ["1"], ["3"]]}
    assert as_markdown(kept["seeds"]) in (desk / "page.md").read_text()


def test_a_missed_figure_makes_the_exit_code_1(desk: Path) -> None:
    assert run(arguments=["--seeds", "1", "--set", "tuning"]) == 1
    found = json.loads((desk / "made.json").read_text())
    assert found["tables"]["seeds"]["rows"] == [[0]]
