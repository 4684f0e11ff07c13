# SPDX-License-Identifier: MIT
"""Selects the daily part of these tests, and their MicroPython."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from length import choose

# Those that build MicroPython for this machine are for `make test-long`.
collect_ignore = choose(
    everyday=["test_altered.py", "test_drivers.py", "test_frames.py", "test_module.py"],
    long=[],
)


@pytest.fixture(scope="module")
def stock() -> Path:
    path = Path(sys.prefix) / "bin" / "micropython"
    if not path.exists():
        # Its wheels are for some Pythons only: docs/limits.md.
        pytest.skip("PyPI has no MicroPython for this Python")
    return path
