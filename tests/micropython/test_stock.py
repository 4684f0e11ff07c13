# SPDX-License-Identifier: MIT
"""The package in MicroPython's own unix port, as PyPI has it: frames, and files on its
own file systems with the power cut at every write."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from micropython_frames import PACKAGE, PROGRAMS, assert_frames_are_those_of_c


@pytest.fixture(scope="module")
def stock() -> Path:
    path = Path(sys.prefix) / "bin" / "micropython"
    if not path.exists():
        # Its wheels are for some Pythons only: README.md, Limits.
        pytest.skip("PyPI has no MicroPython for this Python")
    return path


def test_its_frames_are_those_of_the_c(stock: Path, tmp_path: Path) -> None:
    assert_frames_are_those_of_c([stock, "-X", "heapsize=16m"], 1000, tmp_path)


@pytest.mark.parametrize(("system", "writes"), [("littlefs", 12), ("fat", 8)])
def test_a_power_cut_at_any_write_leaves_whole_settings(
    stock: Path, system: str, writes: int
) -> None:
    done = subprocess.run(
        [stock, PROGRAMS / "files.py", PACKAGE, system],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == writes
