# SPDX-License-Identifier: MIT
"""Selects the daily part of these tests, and their MicroPython."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from demanded import leave_out
from length import choose
from micropython_tape import Command

# Those that build MicroPython's unix port are for `make test-long`.
collect_ignore = choose(
    everyday=["test_altered.py", "test_drivers.py", "test_frames.py"],
    long=[],
)
ROOT = Path(__file__).resolve().parents[2]
BUILT = ROOT / "build" / "mpy" / "imuprobe-x64.mpy"


@pytest.fixture(scope="session")
def with_module(stock: Path, tmp_path_factory: pytest.TempPathFactory) -> Command:
    """The command of a MicroPython that finds the module in a folder."""
    if not BUILT.exists():
        leave_out("this machine can't fetch MicroPython's sources")
    subprocess.run([sys.executable, ROOT / "tools" / "mpy.py", "x64"], check=True)
    folder = tmp_path_factory.mktemp("mpy")
    shutil.copyfile(BUILT, folder / "imuprobe.mpy")
    return command(stock, folder)


@pytest.fixture(scope="session")
def micropython() -> Command:
    """The command of one that has module and modelled sensors inside; built first."""
    tool = ROOT / "tools" / "micropython_build.py"
    subprocess.run([sys.executable, tool, "unix"], check=True)
    return command(ROOT / "build" / "micropython" / "unix" / "micropython")


def command(program: Path, *places: Path) -> Command:
    shared = (Path(__file__).parent / "stock", ROOT / "benchmarks" / "firmware")
    path = ":".join(map(str, (*places, *shared)))
    return ("env", f"MICROPYPATH={path}", str(program), "-X", "heapsize=64m")
