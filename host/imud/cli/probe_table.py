# SPDX-License-Identifier: MIT
"""`imud list`: a table of the probes, and the counts along the path of their data."""

from __future__ import annotations

import json
import sys
from typing import Any

from imud.cli.status_text import (
    concerns,
    ledger_words,
    notes_words,
    sensor_words,
    sigma_words,
    sinks_words,
    sum_words,
    time_words,
    twin_words,
)
from imud.client import Client
from imud.probes.ledger import totals


def show(client: Client, *, as_json: bool, has_ledger: bool = False) -> int:
    """Prints the last status of each probe: a table, or one JSON object a line."""
    statuses = client.statuses()
    if as_json:
        for status in statuses:
            sys.stdout.write(json.dumps(status, separators=(",", ":")) + "\n")
        return 0
    if not statuses:
        sys.stdout.write("no probe yet\n")
        return 0
    alive = set(client.alive())
    head: tuple[str, ...] = (
        *("probe", "state", "board", "firmware", "rate", "age", "lost", "ledger"),
        *("tilt", "heading", "twin", "equipment"),
    )
    rows = [head, *(_row(status, alive) for status in statuses)]
    if not any(row[-1] for row in rows[1:]):
        rows = [row[:-1] for row in rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write("  ".join(cells).rstrip() + "\n")
    for status in statuses:
        done = status["params"].get("done")
        for sentence in (*concerns(status), *([done] if done else [])):
            sys.stdout.write(f"{status['probe']}: {sentence}\n")
    if has_ledger:
        for status in statuses:
            _write_ledger(status)
    return 0


def _write_ledger(status: dict[str, Any]) -> None:
    """The counts from the sensor to each sink, one line for each link."""
    ledger = status["ledger"]
    lines = (
        ("probe", sensor_words(ledger)),
        ("wire", ledger_words(status)),
        ("sinks", f"{ledger['put']} records each: {sinks_words(ledger)}"),
    )
    sys.stdout.write(f"\n{status['probe']}\n")
    for name, words in lines:
        sys.stdout.write(f"  {name:<6} {words or '-'}\n")


def _row(status: dict[str, Any], alive: set[str]) -> tuple[str, ...]:
    name = str(status["probe"])
    hello = status["hello"]
    quality = status["quality"]
    ledger = status["ledger"]
    total = totals(ledger)
    is_measured = status["pose_rate_hz"] > 0
    return (
        name,
        str(status["state"]) if name in alive or status["port"] else "gone",
        str(hello.get("board") or "?"),
        str(hello.get("firmware") or "?"),
        f"{status['pose_rate_hz']:.0f} Hz",
        time_words(quality.get("age_us"), quality.get("t_bound_us")),
        f"{total.lost} of {total.sent}",
        sum_words(ledger),
        sigma_words(quality["tilt_sigma_deg"]) if is_measured else "-",
        sigma_words(quality["heading_sigma_deg"]) if is_measured else "-",
        twin_words(status),
        notes_words(status),
    )
