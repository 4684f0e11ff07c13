# SPDX-License-Identifier: MIT
"""`imud sim`: a virtual probe, the very image that a user flashes in an emulator.

The emulator is a program of its own (sim/nano.c). This finds it and the image, feeds
it a motion through a pipe, and passes on what it says.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING

from imud.errors import FileError
from imud.progress import Progress

if TYPE_CHECKING:
    from imud.motion import Motion

# Where the builds leave them, from the project's folder.
SIMULATOR = Path("build/sim/nano")
IMAGE = Path(".pio/build/nano/firmware.elf")

# Device time of what is done for the user. The button is down for several times the
# firmware's debounce of 50 ms, which runs slower while the sensor is set up, and is up
# again long before the first sample; commands follow, each in good time after the last.
PRESS_US = (200_000, 500_000)
FIRST_COMMAND_US = 600_000
NEXT_COMMAND_US = 20_000

SAMPLE_RATE_HZ = 200  # the firmware samples, and can send, so many a second

FEED_RECORDS = 1024  # a write into the pipe: 36 kB


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers `sim` and its boards with the command line."""
    sim = commands.add_parser(
        "sim",
        help="run a virtual probe: the real firmware image in an emulator",
        description="Runs a virtual probe: the real firmware image in an emulator.",
        epilog="example: imud sim nano --stream, and then: imud run /tmp/imud-nano",
    )
    boards = sim.add_subparsers(metavar="BOARD", required=True)
    nano = boards.add_parser(
        "nano",
        help="an Arduino Nano with an MPU-9250",
        description="An Arduino Nano with an MPU-9250. Its UART is a pty, in real "
        "time, or goes into a file. Without --motion a hand moves it: strokes, turns, "
        "rests.",
        epilog="example: imud sim nano --motion turn.npz --stream --raw --fast "
        "--record turn.bin --summary turn.json",
    )
    nano.add_argument(
        "--motion", metavar="FILE", type=Path, help="a recording to feel, .npz or .csv"
    )
    output = nano.add_mutually_exclusive_group()
    output.add_argument(
        "--link",
        metavar="PATH",
        type=Path,
        default=None,
        help=f"where its serial port appears (default: {default_link()})",
    )
    output.add_argument(
        "--record", metavar="FILE", type=Path, help="write its UART bytes to a file"
    )
    nano.add_argument(
        "--seconds",
        metavar="N",
        type=_positive,
        help="stop after N seconds of its time (default: with the recording, or never)",
    )
    nano.add_argument("--fast", action="store_true", help="as fast as it can")
    nano.add_argument(
        "--stream",
        action="store_true",
        help="stream at once, as if the button had been pressed",
    )
    nano.add_argument(
        "--raw", action="store_true", help="send the raw samples, too, all 200 a second"
    )
    nano.add_argument(
        "--rate", metavar="HZ", type=_rate, help="poses a second (default: 100)"
    )
    nano.add_argument(
        "--seed",
        metavar="N",
        type=_seed,
        default=1,
        help="of hand and noise (default: %(default)s)",
    )
    nano.add_argument(
        "--save-motion",
        metavar="FILE",
        type=Path,
        help="keep what the hand did, with the truth, as .npz; needs --seconds",
    )
    nano.add_argument(
        "--faults", metavar="FILE", type=Path, help="what is to break, and when"
    )
    nano.add_argument(
        "--eeprom", metavar="FILE", type=Path, help="memory kept from run to run"
    )
    nano.add_argument(
        "--summary", metavar="FILE", type=Path, help="write the figures as JSON"
    )
    nano.add_argument(
        "--profile",
        metavar="FILE",
        type=Path,
        help="write whose each cycle is, by function and part, as JSON",
    )
    nano.add_argument(
        "--parts",
        metavar="FILE",
        type=Path,
        help="the parts of the profile: lines START END PART, addresses of flash",
    )
    nano.add_argument(
        "--image", metavar="ELF", type=Path, help="firmware (default: as built here)"
    )
    nano.add_argument(
        "--simulator",
        metavar="PATH",
        type=Path,
        help="emulator (default: as built here)",
    )
    nano.set_defaults(run=run, parser=nano)


