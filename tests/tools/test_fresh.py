# SPDX-License-Identifier: MIT
"""tools/fresh.py in a fresh clone on this machine; what it does in a bare Debian shows
when it is run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from programs import ran

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "fresh.py"

MAKEFILE = """
good:
\t@echo "committed: $$VIRTUAL_ENV$$SECRET"
bad:
\t@exit 3
messy:
\t@touch left
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with the script and a Makefile."""
    root = tmp_path / "project"
    (root / "tools").mkdir(parents=True)
    shutil.copy(SCRIPT, root / "tools")
    (root / "Makefile").write_text(MAKEFILE)
    author = ("-c", "user.name=a", "-c", "user.email=a@b")
    for words in (("init", "-q"), ("add", "."), (*author, "commit", "-qm", "all")):
        subprocess.run(["git", "-C", root, *words], check=True)
    return root


def fresh(project: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return ran(
        *(sys.executable, project / "tools" / "fresh.py", *words),
        env=os.environ | {"VIRTUAL_ENV": "a venv", "SECRET": "a secret"},
    )


def test_what_is_committed_runs_and_each_command_is_told(project: Path) -> None:
    (project / "Makefile").write_text(MAKEFILE.replace("committed", "changed"))
    done = fresh(project, "--here", "make good", "make bad", "make good")
    assert done.returncode == 1
    assert "uncommitted changes are not in the clone" in done.stdout
    assert done.stdout.count("committed: \n") == 2  # and nothing of this environment
    assert "changed" not in done.stdout
    table = re.sub(
        r"\d+ s(, used)?|\(\d+ units\)", "", done.stdout.split("\n\n")[-1]
    ).splitlines()
    assert [re.sub(r"  +", "|", row) for row in table] == [
        "this machine|make good|passed",
        "this machine|make bad|FAILED, exit 2",  # make's own
        "this machine|make good|passed",
    ]


def test_all_well_is_0_and_files_that_are_left_are_not_well(project: Path) -> None:
    assert fresh(project, "--here", "make good").returncode == 0
    done = fresh(project, "--here", "make messy")
    assert done.returncode == 1
    assert "FAILED, files left:\n?? left" in done.stdout
