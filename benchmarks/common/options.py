# SPDX-License-Identifier: MIT
"""The options of a benchmark that keeps seeds for tuning and for judging apart."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path


def parser_of(
    description: str | None, sets: Collection[str], output: Path
) -> argparse.ArgumentParser:
    """With --sets, all by default, and --output, that file by default."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--sets", nargs="+", choices=sets, default=list(sets))
    parser.add_argument("--output", metavar="FILE", type=Path, default=output)
    return parser
