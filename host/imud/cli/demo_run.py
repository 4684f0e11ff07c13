# SPDX-License-Identifier: MIT
"""`imud demo` at work: virtual probes run the images that are flashed, the daemon reads
their serial ports, and a subscriber shows poses as they come over Zenoh.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from imud import checkout
from imud.client import Client
from imud.config.settings import state_home
from imud.defaults import PAGE, PORT
from imud.errors import ImudError
from imud.probes.ledger import totals

IMUD = (sys.executable, "-P", "-m", "imud")

# The pose rate of a probe at its defaults.
RATE_HZ = 100.0
RATE_TOLERANCE_HZ = 0.5

# Arrival of all poses may take longer than their recording by this share.
DELAY_SHARE = 0.05

# Commands to try next, shown after a successful run.
NEXT = (
    ("imud demo --board both", "both boards at once"),
    ("imud sim nano --stream", "a virtual probe to keep"),
    ("imud run", "the daemon, in another terminal"),
    ("imud view", "open the page, or imud monitor in a third terminal"),
    ("imud flash --board nano", "the same firmware into a real board"),
)

START_S = 15.0  # limit for the serial port and the daemon to come up
FIRST_POSE_S = 20.0  # the probe calibrates its gyroscope first
STOP_S = 5.0


class DemoError(ImudError):
    """The chain does not run; the message says why and what to do."""


class PoseTally:
    """Counts one probe's poses as they arrive, and by their device times those that are
    missing.
    """

    def __init__(self) -> None:
        self.poses = 0
        self.missing = 0
        self._arrived_s = (0.0, 0.0)  # of the first pose and the last
        self._taken_us = (0, 0)

    def take(self, payload: bytes) -> None:
        """Counts a pose as published, and how many are missing before it, by device
        times.
        """
        now_s = time.monotonic()
        time_us = int(json.loads(payload)["t_device_us"])
        if self.poses == 0:
            self._arrived_s, self._taken_us = (now_s, now_s), (time_us, time_us)
        steps = round((time_us - self._taken_us[1]) * 1e-6 * RATE_HZ)
        self.missing += max(0, steps - 1)
        self._arrived_s = self._arrived_s[0], now_s
        self._taken_us = self._taken_us[0], time_us
        self.poses += 1

    @property
    def seconds(self) -> float:
        """Device time from the first pose to the last. Arrival times span less: a new
        subscriber gets the first poses together, once its route is set up.
        """
        return (self._taken_us[1] - self._taken_us[0]) * 1e-6

    @property
    def rate_hz(self) -> float:
        return (self.poses - 1) / self.seconds if self.seconds > 0 else 0.0

    @property
    def delay_share(self) -> float:
        """Arrival time of all poses over the device time that they span, minus 1."""
        arriving_s = self._arrived_s[1] - self._arrived_s[0]
        return arriving_s / self.seconds - 1.0 if self.seconds > 0 else 0.0


def room() -> Path:
    """Where the serial ports, the output of each process and the log are."""
    if checkout.is_checkout():
        return checkout.ROOT / "build" / "demo"
    return Path(state_home()).expanduser() / "imud" / "demo"


def interrupted(_number: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def run(boards: Sequence[str], seconds: float | None, wanted: int | None) -> int:
    """Runs it until its time is up or Ctrl-C; returns the exit code."""
    signal.signal(signal.SIGTERM, interrupted)
    room().mkdir(parents=True, exist_ok=True)
    port = free_port(PORT, wanted)
    page = f"127.0.0.1:{free_port(int(PAGE.rpartition(':')[2]))}"
    endpoint = f"tcp/127.0.0.1:{port}"
    begun_s = time.time()
    with ExitStack() as stack:
        probes = {board: stack.enter_context(virtual(board)) for board in boards}
        for board, probe in probes.items():
            serial = serial_of(board)
            wait_for(serial.exists, START_S, probe, f"no serial port at {serial}")
        daemon = stack.enter_context(
            child(
                *("imud run", "daemon", "run", *map(str, map(serial_of, boards))),
                *("--log", str(room()), "--listen", endpoint, "--page", page),
            )
        )
        wait_for(lambda: answers(port), START_S, daemon, f"no daemon at {endpoint}")
        client = stack.enter_context(Client(endpoint))
        tallies: defaultdict[str, PoseTally] = defaultdict(PoseTally)

        def take(probe: str, payload: bytes) -> None:
            tallies[probe].take(payload)

        stack.callback(client.subscribe("pose", None, take))
        for board in boards:
            sys.stdout.write(
                f"virtual {board} -> {os.path.relpath(serial_of(board))} -> imud -> "
                f"Zenoh {endpoint} -> imud listen\n"
            )
        sys.stdout.write(f"the page is at http://{page}: open it in a browser\n")
        are = "the probes lie" if len(boards) > 1 else "the probe lies"
        sys.stdout.write(f"{are} still for a moment, for the gyroscope's bias\n")
        sys.stdout.write(
            "not calibrated: the heading appears once the probe has turned\n"
        )
        sys.stdout.flush()
        wait_for(
            lambda: len(tallies) == len(boards), FIRST_POSE_S, daemon, "no pose arrived"
        )
        listened = listen(endpoint, seconds)
        statuses = client.statuses()
        children = (*probes.values(), daemon)
        ended = [process.name for process in children if not process.is_alive()]
        logs = sorted(p for p in room().glob("*.mcap") if p.stat().st_mtime >= begun_s)
    faults = [f"{name} ended unexpectedly; see {room()}" for name in ended]
    faults += [] if listened == 0 else [f"imud listen ended with {listened}"]
    heard = {str(status["hello"]["board"]): status for status in statuses}
    if sorted(heard) != sorted(boards) or len(statuses) != len(boards):
        faults.append(f"{len(statuses)} probes have a status, not {len(boards)}")
    for board, status in heard.items():
        tally = tallies[str(status["probe"])]
        faults += [f"{board}: {fault}" for fault in judge(tally, status)]
    judged = {board: tallies[str(heard[board]["probe"])] for board in heard}
    return report(judged, logs, faults)


def serial_of(board: str) -> Path:
    return room() / board


@contextmanager
def virtual(board: str) -> Iterator[Child]:
    """Run a virtual probe that streams from its start."""
    serial = serial_of(board)
    serial.unlink(missing_ok=True)  # left behind by a run that was killed
    words = ("sim", board, "--stream", "--link", str(serial))
    with child(f"virtual {board}", f"sim-{board}", *words) as started:
        yield started


def free_port(usual: int, wanted: int | None = None) -> int:
    """The wanted port; without one the usual port, or any free one if it is taken."""
    for port in (wanted or usual, 0):
        with socket.socket() as probe:
            # As the daemon does, so that connections left from a past run do no harm.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                if wanted is not None:
                    raise DemoError(
                        f"port {wanted} of 127.0.0.1 is in use, likely by another "
                        "imud or demo; stop that one, or choose another port"
                    ) from error
                sys.stdout.write(f"port {usual} is in use, likely by another imud\n")
            else:
                return int(probe.getsockname()[1])
    raise DemoError("the system has no free port on 127.0.0.1")


def answers(port: int) -> bool:
    with suppress(OSError):
        socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        return True
    return False


class Child:
    """A process of the chain; its output goes to a file."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], log: Path) -> None:
        self.name = name
        self.log = log
        self._process = process

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def last_words(self) -> str:
        lines = self.log.read_text(errors="replace").splitlines()
        return "\n  ".join(["", *lines[-8:]])

    def end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@contextmanager
