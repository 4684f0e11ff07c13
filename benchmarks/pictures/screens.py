# SPDX-License-Identifier: MIT
"""Makes docs/pictures/monitor.svg and list.svg: a terminal with two virtual probes, a
Nano and an F405, running their images.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from io import StringIO

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text

from benchmarks.common.paths import PICTURES
from benchmarks.page.desk import served
from imud.cli import monitor
from imud.client import subscribe

COLUMNS, ROWS = 80, 24
MOVING_S = 8.0

# Fonts of the viewer's machine, so that a picture loads none from a server.
_FORMAT = re.sub(
    r"@font-face \{\{.*?\}\}\s*|<!--.*?-->\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL
)


def main() -> int:
    with served() as (_, endpoint):
        screen = monitor.MonitorScreen(endpoint)
        with subscribe(topics=("pose", "status"), endpoint=endpoint) as subscription:
            now_s = monitor.follow(subscription, screen, time.monotonic() + MOVING_S)
        _save(screen.lines(now_s, ROWS), "monitor", "imud monitor", COLUMNS)
        command = [sys.executable, "-m", "imud", "list", "--ledger"]
        command += ["--connect", endpoint]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        lines = [Text(line) for line in done.stdout.splitlines()]
        width = max(len(line) for line in lines)
        _save(lines, "list", "imud list --ledger", width)
    return 0


def _save(lines: list[Text], name: str, title: str, width: int) -> None:
    console = Console(
        record=True, width=width, file=StringIO(), force_terminal=True, highlight=False
    )
    for line in lines:
        console.print(line, no_wrap=True, overflow="crop")
    path = PICTURES / f"{name}.svg"
    svg = console.export_svg(title=title, code_format=_FORMAT, unique_id=name)
    path.write_text(re.sub(r"[ \t]+$", "", svg, flags=re.MULTILINE))
    print(f"{path}: {len(lines)} lines, {width} columns")


if __name__ == "__main__":
    sys.exit(main())
