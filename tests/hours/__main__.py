# SPDX-License-Identifier: MIT
"""Runs the images themselves for hours of their time, in their emulators, as fast as
the machine goes: faults, commands and the button from a seed, each pose against the
twin's, and a line for each hour.

Ctrl-C, or the end of --minutes, stops the boards where they are. The next call resumes
from there, as long as the machine has not been started again meanwhile; --fresh, or
make hours FRESH=1, gives up what is under way.

example: make hours HOURS=12 SEED=7
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hours.plan import EVERY_S
from hours.worker import LAST, ROOT, Hours, started
from imud.progress import Progress
from system.virtual import BOARDS

FOLDER = ROOT / "build" / "hours"
LOOK_S = 0.5
UNDONE = 75  # EX_TEMPFAIL of sysexits.h: to be gone on with

COLUMNS = (
    ("hours", "hours"),
    ("wraps", "wraps"),
    ("poses", "poses"),
    ("compared", "compared"),
    ("differed", "differ"),
    ("faults_told", "faults told"),
    ("stack_free", "stack free"),
    ("silent_s", "silent s"),
    ("judge_kb", "judge kB"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m hours",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("boards", nargs="*", help="nano, f405 (default: both)")
    parser.add_argument("--hours", type=float, default=12.0, help="(default: 12)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--minutes", type=float, help="stop after this many, to continue"
    )
    parser.add_argument(
        "--every",
        type=float,
        default=EVERY_S,
        metavar="S",
        help=f"mean time between two faults or commands (default: {EVERY_S:g})",
    )
    parser.add_argument(
        "--fresh", action="store_true", help="abandon a run in progress"
    )
    parser.add_argument("--folder", type=Path, default=FOLDER, help=argparse.SUPPRESS)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    names = options.boards or list(BOARDS)
    if unknown := [name for name in names if name not in BOARDS]:
        parser.error(f"there is no board {unknown[0]}; there are {', '.join(BOARDS)}")
    if not 0 < options.hours <= 1000 or options.every < 1:
        parser.error("--hours is above 0 and at most 1000, --every at least 1")
    if options.worker:
        folder = options.folder / names[0]
        Hours(names[0], folder, options.seed, options.hours * 3600).run(options.every)
        return 0
    states = _watch([_begin(name, options) for name in names], options.minutes)
    return _tell(options.folder, states)


def _begin(name: str, options: argparse.Namespace) -> Path:
    """Continues with the board's run that is under way, or begins one."""
    folder: Path = options.folder / name
    folder.mkdir(parents=True, exist_ok=True)
    state = _state(folder)
    if state and not state["end"]:
        at = f"at {state['device_s'] / 3600:.2f} of {state['seconds'] / 3600:g} h"
        if not _is_alive(state):
            sys.stderr.write(f"{name}: the run {at} is lost; starting a new one\n")
        elif options.fresh:
            os.killpg(state["pid"], signal.SIGKILL)
            sys.stderr.write(f"{name}: the run {at} is abandoned\n")
        else:
            os.killpg(state["pid"], signal.SIGCONT)
            sys.stderr.write(f"{name}: continues {at}, seed {state['seed']}\n")
            return folder
    for name_before in ("state.json", LAST):
        (folder / name_before).unlink(missing_ok=True)
    words = ["--worker", name, "--folder", options.folder, "--seed", options.seed]
    words += ["--hours", options.hours, "--every", options.every]
    with (folder / "worker.txt").open("w") as said:
        # In a group of its own, which stops and continues as one.
        subprocess.Popen(
            [sys.executable, "-m", "hours", *map(str, words)],
            cwd=ROOT / "tests",
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
            start_new_session=True,
        )
    while not _state(folder):
        if (folder / "worker.txt").stat().st_size:
            sys.exit(f"{name} does not start: see {folder / 'worker.txt'}")
        time.sleep(LOOK_S)
    return folder


def _watch(folders: Sequence[Path], minutes: float | None) -> list[dict[str, Any]]:
    """Until all are over or time is up; then their states."""
    end_s = time.monotonic() + 60 * minutes if minutes else float("inf")
    states = [_state(folder) for folder in folders]
    progress = Progress("hours", sum(state["seconds"] for state in states))
    try:
        while time.monotonic() < end_s and any(map(_is_running, states)):  # MINUTES
            time.sleep(LOOK_S)
            states = [_state(folder) for folder in folders]
            progress.update(sum(state["device_s"] for state in states))
    except KeyboardInterrupt:
        pass
    progress.end()
    for state in filter(_is_running, states):
        os.killpg(state["pid"], signal.SIGSTOP)
    return [_state(folder) for folder in folders]


def _state(folder: Path) -> dict[str, Any]:
    try:
        state: dict[str, Any] = json.loads((folder / "state.json").read_text())
    except FileNotFoundError:
        return {}
    return state


def _is_alive(state: dict[str, Any]) -> bool:
    return started(state["pid"]) == state["started"]


def _is_running(state: dict[str, Any]) -> bool:
    return not state["end"] and _is_alive(state)


def _tell(base: Path, states: Sequence[dict[str, Any]]) -> int:
    """A table for each board; 0 where all is well, 1 where something is wrong."""
    code = 0
    for state in states:
        name, hours = state["board"], state["device_s"] / 3600
        folder = base / name
        out = [
            f"{name}, seed {state['seed']}: {hours:.2f} of "
            f"{state['seconds'] / 3600:g} h, {state.get('faults', 0)} faults, "
            f"{state.get('commands', 0)} commands"
        ]
        out.append("  ".join(f"{title:>11}" for _, title in COLUMNS))
        for part in state["parts"]:
            out.append("  ".join(f"{part[key]!s:>11}" for key, _ in COLUMNS))
        if state["end"]:
            out.append(", ".join(f"{k} {v}" for k, v in state["end"].items()))
        out += state["problems"]
        if state["problems"]:
            code = 1
            if (last := folder / LAST).exists():
                out.append(f"messages up to the first of them: imud decode {last}")
        elif not state["end"]:
            is_there = _is_alive(state)
            out.append(
                "stopped there; the next call continues"
                if is_there
                else f"it ended too early: see {folder}/worker.txt and emulator.txt"
            )
            code = code or (UNDONE if is_there else 1)
        sys.stdout.write("\n".join(out) + "\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
