# SPDX-License-Identifier: MIT
"""firmware/avr/fixed_mul.S in the virtual Nano against its twin in C on this machine,
which test_fixed.py, test_vector.py, test_quat.py and test_matrix.py compare with exact
integers and doubles.

Both run avr/fixed_mul_test.c, which prints a hash of all results of each batch.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from length import choose

pytestmark = pytest.mark.long

BATCHES = choose(everyday=5, long=25)
# 25 batches take the program 34 s, that of avr-gcc 14.2 up to 3 s more.
SECONDS = choose(everyday=13, long=54)
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")


def compiled(root: Path, program: Path, *words: object) -> Path:
    """The program by a compiler, with the functions that are under test."""
    command = [
        *(*words, "-std=gnu11", *WARNINGS, f"-DBATCHES={BATCHES}"),
        *("-I", root / "firmware", "-o", program),
        root / "tests" / "core" / "avr" / "fixed_mul_test.c",
        root / "firmware" / "core" / "math" / "fixed.c",
    ]
    subprocess.run(command, check=True)
    return program


@pytest.fixture(scope="module")
def printed(
    root: Path, nano: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[str]:
    """What the program printed on the AVR, line by line."""
    folder = tmp_path_factory.mktemp("fixed_mul")
    avr = ("avr-gcc", "-mmcu=atmega328p", "-Os", root / "firmware/avr/fixed_mul.S")
    program, record = compiled(root, folder / "program.elf", *avr), folder / "record"
    subprocess.run(
        [
            *(nano, "--image", program, "--record", record),
            *("--fast", "--seconds", str(SECONDS)),
        ],
        check=True,
        capture_output=True,
    )
    return record.read_text(encoding="ascii").splitlines()


def test_the_avr_multiplies_as_its_twin_at_the_edges_and_thousands_of_times_between(
    printed: list[str], root: Path, tmp_path: Path
) -> None:
    # As on the AVR, sums may wrap.
    twin = ("gcc", "-O2", "-fwrapv", root / "firmware/core/math/fixed_mul.c")
    program = compiled(root, tmp_path / "program", *twin)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    assert len(printed) == BATCHES + 3
    assert printed[1:] == done.stdout.splitlines()


def test_the_avr_multiplies_in_the_cycles_that_the_source_says(
    printed: list[str], root: Path
) -> None:
    source = (root / "firmware" / "avr" / "fixed_mul.S").read_text(encoding="utf-8")
    cycles = printed[0].removeprefix("cycles ").split()
    names = ("fixed_mul_q30", "fixed_mul_q32", "fixed_umul_q32")
    text = ", ".join(f"{name} {n}" for name, n in zip(names, cycles, strict=True))
    assert text in source.replace("\n; ", " ")
