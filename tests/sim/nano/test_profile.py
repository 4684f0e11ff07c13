# SPDX-License-Identifier: MIT
"""`nano --profile` counts every cycle for the right function."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

import images
import native

ROOT = Path(__file__).resolve().parents[3]
NANO = ROOT / "build" / "sim" / "nano"
SAMPLES = 10
TURNS = 20  # calls of both functions in a sample, tests/sim/nano/profiled.c


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    images.emulators()
    image = tmp_path_factory.mktemp("profiled") / "profiled.elf"
    source = Path(__file__).with_name("profiled.c")
    flags = ("-std=gnu11", "-mmcu=atmega328p", "-Os", "-mcall-prologues")
    subprocess.run(
        ["avr-gcc", *flags, *native.WARNINGS, "-o", image, source], check=True
    )
    return image


def run(image: Path, *more: str | Path, code: int = 0) -> str:
    done = subprocess.run(
        [NANO, "--image", image, "--seconds", "0.1", *more],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == code, done.stderr
    return done.stderr


def symbols(image: Path) -> dict[str, tuple[int, int]]:
    """The addresses at which each function starts and ends."""
    output = subprocess.run(
        ["avr-nm", "-S", image], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split() for line in output.splitlines()]
    return {
        row[3]: (int(row[0], 16), int(row[0], 16) + int(row[1], 16))
        for row in rows
        if len(row) == 4
    }


@pytest.fixture(scope="module")
def profile(image: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("profile")
    where = symbols(image)
    lines = [f"0 {2 * 16384:x} -"]
    for function, part in {
        "first": "one",
        "second": "two",
        "shared": "-",
        "__vector_14": "tick",
        "main": "main",
    }.items():
        lines.append(f"{where[function][0]:x} {where[function][1]:x} {part}")
    (folder / "parts").write_text("\n".join(lines) + "\n")
    out = folder / "profile.json"
    run(image, "--profile", out, "--parts", folder / "parts")
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


def test_the_total_is_that_of_the_summary(
    profile: Any, image: Path, tmp_path: Path
) -> None:
    run(image, "--summary", tmp_path / "summary.json")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert profile["samples"] == summary["samples"] == SAMPLES
    assert profile["total"]["cycles"] == round(summary["cycles_mean"] * SAMPLES)
    assert profile["total"]["worst"] == summary["cycles_worst"]


def test_a_busy_function_is_found_with_its_cycles(profile: Any) -> None:
    functions = profile["functions"]
    calls = SAMPLES * TURNS
    # Both figures include a call, a return and a few saved registers.
    assert 1000 <= functions["first"]["self"]["cycles"] / calls < 1150
    assert 1600 <= functions["first"]["inclusive"]["cycles"] / calls < 1800
    # It ends in a jump, so the stack does not show the call from it.
    assert 500 <= functions["second"]["self"]["cycles"] / calls < 510
    assert 800 <= functions["second"]["inclusive"]["cycles"] / calls < 815
    whole = functions["main"]["inclusive"]["cycles"]
    ticks = functions["__vector_14"]["inclusive"]["cycles"]
    assert whole + ticks == profile["total"]["cycles"]


def test_shared_code_counts_for_the_part_that_calls_it(profile: Any) -> None:
    parts, functions = profile["parts"], profile["functions"]
    assert parts["one"]["cycles"] == functions["first"]["inclusive"]["cycles"]
    assert parts["two"]["cycles"] == functions["second"]["inclusive"]["cycles"]
    assert parts["tick"]["cycles"] == functions["__vector_14"]["inclusive"]["cycles"]
    assert parts["main"]["cycles"] == functions["main"]["self"]["cycles"]
    assert "-" not in parts


def test_an_interrupt_is_measured_from_its_entry_to_its_return(profile: Any) -> None:
    tick = profile["interrupts"]["__vector_14"]
    cycles = profile["functions"]["__vector_14"]["inclusive"]
    assert tick["cycles"] == cycles["cycles"] + cycles["outside"]
    # One a millisecond for 0.1 s.
    assert tick["calls"] in (99, 100)
    assert 300 < tick["cycles"] / tick["calls"] < 400
    assert tick["worst"] < 400


def test_to_be_watched_changes_nothing(image: Path, tmp_path: Path) -> None:
    results = {}
    for name in ("alone", "watched"):
        record, summary = tmp_path / f"{name}.bin", tmp_path / f"{name}.json"
        watch = ("--profile", tmp_path / "out.json") if name == "watched" else ()
        output = run(image, "--record", record, "--summary", summary, *watch)
        results[name] = output, record.read_bytes(), summary.read_text()
    assert results["alone"] == results["watched"]
    assert len(results["alone"][1]) == 1


@pytest.mark.parametrize("text", ["0 100\n", "zero 100 part\n", "0 8002 part\n"])
def test_parts_that_cannot_be_are_refused(
    image: Path, tmp_path: Path, text: str
) -> None:
    parts = tmp_path / "parts"
    parts.write_text(text)
    error = run(image, "--profile", tmp_path / "out", "--parts", parts, code=2)
    assert "START END PART" in error


def test_an_image_without_symbols_is_refused(image: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.elf"
    subprocess.run(["avr-strip", "-o", bare, image], check=True)
    assert "no symbols" in run(bare, "--profile", tmp_path / "out", code=2)


def test_parts_alone_are_a_mistake(image: Path, tmp_path: Path) -> None:
    assert "--parts needs --profile" in run(image, "--parts", tmp_path, code=2)


def test_names_are_those_of_the_source_whatever_they_hold(
    image: Path, tmp_path: Path
) -> None:
    # In an image that is linked with relaxation, the assembler's numbered labels
    # remain inside functions. A symbol may have any name.
    odd = 'sec"ond\\of\tten'
    other = tmp_path / "odd.elf"
    label = f"0x{symbols(image)['first'][0] + 4:x}"
    subprocess.run(
        [
            *("avr-objcopy", "--redefine-sym", f"second={odd}"),
            *("--add-symbol", f"L1\002=.text:{label},local", image, other),
        ],
        check=True,
    )
    out = tmp_path / "out.json"
    run(other, "--profile", out)
    functions = json.loads(out.read_text())["functions"]
    assert odd in functions
    assert not any("\002" in name for name in functions)
    run(image, "--profile", out)
    plain = json.loads(out.read_text())["functions"]
    assert functions.pop(odd) == plain.pop("second")
    assert functions == plain
