# SPDX-License-Identifier: MIT
"""`imud check` at work: it measures, asks, judges; prints the table, and writes the
report.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from imud.calibration.recording import Sample
from imud.check import report
from imud.check.axes import ASKED, TIMEOUT_S, PoseGuide
from imud.check.chips import is_dead
from imud.check.evidence import Evidence, Posed
from imud.check.judge import judged
from imud.check.readings import MG, rest_of
from imud.check.rows import Row, RowVerdict, overall, summary
from imud.check.touch import led_words
from imud.cli import check_source
from imud.cli.calibrate_source import scale_of
from imud.cli.check_screen import CheckScreen
from imud.cli.check_source import LiveMessages
from imud.cli.keyboard import Quit
from imud.errors import FileError

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


# Without samples, how long to wait for the probe's messages about it.
DEAD_S = 6.0
BUTTON_S = 15.0
LATE_S = 5.0
STATUS_S = 1.5  # the next status comes by then

ENTER, YES_NO = ("\n", "\r"), ("y", "n")


def live(args: argparse.Namespace) -> int:
    """With a probe; returns the exit code."""
    evidence = Evidence(is_live=True)
    with check_source.opened(args) as source:
        screen = CheckScreen(sys.stderr if args.json else sys.stdout, source.title)
        try:
            with screen.opened():
                _measure(source, evidence, screen, args.seconds)
                if not evidence.other_schema and evidence.count:
                    if not args.no_poses:
                        _lay(source, evidence, screen)
                    if not args.no_button:
                        _touch(source, evidence, screen)
                source.add_params(evidence)
        except Quit:
            sys.stderr.write("imud: stopped; nothing was changed\n")
            return 1
    return _report(evidence, args, source.title)


def from_file(args: argparse.Namespace) -> int:
    """With a log or a capture; returns the exit code."""
    title, evidence = check_source.of_file(args.source, args.probe)
    return _report(evidence, args, title)


def _measure(
    source: LiveMessages, evidence: Evidence, screen: CheckScreen, seconds: float
) -> None:
    """Measures at rest, for some seconds; of a dead probe, only its messages."""
    source.begin(evidence)
    begin_s = time.monotonic()
    lay = "Lay it base down on a table and do not touch it"
    screen.line(f"{lay}, for {seconds:g} s.")
    for item in source.items():
        if item is not None:
            source.record(item, evidence)
        spent_s = time.monotonic() - begin_s
        is_mute = evidence.other_schema or is_dead(evidence) or not evidence.count
        until_s = min(seconds, DEAD_S) if is_mute else seconds
        if spent_s >= until_s:
            return
        screen.show(f"{lay}: {until_s - spent_s:.0f} s left", spent_s / until_s)
        screen.key()


def _lay(source: LiveMessages, evidence: Evidence, screen: CheckScreen) -> None:
    """Measures the poses; the first is the one of the measurement at rest."""
    hello = evidence.hello
    rest = rest_of(evidence, evidence.samples())
    if not rest.is_enough:
        return  # noise would hide each rest
    scale = scale_of(hello, hello["raw_rate"])
    evidence.is_posing = True
    guide = PoseGuide(scale, ASKED[1:])
    x, y, z = (float(each) for each in rest.acc_mg * MG)
    guide.start_from((x, y, z))
    wanted, asked_s = guide.wanted, time.monotonic()
    for item in source.items():
        if guide.wanted is not wanted:
            wanted, asked_s = guide.wanted, time.monotonic()
        if wanted is None:
            break
        words = f"Lay it {wanted.words}, and let go"
        screen.line(f"{words} ({TIMEOUT_S:g} s; Enter skips it).")
        screen.show(f"{words}. Enter skips it, q stops", None)
        if item is not None:
            source.record(item, evidence)
            if item["type"] == "raw":
                guide.feed(sample_of(item))
        # Its own time is that of the samples, which may have stopped.
        is_late = time.monotonic() - asked_s > TIMEOUT_S + LATE_S
        if screen.key() in ENTER or is_late:
            guide.skip()
    evidence.poses = [Posed(ASKED[0], (x, y, z)), *guide.found]


def sample_of(item: dict[str, Any]) -> Sample:
    """A raw sample as it is published."""
    mag = item["mag_counts"]
    return Sample(
        item["t_device_us"],
        tuple(item["acc_counts"]),
        tuple(item["gyr_counts"]),
        None if mag is None else tuple(mag),
        item["temperature_c"],
    )


def _touch(source: LiveMessages, evidence: Evidence, screen: CheckScreen) -> None:
    """Checks the button, then the LED."""
    evidence.button = False
    begin_s, before = time.monotonic(), len(evidence.events)
    words = "Press its button once"
    screen.line(f"{words} ({BUTTON_S:g} s).")
    for item in source.items():
        if item is not None:
            source.record(item, evidence)
        events = {each.event for each in evidence.events[before:]}
        if "button_pressed" in events:
            evidence.button = True
            break
        left_s = BUTTON_S - (time.monotonic() - begin_s)
        screen.show(f"{words}: {left_s:.0f} s left. Enter skips it", None)
        if screen.key() in ENTER:
            evidence.button = None
            break
        if left_s <= 0:
            break
    if screen.is_terminal:
        _look(source, evidence, screen)


def _look(source: LiveMessages, evidence: Evidence, screen: CheckScreen) -> None:
    """Asks about the LED, once the state after the press is known."""
    begin_s = time.monotonic()
    for item in source.items():
        if item is not None:
            source.record(item, evidence)
        if time.monotonic() - begin_s > STATUS_S:
            shows = led_words(
                str(evidence.hello.get("board")), str(evidence.counters.get("state"))
            )
            screen.show(f"{shows}. Does it? y, n, or Enter if you can't see it", None)
            pressed = screen.key()
            if pressed in YES_NO:
                evidence.led = pressed == YES_NO[0]
            if pressed in (*YES_NO, *ENTER):
                return


def _report(evidence: Evidence, args: argparse.Namespace, title: str) -> int:
    rows = judged(evidence)
    publish(evidence, rows, args, title)
    return exit_code(rows)


def publish(
    evidence: Evidence, rows: Sequence[Row], args: argparse.Namespace, title: str
) -> None:
    """Prints the table or the report, and writes the files that were asked for."""
    today = datetime.datetime.now(datetime.UTC).date()
    found = report.as_object(evidence, rows, today)
    if args.json:
        sys.stdout.write(json.dumps(found, separators=(",", ":")) + "\n")
    else:
        write(title, rows)
    for path in _write(args.report, found):
        if not args.json:
            sys.stdout.write(f"report: {path}\n")


def exit_code(rows: Sequence[Row]) -> int:
    """1 if there is a fault."""
    return 1 if overall(rows) is RowVerdict.FAULT else 0


def _write(path: Path | None, found: dict[str, Any]) -> list[Path]:
    """Writes the report by its suffix, without one both kinds; the paths."""
    if path is None:
        return []
    kinds = {
        ".json": lambda: json.dumps(found, indent=2) + "\n",
        ".md": lambda: report.as_markdown(found),
    }
    wanted = [path.suffix] if path.suffix else list(kinds)
    written = []
    for suffix in wanted:
        whole = path if path.suffix else path.with_name(path.name + suffix)
        try:
            whole.write_text(kinds[suffix](), "utf-8")
        except OSError as error:
            raise FileError(f"can't write {whole}: {error.strerror}") from error
        written.append(whole)
    return written
