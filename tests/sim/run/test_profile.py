# SPDX-License-Identifier: MIT
"""`nano --profile` and `f405 --profile` count every cycle for the right function."""

from __future__ import annotations

import functools
import json
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import bare
import images
import native
from programs import ran

SIM = Path(__file__).resolve().parents[1]
SAMPLES = 10
TURNS = 20  # calls of both functions in a sample, profiled.c of each board
AVR = ("-std=gnu11", "-mmcu=atmega328p", "-Os", "-mcall-prologues", *native.WARNINGS)


@dataclass(frozen=True)
class Board:
    """A virtual board with its program, and what the program's cycles are."""

    name: str
    code: int  # the emulator's exit code
    options: tuple[str, ...]
    main: str
    tick: str  # the handler of the interrupt
    shared: tuple[int, int]  # cycles of shared(), with its call
    first: tuple[int, int]  # of first() without it
    second: tuple[int, int]
    ticks: tuple[int, int]  # how many interrupts

    @functools.cached_property
    def image(self) -> Path:
        if self.name == "f405":
            return bare.image("profiled")
        return images.program("avr-gcc", *AVR, SIM / "nano" / "profiled.c")

    def run(self, *more: str | Path, image: Path | None = None) -> str:
        """Run the program; returns its standard error."""
        return self._run(self.code, image, *more)

    def refuse(self, *more: str | Path, image: Path | None = None) -> str:
        return self._run(2, image, *more)

    def _run(self, code: int, image: Path | None, *more: str | Path) -> str:
        emulator = images.emulators() / self.name
        words: list[str | Path] = [emulator, "--image", image or self.image]
        words += [*self.options, *more]
        done = ran(*words)
        assert done.returncode == code, done.stderr
        return done.stderr

    @functools.cached_property
    def profiled(self) -> Any:
        """The profile of a run."""
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "profile.json"
            self.run("--profile", out)
            return json.loads(out.read_text())


NANO = Board(
    *("nano", 0, ("--seconds", "0.1", "--fast"), "main"),
    tick="__vector_14",
    shared=(300, 320),
    first=(1000, 1150),  # with a call, a return and a few saved registers
    second=(500, 510),
    ticks=(99, 100),  # one a millisecond for 0.1 s
)
F405 = Board(
    *("f405", 1, ("--fast",), "program"),
    tick="on_tick",
    shared=(302, 302),  # instructions, with its return
    first=(1003, 1059),  # two times 501, a call, a return, the copies of four words
    second=(501, 504),
    ticks=(2 * SAMPLES + 1, 1000),
)
BOARDS = {"nano": NANO, "f405": F405}


@pytest.fixture(params=BOARDS)
def board(request: pytest.FixtureRequest) -> Board:
    return BOARDS[request.param]


@pytest.fixture
def profile(board: Board) -> Any:
    return board.profiled


@pytest.mark.parametrize("kind", ["cycles", "in_worst", "outside"])
def test_functions_add_up_to_the_total(profile: Any, kind: str) -> None:
    total = profile["total"]["worst" if kind == "in_worst" else kind]
    assert total > 0
    functions = profile["functions"].values()
    assert sum(function["self"][kind] for function in functions) == total


def test_no_cycle_is_nobodys(profile: Any) -> None:
    total = profile["total"]
    assert total["cycles"] + total["outside"] + profile["asleep"] == profile["cycles"]
    assert profile["asleep"] > 0
    assert profile["lost_calls"] == 0


def test_the_total_is_that_of_the_summary(
    board: Board, profile: Any, tmp_path: Path
) -> None:
    board.run("--summary", tmp_path / "summary.json")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert profile["samples"] == summary["samples"] == SAMPLES
    assert profile["total"]["cycles"] == round(summary["cycles_mean"] * SAMPLES)
    assert profile["total"]["worst"] == summary["cycles_worst"]


def test_a_busy_function_is_found_with_its_cycles(board: Board, profile: Any) -> None:
    functions = profile["functions"]
    calls = SAMPLES * TURNS
    # second() ends in a jump, so the stack does not show the call from it.
    for name, own, times in (("first", board.first, 2), ("second", board.second, 1)):
        alone = functions[name]["self"]["cycles"]
        assert own[0] <= alone / calls <= own[1]
        inside = functions[name]["inclusive"]["cycles"] - alone
        low, high = (times * cycles for cycles in board.shared)
        assert low <= inside / calls <= high
    whole = functions[board.main]["inclusive"]["cycles"]
    ticks = functions[board.tick]["inclusive"]["cycles"]
    assert whole + ticks == profile["total"]["cycles"]


def test_an_interrupt_is_measured_from_its_entry_to_its_return(
    board: Board, profile: Any
) -> None:
    tick = profile["interrupts"][board.tick]
    cycles = profile["functions"][board.tick]["inclusive"]
    assert tick["cycles"] == cycles["cycles"] + cycles["outside"]
    assert board.ticks[0] <= tick["calls"] <= board.ticks[1]
    assert board.shared[0] < tick["cycles"] / tick["calls"] <= tick["worst"]
    assert tick["worst"] < board.shared[1] + 100


def test_to_be_watched_changes_nothing(board: Board, tmp_path: Path) -> None:
    results = []
    for watch in ((), ("--profile", tmp_path / "out.json")):
        record, summary = tmp_path / "record", tmp_path / "summary.json"
        output = board.run("--record", record, "--summary", summary, *watch)
        results.append((output, record.read_bytes(), summary.read_text()))
    assert results[0] == results[1]
    assert len(results[0][1]) >= 1


def test_an_image_without_symbols_is_refused(tmp_path: Path) -> None:
    image = tmp_path / "bare.elf"
    subprocess.run(["avr-strip", "-o", image, NANO.image], check=True)
    assert "no symbols" in NANO.refuse("--profile", tmp_path / "out", image=image)


def test_names_are_those_of_the_source_whatever_they_hold(tmp_path: Path) -> None:
    # In an image that is linked with relaxation, the assembler's numbered labels
    # remain inside functions. A symbol may have any name.
    odd = 'sec"ond\\of\tten'
    other = tmp_path / "odd.elf"
    listed = subprocess.check_output(["avr-nm", NANO.image], text=True)
    (start,) = re.findall(r"^(\w+) T first$", listed, re.MULTILINE)
    label = f"0x{int(start, 16) + 4:x}"
    subprocess.run(
        [
            *("avr-objcopy", "--redefine-sym", f"second={odd}"),
            *("--add-symbol", f"L1\002=.text:{label},local", NANO.image, other),
        ],
        check=True,
    )
    out = tmp_path / "out.json"
    NANO.run("--profile", out, image=other)
    functions = json.loads(out.read_text())["functions"]
    assert odd in functions
    assert not any("\002" in name for name in functions)
    NANO.run("--profile", out)
    plain = json.loads(out.read_text())["functions"]
    assert functions.pop(odd) == plain.pop("second")
    assert functions == plain
