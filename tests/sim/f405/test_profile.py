# SPDX-License-Identifier: MIT
"""`f405 --profile` counts every instruction for the right function."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

import bare

SAMPLES = 10
TURNS = 20  # calls of both functions in a sample, tests/sim/f405/profiled.c
SHARED = 302  # instructions, with its return


def symbols(image: Path) -> dict[str, tuple[int, int]]:
    """The addresses at which each function starts and ends."""
    output = subprocess.run(
        ["arm-none-eabi-nm", "-S", image], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split() for line in output.splitlines()]
    return {
        row[3]: (int(row[0], 16), int(row[0], 16) + int(row[1], 16))
        for row in rows
        if len(row) == 4
    }


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("profile")
    where = symbols(bare.image("profiled"))
    lines = ["8000000 8100000 -"]
    for function, part in {
        "first": "one",
        "second": "two",
        "shared": "-",
        "on_tick": "tick",
        "program": "main",
        "reset": "main",
    }.items():
        lines.append(f"{where[function][0]:x} {where[function][1]:x} {part}")
    (folder / "parts").write_text("\n".join(lines) + "\n")
    out = folder / "profile.json"
    bare.run("profiled", folder, "--profile", str(out), "--parts", f"{folder}/parts")
    return json.loads(out.read_text())


@pytest.mark.parametrize("kind", ["cycles", "in_worst", "outside"])
def test_parts_and_functions_add_up_to_the_total(profile: Any, kind: str) -> None:
    total = profile["total"]["worst" if kind == "in_worst" else kind]
    assert total > 0
    assert sum(part[kind] for part in profile["parts"].values()) == total
    functions = profile["functions"].values()
    assert sum(function["self"][kind] for function in functions) == total


def test_no_cycle_is_nobodys(profile: Any) -> None:
    total = profile["total"]
    assert total["cycles"] + total["outside"] + profile["asleep"] == profile["cycles"]
    assert profile["asleep"] > 0
    assert profile["lost_calls"] == 0


def test_the_total_is_that_of_the_summary(profile: Any, tmp_path: Path) -> None:
    summary = bare.run("profiled", tmp_path).summary
    assert profile["samples"] == summary["samples"] == SAMPLES
    assert profile["total"]["cycles"] == round(summary["cycles_mean"] * SAMPLES)
    assert profile["total"]["worst"] == summary["cycles_worst"]


def test_a_busy_function_is_found_with_its_instructions(profile: Any) -> None:
    functions = profile["functions"]
    calls = SAMPLES * TURNS
    # Two times 501, plus a call, a return and the copies of four words.
    assert 1002 < functions["first"]["self"]["cycles"] / calls < 1060
    inside = functions["first"]["inclusive"]["cycles"]
    assert inside - functions["first"]["self"]["cycles"] == calls * 2 * SHARED
    # It ends in a jump, so the stack does not show the call from it.
    assert 501 <= functions["second"]["self"]["cycles"] / calls < 505
    inside = functions["second"]["inclusive"]["cycles"]
    assert inside - functions["second"]["self"]["cycles"] == calls * SHARED
    whole = functions["program"]["inclusive"]["cycles"]
    ticks = functions["on_tick"]["inclusive"]["cycles"]
    assert whole + ticks == profile["total"]["cycles"]


def test_shared_code_counts_for_the_part_that_calls_it(profile: Any) -> None:
    parts, functions = profile["parts"], profile["functions"]
    assert parts["one"]["cycles"] == functions["first"]["inclusive"]["cycles"]
    assert parts["two"]["cycles"] == functions["second"]["inclusive"]["cycles"]
    assert parts["tick"]["cycles"] == functions["on_tick"]["inclusive"]["cycles"]
    assert parts["main"]["cycles"] == functions["program"]["self"]["cycles"]


def test_an_interrupt_is_measured_from_its_entry_to_its_return(profile: Any) -> None:
    tick = profile["interrupts"]["on_tick"]
    cycles = profile["functions"]["on_tick"]["inclusive"]
    assert tick["cycles"] == cycles["cycles"] + cycles["outside"]
    assert tick["calls"] > 2 * SAMPLES
    assert SHARED < tick["worst"] < SHARED + 20
    assert tick["cycles"] == tick["worst"] * tick["calls"]


def test_to_be_watched_changes_nothing(tmp_path: Path) -> None:
    alone = bare.run("profiled", tmp_path)
    watched = bare.run("profiled", tmp_path, "--profile", str(tmp_path / "out"))
    assert alone == watched
    assert alone.lines["ticks"][0] > 2 * SAMPLES


@pytest.mark.parametrize(
    "text",
    ["8000000 8000100\n", "zero 100 part\n", "8000000 8100002 part\n", "0 2 p\n"],
)
def test_parts_that_cannot_be_are_refused(tmp_path: Path, text: str) -> None:
    parts = tmp_path / "parts"
    parts.write_text(text)
    more = ("--profile", str(tmp_path / "out"), "--parts", str(parts))
    assert "START END PART" in bare.refused("profiled", *more)


def test_parts_alone_are_a_mistake(tmp_path: Path) -> None:
    error = bare.refused("profiled", "--parts", str(tmp_path))
    assert "--parts needs --profile" in error
