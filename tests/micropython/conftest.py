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

# Those that build MicroPython for this machine are for `make test-long`.
collect_ignore = choose(
    everyday=["test_altered.py", "test_drivers.py", "test_frames.py"],
    long=[],
)
ROOT = Path(__file__).resolve().parents[2]
BUILT = ROOT / "build" / "mpy" / "imuprobe-x64.mpy"


@pytest.fixture(scope="session")
def stock() -> Path:
    path = Path(sys.prefix) / "bin" / "micropython"
    if not path.exists():
        # Its wheels are for some Pythons only: docs/limits.md.
        pytest.skip("PyPI has no MicroPython for this Python")
    return path


@pytest.fixture(scope="session")
def with_module(stock: Path, tmp_path_factory: pytest.TempPathFactory) -> Command:
    """The command of a MicroPython that finds the module in a folder."""
    if not BUILT.exists():
        leave_out("this machine can't fetch MicroPython's sources")
    subprocess.run([sys.executable, ROOT / "tools" / "mpy.py", "x64"], check=True)
    folder = tmp_path_factory.mktemp("mpy")
    shutil.copyfile(BUILT, folder / "imuprobe.mpy")
    path = f"MICROPYPATH={folder}:{Path(__file__).parent / 'stock'}"
    return ("env", path, str(stock), "-X", "heapsize=16m")