def child(name: str, log_name: str, *arguments: str) -> Iterator[Child]:
    """Runs `imud` with these arguments in the demo's room, its output in LOG_NAME.log;
    ends it when the context is left.
    """
    log = room() / f"{log_name}.log"
    with log.open("wb") as file:
        # In its own session: Ctrl-C reaches the demo alone, which ends all in order.
        process = subprocess.Popen(
            [*IMUD, *arguments],
            cwd=room(),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        started = Child(name, process, log)
        try:
            yield started
        finally:
            started.end()


def wait_for(
    is_there: Callable[[], bool], seconds: float, needed: Child, complaint: str
) -> None:
    """Waits until `is_there` is true; DemoError with `complaint` after so many seconds,
    or once the process that is needed for it has ended.
    """
    until_s = time.monotonic() + seconds
    while not is_there():
        if not needed.is_alive():
            raise DemoError(f"{needed.name} ended unexpectedly:{needed.last_words()}")
        if time.monotonic() > until_s:
            raise DemoError(f"{complaint} in {seconds:.0f} s;{needed.last_words()}")
        time.sleep(0.05)


def listen(endpoint: str, seconds: float | None) -> int:
    """Show what a subscriber sees, until its time is up or Ctrl-C."""
    limit = () if seconds is None else ("--seconds", str(seconds))
    listener = subprocess.Popen([*IMUD, "listen", "--connect", endpoint, *limit])
    try:
        return listener.wait()
    except KeyboardInterrupt:
        listener.send_signal(
            signal.SIGINT
        )  # a terminal sent it to both, `kill` to us alone
        with suppress(subprocess.TimeoutExpired):  # started with & it ignores SIGINT
            return listener.wait(STOP_S)
        return 0
    finally:
        listener.kill()
        listener.wait()


def judge(tally: PoseTally, status: dict[str, Any]) -> list[str]:
    """List what is wrong with one probe's poses and ledger."""
    faults = []
    if abs(tally.rate_hz - RATE_HZ) > RATE_TOLERANCE_HZ:
        faults.append(f"{tally.rate_hz:.1f} poses per second, not {RATE_HZ:.0f}")
    if tally.delay_share > DELAY_SHARE:
        faults.append(
            f"poses came {tally.delay_share:.0%} slower than they were sampled"
        )
    if tally.missing:
        faults.append(f"{tally.missing} poses did not arrive")
    ledger = status["ledger"]
    counts = {
        "lost": totals(ledger).lost,
        "corrupt": ledger["corrupt"],
        "skewed": sum(ledger["skewed"].values()),
        "dropped": sum(ledger["dropped"].values()),
    }
    return faults + [f"{count} {what}" for what, count in counts.items() if count]


def report(
    tallies: Mapping[str, PoseTally], logs: Sequence[Path], faults: Sequence[str]
) -> int:
    """Prints the verdict, what arrived of each board, and what to try next. Returns the
    exit code: 1 with faults.
    """
    is_plain = not sys.stdout.isatty() or "NO_COLOR" in os.environ
    red, green, end = ("", "", "") if is_plain else ("\x1b[31m", "\x1b[32m", "\x1b[0m")
    verdict = f"{red}failed{end}" if faults else f"{green}all well{end}"
    sys.stdout.write(f"\n{verdict}\n")
    for board, tally in tallies.items():
        sys.stdout.write(
            f"  {board}: {tally.poses} poses in {tally.seconds:.1f} s, "
            f"{tally.rate_hz:.1f} Hz, {tally.missing} missing\n"
        )
    for fault in faults:
        sys.stdout.write(f"  {fault}\n")
    for log in logs:
        size_kb = log.stat().st_size / 1000
        sys.stdout.write(f"  log: {os.path.relpath(log)}, {size_kb:.0f} kB\n")
    if faults:
        return 1
    further = [
        (f"imud decode {os.path.relpath(log)}", "print each message")
        for log in logs[:1]
    ]
    further += NEXT
    imud = os.path.relpath(sys.argv[0]) if checkout.is_checkout() else "imud"
    further = [(f"{imud}{each.removeprefix('imud')}", does) for each, does in further]
    width = max(len(command) for command, _ in further)
    sys.stdout.write("\ntry next\n")
    for command, does in further:
        sys.stdout.write(f"  {command:<{width}}  {does}\n")
    return 0
