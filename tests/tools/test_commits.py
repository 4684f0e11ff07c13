# SPDX-License-Identifier: MIT
"""Subjects of commits are commands: `area: Verb ...`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
import commits


@pytest.mark.parametrize(
    "subject",
    [
        "fuse: Keep the filter running when the full window fits",
        "docs: Say what a quiet hour of attacks costs",
        "host/imud, tests: Pass the port on",
        "sim: Process what is left",
        "imud: Feed a decoder byte by byte",
        "readme: Shorten",
    ],
)
def test_a_command_is_good(subject: str) -> None:
    assert commits.fault(subject) == ""


@pytest.mark.parametrize(
    ("subject", "why"),
    [
        ("fuse: A full window keeps the filter running", "begins with A,"),
        ("fuse: The lag stands once", "begins with The,"),
        ("fuse: It goes on", "begins with It,"),
        ("fuse: Keeps the filter running", "begins with Keeps,"),
        ("fuse: Fixed the lag", "begins with Fixed,"),
        ("fuse: Fixing the lag", "begins with Fixing,"),
        ("fuse: keep the filter running", "is not `area: Verb ...`"),
        ("Keep the filter running", "is not `area: Verb ...`"),
        ("fuse:Keep the filter running", "is not `area: Verb ...`"),
        ("fuse: Keep " + "x" * 50, "has 61 characters, 60 are allowed"),
    ],
)
def test_what_is_no_command_is_told(subject: str, why: str) -> None:
    assert why in commits.fault(subject)


def test_the_newest_subjects_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=A", "-c", "user.email=a@example.org")
        command = ("git", *who, *words)
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(commits, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["commits.py", "--count", "2"])
    assert commits.main() == 0  # no repository, as in a source distribution
    git("init")
    for subject in ("old: The first", "a: Begin", "b: Begins"):
        git("commit", "--allow-empty", "--message", subject)
    assert commits.main() == 1
    assert capsys.readouterr().out == (
        "`b: Begins` begins with Begins, which is no imperative\n"
    )
