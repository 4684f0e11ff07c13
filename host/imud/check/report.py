# SPDX-License-Identifier: MIT
"""The report of `imud check`, to be attached to a bug report: as an object for JSON,
and as Markdown. It has no names: no host, user, path, serial number or probe id.
"""

from __future__ import annotations

import datetime
import platform
from collections import Counter
from collections.abc import Sequence
from typing import Any

from imud.check.evidence import Evidence
from imud.check.rows import Row, overall, summary
from imud.version import version

# Fields of the hello that identify a kind of board, but no single board.
OF_HELLO = (
    *("board", "firmware", "schema_fingerprint", "sensor", "who_am_i", "mag_adjust"),
    *("self_test", "sample_rate", "pose_rate", "raw_rate", "reset_cause", "filter"),
    "reset_address",
)


def as_object(
    evidence: Evidence, rows: Sequence[Row], day: datetime.date
) -> dict[str, Any]:
    """The whole report, with all numbers."""
    events = Counter(f"{each.event} {each.cause}" for each in evidence.events)
    responses = evidence.responses
    return {
        "verdict": str(overall(rows)),
        "summary": summary(rows),
        "day": day.isoformat(),
        "imud": version(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "hello": {name: evidence.hello.get(name) for name in OF_HELLO},
        "rows": [
            {
                "name": row.name,
                "verdict": str(row.verdict),
                "measured": row.measured,
                "normal": row.normal,
                "advice": row.advice,
                "numbers": dict(row.numbers),
            }
            for row in rows
        ],
        "events": dict(events),
        "counters": evidence.counters,
        "equipment": evidence.equipment,
        "self_test": None
        if responses is None
        else {name: getattr(responses, name) for name in type(responses).__slots__},
    }


def as_markdown(report: dict[str, Any]) -> str:
    """The object of as_object(), as a text."""
    hello = report["hello"]
    lines = [
        f"# imud check: {report['verdict']}",
        "",
        f"{report['summary']}.",
        "",
        f"{_who(hello)}; "
        f"imud {report['imud']}, Python {report['python']}, {report['system']}; "
        f"{report['day']}.",
        "",
        "| check | measured | normal | verdict |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {_cell(row['name'])} | {_cell(row['measured'])} | {_cell(row['normal'])} "
        f"| {row['verdict']} |"
        for row in report["rows"]
    ]
    advised = [row for row in report["rows"] if row["advice"]]
    if advised:
        lines += ["", "## What to do", ""]
        lines += [f"- **{row['name']}**: {row['advice']}" for row in advised]
    lines += ["", "## Numbers", "", "```"]
    lines += [
        f"{row['name']}: {row['numbers']}" for row in report["rows"] if row["numbers"]
    ]
    for name in ("hello", "events", "counters", "equipment", "self_test"):
        lines.append(f"{name}: {report[name]}")
    return "\n".join([*lines, "```", ""])


def _who(hello: dict[str, Any]) -> str:
    """The board, by its hello."""
    if hello["board"] is None:
        return "no hello was received"
    words = (
        hello["board"],
        f"firmware {hello['firmware'] or 'unknown'}",
        f"sensor {hello['sensor'] or 'unknown'}",
    )
    return ", ".join(words)


def _cell(text: str) -> str:
    """Text that does not end a cell of a table."""
    return text.replace("|", "\\|").replace("\n", " ")
