# SPDX-License-Identifier: MIT
"""What of these tests runs every day."""

from __future__ import annotations

from length import choose

# Those that build MicroPython for this machine are for `make test-long`.
collect_ignore = choose(
    everyday=["test_drivers.py", "test_frames.py", "test_module.py"], long=[]
)
