# SPDX-License-Identifier: MIT
"""What `imud monitor` draws, on a terminal and into a pipe."""

from __future__ import annotations

import os
import pty
import select
import signal
import struct
import sys
import termios
from collections.abc import Callable, Iterator
from fcntl import ioctl
from pathlib import Path

import pytest

from fakes import PATIENCE_S, DaemonProcess, Forked
from imud.cli.monitor import BLOCK, MonitorScreen, pipe_line
from imud.client import Missed, Pose, Status
from programs import ran
from speaking import speaking

pytestmark = pytest.mark.sampled(3)


def pose(name: str) -> Pose:
    return Pose(
        probe=name,
        seq=1,
        number=1,
        missing=0,
        t_device_us=0,
        age_us=1234,
        t_bound_us=560,
        q=(1.0, 0.0, 0.0, 0.0),
        position_m=None,
        normal=None,
        tilt_sigma_deg=0.37,
        heading_sigma_deg=1.25,
        flags=("at_rest",),
    )


def status(
    name: str = "p", *, adds_up: bool = True, state: str = "streaming"
) -> Status:
    return Status(
        probe=name,
        probe_id=name,
        state=state,
        port="/dev/ttyUSB0" if state != "gone" else None,
        t_ns=0,
        pose_rate_hz=100.0,
        quality={},
        ledger={
            **{"sent": 100, "lost": 2, "corrupt": 3},
            "earlier_boots": {"sent": 50, "lost": 1},
            "adds_up": adds_up,
            "differs": [] if adds_up else ["log"],
            "sinks": {
                "zenoh": {"taken": 9, "waiting": 0, "dropped": 0},
                "log": {"taken": 7, "waiting": 1, "dropped": 1},
            },
        },
        hello={"board": "nano"},
    )


def screen_of(count: int) -> MonitorScreen:
    screen = MonitorScreen("tcp/127.0.0.1:7447")
    for number in range(count):
        screen.add(status(f"p{number}"), 10.0)
        screen.add(pose(f"p{number}"), 10.0)
    return screen


@pytest.mark.parametrize("count", range(0, 40))
@pytest.mark.parametrize("height", [1, 2, 5, 24, 60])
def test_a_screen_is_never_taller_than_the_terminal(count: int, height: int) -> None:
    lines = screen_of(count).lines(10.0, height)
    assert len(lines) <= height
    if height == 24:
        is_large = 0 < count * BLOCK <= height - 2
        assert len(lines) == 2 + (count * BLOCK if is_large else min(count + 1, 22))
        assert max(len(line.plain) for line in lines) <= 80


def test_a_probe_says_where_it_points_and_what_was_lost() -> None:
    screen = screen_of(1)
    screen.probes["p0"].missed = Missed(network=4, queue=1)
    text = "\n".join(line.plain for line in screen.lines(10.0, 24))
    assert "1 Hz  1.23 ±0.56 ms" in text
    assert "yaw       0.00° ±1.25" in text
    assert "lost 3 of 150, 3 corrupt, 5 in transit" in text
    assert "adds up; zenoh 9, log 7 (1 waiting, 1 dropped)" in text


def test_a_ledger_that_does_not_add_up_says_where() -> None:
    screen = MonitorScreen("e")
    screen.add(status(adds_up=False), 1.0)
    assert "differs: log" in screen.lines(1.0, 24)[-2].plain


def test_one_that_is_gone_stays_and_its_pose_does_not() -> None:
    screen = screen_of(1)
    screen.add(status("p0", state="gone"), 20.0)
    text = "\n".join(line.plain for line in screen.lines(20.0, 24))
    assert "gone" in text
    assert "yaw" not in text


def test_a_daemon_that_is_silent_or_gone_is_told() -> None:
    screen = screen_of(1)
    assert "unheard" in screen.lines(14.0, 24)[1].plain
    screen.is_connected = False
    assert "waiting for it" in screen.lines(14.0, 24)[0].plain


def test_a_pipe_gets_no_controls() -> None:
    line = pipe_line(screen_of(1).probes["p0"], 10.0)
    assert line.isprintable()
    assert line.startswith("p0 ")


# As a program, with a daemon.


class Terminal:
    """A terminal of 80x24 with a command of imud in it."""

    def __init__(self, *words: str) -> None:
        self._master, slave = pty.openpty()
        self.resize(80, 24)
        self._before = termios.tcgetattr(slave)
        self._slave = slave
        self.text = ""
        self.process = Forked(
            *("-m", "imud", *words),
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=os.environ | {"TERM": "xterm-256color"},
        )

    def resize(self, columns: int, rows: int) -> None:
        ioctl(self._master, termios.TIOCSWINSZ, struct.pack("4H", rows, columns, 0, 0))

    def press(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def until(self, is_so: Callable[[str], bool]) -> None:
        while not is_so(self.text):
            if select.select([self._master], [], [], 0.1)[0]:
                self.text += os.read(self._master, 65536).decode(errors="replace")

    def end(self) -> int:
        """Its exit code; what it still draws is read meanwhile."""
        self.until(lambda _: self.process.poll() is not None)
        while select.select([self._master], [], [], 0)[0]:
            self.text += os.read(self._master, 65536).decode(errors="replace")
        assert termios.tcgetattr(self._slave) == self._before
        return self.process.returncode

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._master)
        os.close(self._slave)


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[DaemonProcess]:
    with speaking(tmp_path) as process:
        yield process


@pytest.fixture
def terminal(daemon: DaemonProcess) -> Iterator[Terminal]:
    made = Terminal("monitor", "--connect", daemon.endpoint)
    yield made
    made.close()


def test_ctrl_c_ends_it_and_the_terminal_is_as_before(terminal: Terminal) -> None:
    terminal.until(lambda text: "yaw" in text)
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.end() == 0
    assert "\x1b[?1049h" in terminal.text
    assert "\x1b[?1049l" in terminal.text
    assert "Traceback" not in terminal.text


def test_it_follows_the_size_of_its_window(terminal: Terminal) -> None:
    terminal.until(lambda text: "yaw" in text and "pitch" in text)
    terminal.resize(40, 6)
    seen = len(terminal.text)
    # One line a probe under a heading, and no block.
    terminal.until(lambda text: "probe            state" in text[seen:])
    terminal.press(b"q")
    assert terminal.end() == 0


def test_it_outlives_the_daemon(daemon: DaemonProcess, terminal: Terminal) -> None:
    terminal.until(lambda text: "yaw" in text)
    daemon.process.kill()
    terminal.until(lambda text: "waiting for it" in text)
    terminal.press(b"q")
    assert terminal.end() == 0


def test_a_pipe_gets_a_line_a_second(daemon: DaemonProcess) -> None:
    command = [sys.executable, "-m", "imud", "monitor", "--seconds", "2.5"]
    done = ran(*command, "--connect", daemon.endpoint, timeout=PATIENCE_S, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 3
    assert all(line.isprintable() for line in lines)
    assert "Hz" in lines[-1]
