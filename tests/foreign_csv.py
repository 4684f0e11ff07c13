# SPDX-License-Identifier: MIT
"""Tables of text as other programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imud.rotation import FloatArray

EVEN = np.arange(3000) / 100.0  # times of a motion_with()


def lines(*rows: str) -> str:
    return "\n".join(rows) + "\n"


def named(*patterns: str) -> list[str]:
    return [pattern.format(axis) for pattern in patterns for axis in "xyz"]


def motion_with(path: Path, t: FloatArray, *, scale: float = 1.0) -> Path:
    """A body that turns about x; 100 rows a second."""
    at = np.arange(len(t)) / 100.0
    angle, none = at + np.sin(at), np.zeros_like(at)
    acc = scale * np.stack([none, np.sin(angle), np.cos(angle)], axis=1)
    gyr = np.stack([1.0 + np.cos(at), none, none], axis=1)
    names = ["time", *named("acc_{}_g", "gyr_{}_rad_s")]
    rows = [names, *np.column_stack([t, acc, gyr]).tolist()]
    path.write_text(lines(*(",".join(map(str, row)) for row in rows)))
    return path
