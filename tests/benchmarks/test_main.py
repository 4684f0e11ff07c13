# SPDX-License-Identifier: MIT
"""`make bench WHAT=...`: what it knows, and what it says of what it does not know."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import __main__ as benches
from programs import ran

ROOT = Path(__file__).resolve().parents[2]


def test_an_unknown_what_is_refused_with_one_line_that_lists_the_known_ones() -> None:
    done = ran("make", "--silent", "bench", "WHAT=nonsense", cwd=ROOT)
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    assert lines == [f"bench: no WHAT=nonsense; there are {', '.join(benches.BENCHES)}"]


def test_help_names_all_that_can_be_measured() -> None:
    output = ran("make", "help", cwd=ROOT, check=True).stdout
    (line,) = (line for line in output.splitlines() if line.startswith("bench "))
    others = [name for name in benches.BENCHES if name != benches.DEFAULT]
    assert line.split(maxsplit=1)[1] == (
        f"{benches.DEFAULT}, or WHAT={', '.join(others)}"
    )


def test_programs_run_in_their_order_though_one_misses_a_figure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[list[str]] = []

    def run(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        started.append(words)
        return subprocess.CompletedProcess(words, returncode=len(started) % 3)

    monkeypatch.setattr(benches.subprocess, "run", run)
    assert benches.main([]) == 1
    own = [sys.executable, "-m", "benchmarks"]
    program, groups = [*own, "accuracy/recordings.py"], [*own, "accuracy/groups.py"]
    f405 = ["--board", "f405"]
    assert started == [program, [*program, *f405], groups, [*groups, *f405]]


@pytest.mark.parametrize("what", benches.BENCHES)
def test_every_program_is_there(what: str) -> None:
    _, *programs = benches.BENCHES[what]
    assert programs
    for program in programs:
        assert (ROOT / "benchmarks" / program.split()[0]).is_file()
