# SPDX-License-Identifier: MIT
"""Rooms are held to their budget of lines and bytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import budget
import pytest

TEXT = """\
not_written_by_hand = ["*.lock"]

[units]
"make test" = 100

[rooms]
"." = [1, 20]
"core" = [2, 4]
"""


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project whose room `core` has just what it may have."""
    for name, text in {
        "README.md": "One line.\n",
        "any.lock": "a\n" * 9,
        "core/math/a.c": "a\n",
        "core/b.c": "b\n",
        "picture.png": "\0\n\n\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    (tmp_path / "untracked.c").write_text("a\n" * 9)
    (tmp_path / "budget.toml").write_text(TEXT)
    monkeypatch.setattr(budget, "ROOT", tmp_path)
    monkeypatch.setattr(budget, "BUDGET", tmp_path / "budget.toml")
    monkeypatch.setattr(budget, "SPENT", tmp_path / "spent.json")
    monkeypatch.setattr(sys, "argv", ["budget"])
    return tmp_path


def test_what_people_write_counts_in_its_innermost_room(capsys):
    assert budget.main() == 0
    *rooms, total = capsys.readouterr().out.splitlines()
    assert [line.split() for line in rooms] == [
        ["1", "lines", "10", "bytes", "."],
        ["2", "lines", "4", "bytes", "core"],
    ]
    assert total.split() == ["3", "lines", "14", "bytes", "in", "all"]


@pytest.mark.parametrize(("units", "status"), [(100, 0), (101, 1)])
def test_a_command_that_takes_too_much_of_a_processor_fails(root, units, status):
    (root / "spent.json").write_text(f'{{"make demo": 900, "make test": {units}}}')
    assert budget.main() == status


def test_a_line_too_many_fails(root, capsys):
    (root / "core/b.c").write_text("\n\n")
    assert budget.main() == 1
    assert "core: 1 lines above its budget" in capsys.readouterr().out


def test_a_line_that_is_packed_fails(root, capsys):
    (root / "core/b.c").write_text("b b\n")
    assert budget.main() == 1
    assert "core: 2 bytes above its budget" in capsys.readouterr().out


def test_a_budget_is_lowered_and_never_raised(root, monkeypatch):
    (root / "core/b.c").write_text("b b b\n")
    monkeypatch.setattr(sys, "argv", ["budget", "--lower"])
    assert budget.main() == 1
    lowered = (root / "budget.toml").read_text()
    assert lowered == TEXT.replace('"." = [1, 20]', '"." = [1, 10]')
