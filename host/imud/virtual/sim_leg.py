# SPDX-License-Identifier: MIT
"""`imud sim leg`: three virtual probes on a leg that stands, squats, raises its knee,
stands and walks, again and again.

The three emulators begin at the same moment: each waits for the head of its motion,
which they get together.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import signal
import subprocess
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING

from imud.errors import FileError
from imud.params.trusted import CALIBRATED
from imud.progress import Progress
from imud.virtual import memory, sim
from imud.virtual.boards import VirtualBoard
from imud.virtual.sim import FEED_RECORDS

if TYPE_CHECKING:
    from imud.virtual.leg import Leg
    from imud.virtual.motion import Motion

BODY, DAEMON = "leg.toml", "imud.toml"
RAW_HZ = 100
CLOCKS_PPM = {"thigh": 120, "shank": -80, "foot": 30}  # how fast each probe's clock is
START_S = 20.0  # an emulator has opened its port by then


@dataclass(frozen=True, slots=True)
class Worn:
    """A virtual probe of the leg: its files, and its id."""

    name: str
    link: Path
    eeprom: Path
    seed: int
    probe_id: str


def run(args: argparse.Namespace) -> int:
    """Runs the leg until its time is up or a signal ends it; returns an exit status.

    FileError if the folder can't be written or the emulators are not built.
    """
    from imud.virtual import leg

    board: VirtualBoard = args.board
    folder: Path = args.dir
    image = board.find_image(args.image)
    simulator = board.find_simulator(args.simulator)
    progress = Progress("the leg and its probes", 4)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        worn = []
        for index, name in enumerate(leg.SEGMENTS):
            eeprom = folder / f"{name}.eeprom"
            eeprom.unlink(missing_ok=True)
            seed = args.seed * 10 + index
            found = memory.memory_with(image, simulator, CALIBRATED, eeprom, seed)
            worn.append(Worn(name, folder / name, eeprom, seed, found))
            progress.advance()
        (folder / BODY).write_text(leg.CHAIN)
        (folder / DAEMON).write_text(configuration(worn))
    except OSError as error:
        raise FileError(f"can't write {error.filename}: {error.strerror}") from error
    made = leg.made(args.seed, leg.Manner(walk_s=args.walk))
    progress.advance()
    progress.end()
    words = {
        each.name: [
            *(str(simulator), "--image", str(image), "--motion", "-"),
            *("--pty", str(each.link), "--eeprom", str(each.eeprom)),
            *("--seed", str(each.seed), "--press", ":".join(map(str, sim.PRESS_US))),
            *("--clock-ppm", str(CLOCKS_PPM[each.name])),
            *(("--seconds", str(args.seconds)) if args.seconds else ()),
        ]
        for each in worn
    }
    progress.say(
        f"in other terminals: imud run --config {folder / DAEMON}, then imud body "
        f"{folder / BODY}"
    )
    progress.say(timetable(made))
    return _emulate(words, made.motions, progress)


def timetable(made: Leg) -> str:
    """The times of the leg's motions, s."""
    parts = [f"{name} from {start:.0f} s" for name, (start, _) in made.stages.items()]
    _, end_s = made.stages["end"]
    return f"it repeats every {end_s:.0f} s: {', '.join(parts)}; Ctrl-C ends it"


def configuration(worn: list[Worn]) -> str:
    """The daemon's file: the ports, the probes' names, samples for the foot's path."""
    ports = ", ".join(f'"{each.link.absolute()}"' for each in worn)
    lines = ["[ports]", "find = false", f"named = [{ports}]"]
    for each in worn:
        lines += ["", f"[probes.{each.probe_id}]", f'name = "{each.name}"']
        lines += ['streams = ["pose", "raw"]', f"raw_rate = {RAW_HZ}", "start = true"]
    return "\n".join(lines) + "\n"


def _emulate(
    words: Mapping[str, list[str]], motions: Mapping[str, Motion], progress: Progress
) -> int:
    """Runs the emulators together; the status of the first that fails, or 0."""
    with contextlib.ExitStack() as stack:
        emulators = {
            name: stack.enter_context(
                subprocess.Popen(line, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
            )
            for name, line in words.items()
        }

        def end(_number: int, _frame: FrameType | None) -> None:
            for each in emulators.values():
                each.terminate()

        for number in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, number, signal.signal(number, end))
        together = threading.Barrier(len(emulators))
        threads = [
            threading.Thread(target=work, args=arguments, daemon=True)
            for name, each in emulators.items()
            for work, arguments in (
                (_feed, (each.stdin, motions[name], together)),
                (_pass_on, (each.stderr, progress)),
            )
        ]
        for thread in threads:
            thread.start()
        statuses = [each.wait() for each in emulators.values()]
        for thread in threads:
            thread.join()
    return next((status for status in statuses if status > 0), 0)


def _feed(file: IO[bytes], exact: Motion, together: threading.Barrier) -> None:
    """The motion, over and over: the leg ends as it begins, standing."""
    from imud.virtual import motion

    together.wait()
    with contextlib.suppress(BrokenPipeError), file:
        motion.write_stream(file, again(exact))


def again(exact: Motion) -> Iterator[Motion]:
    """The pieces of a motion that ends as it begins, for ever."""
    for _ in itertools.count():
        for start in range(0, len(exact), FEED_RECORDS):
            yield exact[start : start + FEED_RECORDS]


def _pass_on(lines: IO[bytes], progress: Progress) -> None:
    for line in lines:
        progress.say(line.decode(errors="replace").rstrip("\n"))