def _positive(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return seconds


def _rate(text: str) -> int:
    rate_hz = int(text)
    if not 1 <= rate_hz <= SAMPLE_RATE_HZ:
        raise argparse.ArgumentTypeError(f"{text} is not in 1..{SAMPLE_RATE_HZ}")
    return rate_hz


def _seed(text: str) -> int:
    seed = int(text)
    if not 0 <= seed < 2**32:
        raise argparse.ArgumentTypeError(f"{text} is not in 0..{2**32 - 1}")
    return seed


def default_link() -> Path:
    """Where the serial port appears unless told otherwise: a folder of the user's."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(folder) / "imud-nano"


def find(given: Path | None, variable: str, built: Path) -> Path:
    """What is named here or in the environment, or what a build left nearby."""
    named = given or (Path(text) if (text := os.environ.get(variable)) else None)
    if named is not None:
        if named.is_file():
            return named
        raise FileError(f"{named} is not there; run `make firmware sim`")
    here = Path.cwd()
    # A virtual environment lies in the project's folder.
    for folder in (here, *here.parents, Path(sys.prefix).parent):
        if (folder / built).is_file():
            return folder / built
    raise FileError(f"{built} is not built yet; run `make firmware sim`")


def commands_us(*, wants_raw: bool, rate_hz: int | None) -> Iterator[tuple[int, bytes]]:
    """The frames that set a probe up, each with the device time it is sent at."""
    from imud import messages, schema
    from imud._core import encode_frame

    orders: list[tuple[str, tuple[int, int]]] = []
    if wants_raw:
        streams = schema.StreamFlags.POSE | schema.StreamFlags.RAW
        orders.append(("rate", (1, SAMPLE_RATE_HZ)))
        orders.append(("fields", (int(streams), 0)))
    if rate_hz is not None:
        orders.append(("rate", (0, rate_hz)))
    for index, (command, arguments) in enumerate(orders):
        # Tokens are not zero.
        order = {"command": command, "token": index + 1, "arguments": arguments}
        content = messages.encode("command", order, index, 0)
        at_us = FIRST_COMMAND_US + index * NEXT_COMMAND_US
        yield at_us, encode_frame(schema.SEED, content)


def command_line(args: argparse.Namespace, link: Path) -> list[str]:
    """The emulator's arguments; the motion comes through its standard input."""
    words: list[str | Path] = [find(args.simulator, "IMUD_SIM", SIMULATOR)]
    words += ["--image", find(args.image, "IMUD_IMAGE", IMAGE)]
    words += ["--motion", "-", "--seed", str(args.seed)]
    words += ["--record", args.record] if args.record else ["--pty", link]
    options: Mapping[str, Path | float | None] = {
        "--seconds": args.seconds,
        "--faults": args.faults,
        "--eeprom": args.eeprom,
        "--summary": args.summary,
        "--profile": args.profile,
        "--parts": args.parts,
    }
    for option, value in options.items():
        if value is not None:
            words += [option, str(value)]
    if args.fast:
        words.append("--fast")
    if args.stream:
        words += ["--press", ":".join(map(str, PRESS_US))]
    for at_us, frame in commands_us(wants_raw=args.raw, rate_hz=args.rate):
        words += ["--send", f"{at_us}:{frame.hex()}"]
    return [str(word) for word in words]


def run(args: argparse.Namespace) -> int:
    """Runs the virtual probe until its time is up or a signal ends it."""
    if args.save_motion and (args.motion or not args.seconds):
        args.parser.error("--save-motion keeps what a hand did in --seconds N")
    if args.record and not args.motion and not args.seconds:
        args.parser.error("--record needs --seconds N: the hand never stops")
    if args.parts and not args.profile:
        args.parser.error("--parts are those of a --profile")
    link = args.link or default_link()
    words = command_line(args, link)
    rate_hz, pieces, seconds = _motion(args)
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as emulator:

        def end(_number: int, _frame: FrameType | None) -> None:
            # It finishes what it does and says its summary.
            emulator.terminate()

        before = {
            number: signal.signal(number, end)
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            is_measured = bool(args.record and seconds)
            progress = Progress("virtual Nano", seconds or 0.0)
            watched = _watched(pieces, rate_hz, progress) if is_measured else pieces
            feeder = threading.Thread(
                target=_feed, args=(emulator.stdin, watched), daemon=True
            )
            feeder.start()
            _pass_on(emulator.stderr or (), progress)
            status = emulator.wait()
            feeder.join()
            progress.end()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
    # Killed by a signal: 128 and its number, as shells say it.
    return status if status >= 0 else 128 - status


def _motion(
    args: argparse.Namespace,
) -> tuple[float, Iterable[Motion], float | None]:
    """What to feel: its rate, its pieces, and for how long it is wanted."""
    from imud import motion

    if args.motion is None and args.save_motion is None:
        return motion.HAND_RATE_HZ, motion.stream(args.seed), args.seconds
    if args.motion is not None:
        recording = motion.load(args.motion)
    else:
        recording = motion.generate(args.seconds, args.seed)
        try:
            recording.save(args.save_motion)
        except OSError as error:
            raise FileError(
                f"can't write {args.save_motion}: {error.strerror}"
            ) from error
    starts = range(0, len(recording), FEED_RECORDS)
    pieces = (recording[start : start + FEED_RECORDS] for start in starts)
    return recording.rate_hz, pieces, args.seconds or recording.seconds


def _watched(
    pieces: Iterable[Motion], rate_hz: float, progress: Progress
) -> Iterator[Motion]:
    """The same pieces; each shows how far the emulator is, which takes them in turn."""
    records = 0
    for piece in pieces:
        yield piece
        records += len(piece)
        progress.update(records / rate_hz)


def _feed(file: IO[bytes], pieces: Iterable[Motion]) -> None:
    from imud import motion

    # The emulator may end before the motion does.
    with contextlib.suppress(BrokenPipeError), file:
        motion.write_stream(file, pieces)


def _pass_on(said: Iterable[bytes], progress: Progress) -> None:
    """Repeats what the emulator says, and how to connect once it can be."""
    for line in said:
        text = line.decode(errors="replace").rstrip("\n")
        word, _, link = text.partition(" ")
        if word == "ready":
            text = f"ready {link} (imud run {link}; Ctrl-C ends it)"
        progress.say(text)
