# SPDX-License-Identifier: MIT
"""One board's hours: its emulator, fed and judged, and a file that says how far it is.

The emulator writes into a pipe with a name: it runs only as fast as it is judged, so
that hours leave no file.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from hours.judge import Judge
from hours.plan import EVERY_S, plan_of
from imud.virtual import motion, sensors
from imud.virtual.boards import BOARDS as EMULATED
from system.virtual import BOARDS

ROOT = Path(__file__).resolve().parents[2]

PART_S = 3600.0  # of device time
TELL_S = 1.0  # between two states
BLOCK = 1 << 16
# The latest blocks, which are kept where something is wrong; a pipe gives up to 64 kB.
KEPT = 64
LAST = "last.bin"  # `imud decode` reads it


class Hours:
    """A run and its state, which is a file after each second and at the end."""

    def __init__(self, name: str, folder: Path, seed: int, seconds: float) -> None:
        self.folder, self.seconds = folder, seconds
        self.part_s = min(PART_S, seconds / 4)
        self._judge = Judge()
        self._told_s = 0.0
        self._last: deque[bytes] = deque(maxlen=KEPT)
        self.state: dict[str, Any] = {
            "board": name,
            "seed": seed,
            "seconds": seconds,
            "pid": os.getpid(),
            "started": started(os.getpid()),
            "device_s": 0.0,
            "parts": [],
            "problems": [],
            "end": None,
        }

    def run(self, every_s: float = EVERY_S) -> None:
        pipe = self.folder / "uart"
        pipe.unlink(missing_ok=True)
        os.mkfifo(pipe)
        summary = self.folder / "summary.json"
        with (
            (self.folder / "emulator.txt").open("w") as said,
            subprocess.Popen(
                self._command(pipe, summary, every_s),
                stdin=subprocess.PIPE,
                stderr=said,
            ) as emulator,
        ):
            feeder = threading.Thread(
                target=_feed, args=(emulator.stdin, self.state["seed"]), daemon=True
            )
            feeder.start()
            with pipe.open("rb", buffering=0) as uart:
                while data := uart.read(BLOCK):
                    self.take(data)
            code = emulator.wait()
            feeder.join()
        pipe.unlink()
        self._close(code, json.loads(summary.read_text()))

    def _command(self, pipe: Path, summary: Path, every_s: float) -> Sequence[str]:
        name = self.state["board"]
        plan = plan_of(BOARDS[name], self.state["seed"], self.seconds, every_s)
        faults = self.folder / "faults.json"
        faults.write_text(json.dumps(plan.faults))
        self.state["faults"] = len(plan.faults)
        self.state["commands"] = plan.commands
        words: list[Any] = [ROOT / EMULATED[name].simulator]
        words += ["--image", ROOT / EMULATED[name].image, "--motion", "-", "--fast"]
        words += ["--record", pipe, "--summary", summary, "--faults", faults]
        words += ["--seconds", self.seconds, *plan.options]
        return [str(word) for word in words]

    def take(self, data: bytes) -> None:
        judge, state = self._judge, self.state
        was_good = judge.problem_count == 0
        self._last.append(data)
        judge.take(data)
        if was_good and judge.problem_count > 0:
            (self.folder / LAST).write_bytes(b"".join(self._last))
        state["device_s"] = judge.device_us * 1e-6
        if state["device_s"] >= (len(state["parts"]) + 1) * self.part_s:
            self._part()
        if time.monotonic() - self._told_s >= TELL_S:  # for who looks on
            self.tell()

    def _part(self) -> None:
        # In kB: the worker's own, which grows where something is kept for ever.
        found = self._judge.part() | {"judge_kb": resident_kb(os.getpid())}
        self.state["parts"].append(found)

    def _close(self, code: int, summary: dict[str, Any]) -> None:
        judge, state = self._judge, self.state
        counts = judge.end(summary)
        if code != 0:
            judge.problems.append(f"the emulator ended with {code}")
        if len(state["parts"]) * self.part_s < self.seconds:
            self._part()
        state["device_s"] = self.seconds
        state["end"] = counts
        self.tell()

    def tell(self) -> None:
        """Writes the state; a reader finds the old one or the new one, whole."""
        self._told_s = time.monotonic()
        self.state["problems"] = self._judge.problems
        file = self.folder / "state.json"
        new = file.with_suffix(".new")
        new.write_text(json.dumps(self.state, indent=1))
        new.replace(file)


def _feed(file: IO[bytes] | None, seed: int) -> None:
    # The emulator ends before the motion, which never does.
    if file is not None:
        with contextlib.suppress(BrokenPipeError), file:
            motion.write_stream(file, sensors.stream(seed))


def started(pid: int) -> int | None:
    """When that process began, in ticks; None: there is none. Numbers are used again,
    so this tells one process from the next.
    """
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return None
    return int(text.rpartition(")")[2].split()[19])  # proc(5), field 22


def resident_kb(pid: int) -> int:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    return 0
