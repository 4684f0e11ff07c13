# SPDX-License-Identifier: MIT
"""`imud sim`: runs a virtual probe, the real firmware image in an emulator.

The emulator is a separate program (sim/nano, sim/f405, sim/pico). This module finds it
and the image, feeds it a motion through a pipe, and repeats its output.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING

from imud.errors import FileError
from imud.machine import system
from imud.progress import Progress
from imud.virtual.boards import BOARDS, NANO, VirtualBoard

if TYPE_CHECKING:
    from imud.virtual.motion import Motion


# Device times of the button press and the commands of --stream, --raw and --rate. The
# button is down for several times the firmware's debounce of 50 ms, which runs slower
# during the sensor's set-up, and up again long before the first sample.
PRESS_US = (200_000, 500_000)
FIRST_COMMAND_US = 600_000
NEXT_COMMAND_US = 20_000

# Options of the clock and the wire, for runs in real time.
WIRE = ("clock-ppm", "clock-drift", "batch-ms", "burst-ms")

FEED_RECORDS = 1024  # a write into the pipe: 36 kB


def default_link(board: VirtualBoard) -> Path:
    """The default path of the serial port, in a folder of the user."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(folder) / f"imud-{board.name}"


def running_links() -> Iterator[Path]:
    """The serial ports of this user's virtual probes that run, at their default paths.

    A link that leads nowhere is not asked for its lock: a probe that starts has it.
    """
    for link in map(default_link, BOARDS.values()):
        # Windows has neither such ports nor such numbers of users.
        with contextlib.suppress(OSError, AttributeError):
            if link.lstat().st_uid == os.getuid() and link.exists():
                with link.with_name(f"{link.name}.lock").open() as lock:
                    if not system.try_lock(lock):
                        yield link


def offered(page: str | None) -> tuple[str, ...]:
    """The module and arguments of a virtual Nano as bought; empty where it can't run.
    `page`: what a hand does that it asks for; None: the hand does as it likes.
    """
    try:
        NANO.find_simulator()
        NANO.find_image()
    except FileError:
        return ()
    hand = ("--hand", "follow", "--page", page) if page else ()
    return ("imud", "sim", NANO.name, "--stream", "--module", "shop", *hand)


@contextlib.contextmanager
def held(link: Path) -> Iterator[None]:
    """Keeps the path of a serial port for this virtual probe; FileError if another one
    has it. That one would lose its port, and both would have one id.
    """
    path = link.with_name(f"{link.name}.lock")
    try:
        file = path.open("w")
    except OSError as error:
        raise FileError(f"can't make {link}: {error.strerror}") from error
    with file:
        if not system.try_lock(file):
            raise FileError(
                f"{link} is the port of another virtual probe; pass --link {link}-2 "
                "--seed 2 for a further one with its own id"
            )
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def commands_us(
    board: VirtualBoard, *, wants_raw: bool, rate_hz: int | None
) -> Iterator[tuple[int, bytes]]:
    """The frames that set a probe up, each with its device time in us."""
    from imud._core import encode_frame
    from imud.wire import messages, schema

    orders: list[tuple[str, tuple[int, int]]] = []
    if wants_raw:
        streams = schema.StreamFlags.POSE | schema.StreamFlags.RAW
        orders.append(("rate", (1, board.sample_rate_hz)))
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
    """The emulator's command line; it reads the motion from its standard input."""
    board: VirtualBoard = args.board
    simulator = board.find_simulator(args.simulator)
    image = board.find_image(args.image)
    words: list[str | Path] = [simulator, "--image", image]
    words += ["--motion", "-", "--seed", str(args.seed)]
    words += ["--record", args.record] if args.record else ["--pty", link]
    for name in ("seconds", *board.files, "battery", "wire", "ready", *WIRE):
        value = getattr(args, name.replace("-", "_"), None)
        if value is not None:
            words += [f"--{name}", str(value)]
    if board.sensor:
        words += ["--sensor", board.sensor]
    if args.fast:
        words.append("--fast")
    for span_us in presses_of(args):
        words += ["--press", ":".join(map(str, span_us))]
    for at_us, frame in commands_us(board, wants_raw=args.raw, rate_hz=args.rate):
        words += ["--send", f"{at_us}:{frame.hex()}"]
    return [str(word) for word in words]


def presses_of(args: argparse.Namespace) -> Iterator[tuple[int, int]]:
    """When the button is down: to start the stream, and by a hand that measures."""
    if args.stream:
        yield PRESS_US
    if args.hand:
        from imud.virtual import checking, measuring, sensors

        if args.hand == checking.NAME:
            yield from checking.presses_us()
        if args.hand in measuring.PLANS and args.hand != measuring.WITHOUT_BUTTON:
            rate_hz = sensors.HAND_RATE_HZ
            yield from measuring.presses_us(args.hand, args.seed, rate_hz)


