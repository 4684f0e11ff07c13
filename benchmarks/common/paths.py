# SPDX-License-Identifier: MIT
"""Where benchmarks read and write."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parents[2]
RECORDINGS = PROJECT.parent / "shared" / "data" / "broad"
RESULTS = PROJECT / "build" / "benchmarks"
PICTURES = PROJECT / "docs" / "pictures"


def write_results(path: Path, found: Any) -> None:
    """As JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
