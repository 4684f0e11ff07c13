# SPDX-License-Identifier: MIT
"""Tables of results, and where documents show them.

A document has a whole table between two comments, never a figure within a sentence:

    <!-- table: strokes/cases -->
    | case | median |
    |---|---|
    | supported, 1 s | 0.20 |
    <!-- end -->

`make bench` writes these tables, and keeps them in benchmarks/results/strokes.json, so
that a test can tell whether somebody changed one by hand.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common.paths import PROJECT

KEPT = PROJECT / "benchmarks" / "results"
DOCUMENTS = PROJECT / "docs"
SHOWN = re.compile(
    r"(?P<head><!-- table: (?P<name>[\w-]+)/(?P<table>[\w-]+) -->\n)"
    r"(?P<rows>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)

Cell = str | float | None  # None and NaN: not known
Row = Mapping[str, Any]
Text = list[list[str]]  # heads, then rows


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under heads; `columns` has the format of each head's cells, as ".2f"."""

    name: str
    columns: Mapping[str, str]
    rows: Sequence[Sequence[Any]]  # Cells
    title: str = ""

    @staticmethod
    def of(
        name: str, columns: Mapping[str, tuple[str, str]], rows: Iterable[Row]
    ) -> Table:
        """A table of dicts: of each head the key and the format of its cells."""
        keys = [key for key, _ in columns.values()]
        forms = {head: form for head, (_, form) in columns.items()}
        return Table(name, forms, [[row.get(key) for key in keys] for row in rows])

    def text(self) -> Text:
        """Heads and rows as documents show them."""
        formats = self.columns.values()
        rows = [
            [_shown(*pair) for pair in zip(row, formats, strict=True)]
            for row in self.rows
        ]
        return [[*self.columns], *rows]

    def as_text(self) -> str:
        """For a terminal: the first column to the left, the others to the right."""
        text = self.text()
        widths = [max(map(len, column)) for column in zip(*text, strict=True)]
        lines = [
            "  ".join(
                cell.rjust(width) if number else cell.ljust(width)
                for number, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in text
        ]
        return "\n".join([*([self.title] if self.title else []), *lines])


def _shown(cell: Cell, form: str) -> str:
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return "-"
    return cell if isinstance(cell, str) else format(cell, form)


def as_markdown(text: Text) -> str:
    """A table of a document."""
    head, *rows = [f"| {' | '.join(row)} |" for row in text]
    return "\n".join([head, "|---" * len(text[0]) + "|", *rows, ""])


def keep(name: str, found: Sequence[Table]) -> None:
    """Keep those that documents show, and write them there."""
    wanted = {table for path in documents() for _, table in shown(path, name)}
    kept = {each.name: each.text() for each in found if each.name in wanted}
    if not wanted:
        return
    lines = [
        f" {json.dumps(table)}: [\n"
        + ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in text)
        + "\n ]"
        for table, text in kept.items()
    ]
    KEPT.mkdir(exist_ok=True)
    content = "{\n" + ",\n".join(lines) + "\n}\n"
    (KEPT / f"{name}.json").write_text(content, "utf-8")
    for path in documents():
        path.write_text(updated(path.read_text("utf-8")), "utf-8")


def documents() -> Iterator[Path]:
    """Those that may show tables."""
    return iter(sorted(DOCUMENTS.rglob("*.md")))


def shown(path: Path, name: str | None = None) -> Iterator[tuple[str, str]]:
    """Results and table of each table that a document shows, or those of one name."""
    for match in SHOWN.finditer(path.read_text("utf-8")):
        if name in (None, match["name"]):
            yield match["name"], match["table"]


def kept(name: str) -> dict[str, Text]:
    """The tables of benchmarks/results/NAME.json; none if there is no such file."""
    path = KEPT / f"{name}.json"
    found: dict[str, Text] = (
        json.loads(path.read_text("utf-8")) if path.exists() else {}
    )
    return found


def updated(text: str) -> str:
    """A document with its tables as they are kept; one that is not kept stays."""

    def written(match: re.Match[str]) -> str:
        rows = kept(match["name"]).get(match["table"])
        body = match["rows"] if rows is None else as_markdown(rows)
        return f"{match['head']}{body}{match['end']}"

    return SHOWN.sub(written, text)
