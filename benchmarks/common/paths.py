# SPDX-License-Identifier: MIT
"""Where benchmarks read and write."""

from __future__ import annotations

from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
RECORDINGS = PROJECT.parent / "shared" / "data" / "broad"
RESULTS = PROJECT / "build" / "benchmarks"
PICTURES = PROJECT / "docs" / "pictures"
