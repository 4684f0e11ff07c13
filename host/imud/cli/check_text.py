# SPDX-License-Identifier: MIT
"""The table of `imud check`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from imud.check.rows import Row, RowVerdict, overall, summary

STYLES = {
    RowVerdict.GOOD: "green",
    RowVerdict.LOOK: "yellow",
    RowVerdict.FAULT: "bold red",
    RowVerdict.SKIPPED: "dim",
}
PIPE_COLUMNS = 160  # where there is no terminal


def write(title: str, rows: Sequence[Row]) -> None:
    """Prints the table, what to do, and the verdict."""
    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal:
        console = Console(file=sys.stdout, highlight=False, width=PIPE_COLUMNS)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("check", "measured", "normal", "verdict"):
        table.add_column(name, no_wrap=name == "verdict", overflow="fold")
    for row in rows:
        style = STYLES[row.verdict]
        table.add_row(
            Text(row.name),
            Text(row.measured),
            Text(row.normal, style="dim"),
            Text(str(row.verdict), style=style),
        )
    console.print(Text(title, style="bold"))
    console.print(table)
    advised = [row for row in rows if row.advice]
    if advised:
        console.print(Text("\nWhat to do", style="bold"))
        for row in advised:
            line = Text(f"{row.name}: ", style=STYLES[row.verdict])
            console.print(line.append(row.advice, style="default not bold"))
    found = overall(rows)
    console.print()
    line = Text("verdict: ").append(str(found), style=STYLES[found])
    console.print(line.append(f" ({summary(rows)})", style="default not bold"))
