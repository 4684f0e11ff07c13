# SPDX-License-Identifier: MIT
"""The audit of a log as one HTML file that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imud.rotation import FloatArray
from imud.version import version

if TYPE_CHECKING:
    from imud.recordings.audit import Audit, Shares

WIDTH, HEIGHT, LEFT, BELOW = 900, 220, 50, 24
COLUMNS = 600  # of a curve: each has the largest of its poses
HEAD = '<!doctype html><html lang="en"><meta charset="utf-8"><title>Audit of '
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto;
  padding: 0 1rem; color: #1b1b1b; background: #fff }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem }
td, th { padding: 0.15rem 0.9rem; text-align: right; border-bottom: 1px solid #ddd }
td:first-child, th:first-child { text-align: left; padding-left: 0 }
svg { width: 100%; height: auto } text { font-size: 12px; fill: #555 }
.band { fill: #d7e6f5 } .line { fill: none; stroke: #b3261e; stroke-width: 1.2 }
.axis { stroke: #aaa } .note { color: #555 }
"""


def is_page(path: Path) -> bool:
    """Whether a file is such a page."""
    try:
        with path.open("rb") as file:
            return file.read(len(HEAD)) == HEAD.encode()
    except OSError:
        return False


def page_of(name: str, unseen: str, audits: Sequence[Audit]) -> str:
    """The page; `unseen`: what it can't tell."""
    parts = "".join(map(_section, audits))
    return (
        f"{HEAD}{escape(name)}</title><style>{STYLE}</style>"
        f"<h1>Audit of {escape(name)}</h1><p>{escape(unseen)}</p>{parts}"
        f'<p class="note">By imud {escape(version())}. Poses computed on line '
        "beside those that were estimated afterwards from all samples.</p></html>\n"
    )


def _section(audit: Audit) -> str:
    doubts = "".join(f"<li>{escape(words)}</li>" for words in audit.doubts)
    withheld = f"<p>Withheld:</p><ul>{doubts}</ul>" if doubts else ""
    return (
        f"<h2>Probe {escape(audit.probe)}</h2>{withheld}"
        f"<h3>Tilt</h3>{_curve(audit.time_s, audit.tilt, audit.tilt_sigma)}"
        f"<h3>Heading</h3>{_curve(audit.time_s, audit.heading, audit.heading_sigma)}"
        '<p class="note">Line: largest difference in degrees over seconds; band: the '
        "95 % that were stated on line.</p>"
        f"{_table('Minutes', [audit.all, *audit.by_minute()])}"
        f"{_table('Causes', audit.by_cause())}"
    )


def _table(title: str, rows: Iterable[Shares]) -> str:
    head = "".join(
        f"<th>{words}"
        for words in (title, "poses", "tilt, deg", "inside", "heading, deg", "inside")
    )
    body = "".join(
        f"<tr><td>{escape(row.name)}<td>{row.count}<td>{_number(row.tilt)}"
        f"<td>{_percent(row.tilt_inside)}<td>{_number(row.heading)}"
        f"<td>{_percent(row.heading_inside)}"
        for row in rows
    )
    return f"<table><tr>{head}{body}</table>"


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2f}"


def _percent(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.0%}"


def _curve(time_s: FloatArray, off: FloatArray, sigma: FloatArray) -> str:
    """Differences over time, and what was stated."""
    size, band = np.abs(off), 1.96 * sigma
    known = np.isfinite(size)
    if not known.any():
        return "<p>No pose can be compared.</p>"
    end = float(time_s[-1]) or 1.0
    column = np.minimum((COLUMNS * time_s / end).astype(int), COLUMNS - 1)
    most = 1.1 * float(np.nanmax(np.where(known, size, np.nan)))
    most = max(most, 1.1 * float(np.nanpercentile(band[known], 90)), 0.1)

    def points(values: FloatArray) -> str:
        highest = np.full(COLUMNS, -1.0)
        usable = np.isfinite(values)
        np.maximum.at(highest, column[usable], values[usable])
        return " ".join(
            f"{LEFT + (at + 0.5) * (WIDTH - LEFT) / COLUMNS:.1f},"
            f"{HEIGHT - BELOW - min(value / most, 1.0) * (HEIGHT - BELOW - 8):.1f}"
            for at, value in enumerate(highest.tolist())
            if value >= 0.0
        )

    floor = HEIGHT - BELOW
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="differences">'
        f'<polygon class="band" points="{LEFT},{floor} {points(band)} '
        f'{WIDTH},{floor}"/>'
        f'<polyline class="line" points="{points(size)}"/>'
        f'<line class="axis" x1="{LEFT}" y1="{floor}" x2="{WIDTH}" y2="{floor}"/>'
        f'<text x="0" y="14">{most:.2f}&#176;</text>'
        f'<text x="0" y="{floor}">0&#176;</text>'
        f'<text x="{LEFT}" y="{HEIGHT - 6}">0 s</text>'
        f'<text x="{WIDTH - 60}" y="{HEIGHT - 6}">{end:.0f} s</text></svg>'
    )
