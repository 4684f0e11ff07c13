# SPDX-License-Identifier: MIT
"""Runs Python so that C which it loads may be under the address sanitizer."""

from __future__ import annotations

import subprocess


def environment() -> dict[str, str]:
    """Variables for such a process, as the Makefile's `asan` has them."""
    library = subprocess.run(
        ["gcc", "-print-file-name=libasan.so"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    return {
        "IMU_ASAN": "1",
        "ASAN_OPTIONS": "detect_leaks=0",  # the interpreter's own
        # C++ that throws has to be there before the sanitizer.
        "LD_PRELOAD": f"{library} libstdc++.so.6",
    }