def run(args: argparse.Namespace) -> int:
    """Runs the virtual probe until its time is up or a signal ends it.

    Returns its exit status, 128 + N after signal N.
    """
    link = args.link or default_link(args.board)
    words = command_line(args, link)
    rate_hz, pieces, seconds = motion_of(args)
    with (
        contextlib.nullcontext() if args.record else held(link),
        subprocess.Popen(
            words, stdin=subprocess.PIPE, stderr=subprocess.PIPE
        ) as emulator,
    ):

        def end(_number: int, _frame: FrameType | None) -> None:
            # The emulator finishes its step and prints its summary.
            emulator.terminate()

        before = {
            number: signal.signal(number, end)
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            is_measured = bool(args.record and seconds)
            progress = Progress(f"virtual {args.board.title}", seconds or 0.0)
            watched = _watched(pieces, rate_hz, progress) if is_measured else pieces
            if _follows(args.hand) and emulator.stdin is not None:
                # New moves must not queue behind old ones.
                system.shorten_pipe(emulator.stdin)
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
    return status if status >= 0 else 128 - status


def _follows(hand: str | None) -> bool:
    """Whether a hand reacts to the page or the guide."""
    if hand is None:
        return False
    from imud.virtual import following

    return hand in following.NAMES


def motion_of(
    args: argparse.Namespace,
) -> tuple[float, Iterable[Motion], float | None]:
    """The motion: its rate in Hz, its pieces, and how many seconds are wanted.
    `args.motion` is a Motion that moves it, or None: a hand does.
    """
    from imud.virtual import sensors

    if args.module is not None or args.hand is not None:
        return _with_module(args)
    if args.motion is None and args.save_motion is None:
        return sensors.HAND_RATE_HZ, sensors.stream(args.seed), args.seconds
    if args.motion is not None:
        recording: Motion = args.motion
    else:
        recording = sensors.generate(args.seconds, args.seed)
        try:
            recording.save(args.save_motion)
        except OSError as error:
            raise FileError(
                f"can't write {args.save_motion}: {error.strerror}"
            ) from error
    starts = range(0, len(recording), FEED_RECORDS)
    pieces = (recording[start : start + FEED_RECORDS] for start in starts)
    return recording.rate_hz, pieces, args.seconds or recording.seconds


def _with_module(
    args: argparse.Namespace,
) -> tuple[float, Iterable[Motion], float | None]:
    """The motion as a chosen module measures it, with that module's errors."""
    import numpy as np

    from imud.virtual import modules, sensors
    from imud.virtual.hands import pieces_of

    module = modules.named(args.module or modules.CALIBRATED, args.seed)
    rate_hz = sensors.HAND_RATE_HZ
    if args.hand is not None:
        found = pieces_of(
            *(args.hand, module, args.seed, rate_hz),
            page=args.page,
            port=args.link or default_link(args.board),
        )
        return rate_hz, found, args.seconds
    random = np.random.default_rng([args.seed, 2])
    if args.motion is None:
        exact = sensors.stream(args.seed, rate_hz, errors=sensors.NO_ERRORS)
        feel = module.sensor(rate_hz, random).feel
        return rate_hz, map(feel, exact), args.seconds
    recording: Motion = args.motion
    if recording.is_recorded:
        # Its own noise is in it.
        module = replace(module, noise=sensors.NO_ERRORS)
    felt = module.measures(recording, random)
    starts = range(0, len(felt), FEED_RECORDS)
    pieces = (felt[start : start + FEED_RECORDS] for start in starts)
    return felt.rate_hz, pieces, args.seconds or felt.seconds


def _watched(
    pieces: Iterable[Motion], rate_hz: float, progress: Progress
) -> Iterator[Motion]:
    """The same pieces. `progress` follows them, as the emulator takes them."""
    records = 0
    for piece in pieces:
        yield piece
        records += len(piece)
        progress.update(records / rate_hz)


def _feed(file: IO[bytes], pieces: Iterable[Motion]) -> None:
    from imud.virtual import motion

    # The emulator may end before the motion does.
    with contextlib.suppress(BrokenPipeError), file:
        motion.write_stream(file, pieces)


def _pass_on(lines: Iterable[bytes], progress: Progress) -> None:
    """Repeats the emulator's lines, and prints how to connect when it is ready."""
    for line in lines:
        text = line.decode(errors="replace").rstrip("\n")
        word, _, link = text.partition(" ")
        if word == "ready":
            text = f"ready {link} (imud run {link}; Ctrl-C ends it)"
        progress.say(text)
