# SPDX-License-Identifier: MIT
"""Makes docs/pictures/monitor.svg and list.svg: a terminal with two virtual probes, a
Nano and an F405, running their images.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from io import StringIO
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text

from benchmarks.common.images import simulated
from benchmarks.common.paths import PICTURES
from imud.cli import monitor
from imud.client import Client, subscribe

IMUD = (sys.executable, "-m", "imud")
BOARDS = {"nano": 500_000, "f405": 921_600}
ENDPOINT = "tcp/127.0.0.1:7461"
COLUMNS, ROWS = 80, 24

# After the gyroscope's calibration, when the hand has begun to move the probe.
WAIT_S = 60.0
MOVING_S = 8.0

# Fonts of the viewer's machine, so that a picture loads none from a server.
_FORMAT = re.sub(
    r"@font-face \{\{.*?\}\}\s*|<!--.*?-->\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL
)


def main() -> int:
    with ExitStack() as stack:
        room = Path(tempfile.gettempdir())
        ports = []
        for board, baud in BOARDS.items():
            link = room / f"imud-screens-{board}"
            _start(stack, *simulated(board), "--stream", "--link", str(link))
            ports.append(f"{link}@{baud}")
            _wait_for(link)
        logs = stack.enter_context(tempfile.TemporaryDirectory())
        _start(stack, "run", *ports, "--log", logs, "--listen", ENDPOINT)
        screen = _follow()
        _save(screen.lines(time.monotonic(), ROWS), "monitor", "imud monitor", COLUMNS)
        command = [*IMUD, "list", "--ledger", "--connect", ENDPOINT]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        lines = [Text(line) for line in done.stdout.splitlines()]
        width = max(len(line) for line in lines)
        _save(lines, "list", "imud list --ledger", width)
    return 0


def _start(stack: ExitStack, *arguments: str) -> None:
    process = subprocess.Popen(
        [*IMUD, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    stack.callback(process.wait)
    stack.callback(process.terminate)


def _wait_for(link: Path) -> None:
    until_s = time.monotonic() + WAIT_S
    while not link.exists():
        if time.monotonic() > until_s:
            raise SystemExit(f"{link} did not appear; make firmware, make sim")
        time.sleep(0.05)


def _follow() -> monitor.MonitorScreen:
    """The monitor's view after both probes have moved for a while."""
    until_s = time.monotonic() + WAIT_S
    while True:
        try:
            with Client(ENDPOINT) as client:
                client.wait_for(seconds=WAIT_S)
            break
        except Exception:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.2)
    screen = monitor.MonitorScreen(ENDPOINT)
    with subscribe(topics=("pose", "status"), endpoint=ENDPOINT) as subscription:
        now_s = time.monotonic()
        while not _are_streaming(screen, now_s):
            if now_s > until_s:
                raise SystemExit("the probes did not stream; make firmware, make sim")
            now_s = monitor.follow(subscription, screen, now_s + 0.1)
        monitor.follow(subscription, screen, now_s + MOVING_S)
    return screen


def _are_streaming(screen: monitor.MonitorScreen, now_s: float) -> bool:
    moving = [shown for shown in screen.probes.values() if shown.has_pose(now_s)]
    return len(moving) == len(BOARDS) and all(shown.status for shown in moving)


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
