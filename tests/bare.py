# SPDX-License-Identifier: MIT
"""Bare programs for the virtual STM32F405: builds tests/sim/f405/, runs, reads back."""

from __future__ import annotations

import collections
import functools
import json
import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import images
import native
from programs import ran

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / "tests" / "sim" / "f405"
COMPILER = "arm-none-eabi-gcc"
FLAGS = (
    *("-std=gnu11", "-mthumb", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),
    *("-mfloat-abi=softfp", "-Os", "-ffreestanding", "-nostdlib", *native.WARNINGS),
    *("-T", str(SOURCES / "bare.ld"), "-Wl,--no-warn-rwx-segments"),
)
ASLEEP = "the firmware sleeps with no interrupt enabled"


class Output(NamedTuple):
    """The output of a run: its lines by name, its bytes, the summary, stderr."""

    lines: dict[str, list[int]]
    data: bytes
    summary: Any
    errors: str


@functools.cache
def emulator() -> Path:
    """Build the virtual STM32F405 where it is not up to date."""
    return images.emulators() / "f405"


@functools.cache
def image(program: str) -> Path:
    """Compile one of the programs."""
    if shutil.which(COMPILER) is None:
        pytest.fail(f"{COMPILER} is not there: make setup", pytrace=False)
    files = (SOURCES / "bare.c", SOURCES / f"{program}.c")
    return images.program(COMPILER, *FLAGS, *files)


def run(program: str, folder: Path, *more: str, code: int = 1) -> Output:
    """Run a program. It ends by going to sleep permanently, unless `code` is another.

    A run without options is made once: it would give the same again.
    """
    return _run(program, folder, *more, code=code) if more else _plain(program, code)


@functools.cache
def _plain(program: str, code: int) -> Output:
    with tempfile.TemporaryDirectory() as folder:
        return _run(program, Path(folder), code=code)


def _run(program: str, folder: Path, *more: str, code: int) -> Output:
    record, summary = folder / "bytes", folder / "summary.json"
    command: list[str | Path] = [emulator(), "--image", image(program)]
    command += ["--record", record, "--summary", summary, *more]
    done = ran(*command)
    assert done.returncode == code, done.stderr
    data = record.read_bytes()
    return Output(parse(data), data, json.loads(summary.read_text()), done.stderr)


def refused(program: str, *more: str) -> str:
    """Run a program with options that are a mistake. Return what it says of them."""
    done = ran(emulator(), "--image", image(program), *more)
    assert done.returncode == 2, done.stderr
    return done.stderr


def ended(program: str, folder: Path, *more: str) -> dict[str, list[int]]:
    """Run a program that exits and has not violated the manuals."""
    output = run(program, folder, *more)
    assert ASLEEP in output.errors, output.errors
    assert output.summary["firmware_complaint"] is None
    assert output.summary["sensor_complaint"] is None
    return output.lines


def parse(data: bytes) -> dict[str, list[int]]:
    """Return the numbers of each name, in order."""
    lines: dict[str, list[int]] = collections.defaultdict(list)
    for name, value in re.findall(rb"^([a-z_0-9]+) ([0-9a-f]{8})$", data, re.M):
        lines[name.decode()].append(int(value, 16))
    return dict(lines)


def faults(folder: Path, *items: dict[str, Any]) -> Sequence[str]:
    """The option that has these faults come to pass."""
    path = folder / "faults.json"
    path.write_text(json.dumps(items))
    return ("--faults", str(path))
