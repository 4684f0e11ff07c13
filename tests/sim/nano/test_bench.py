# SPDX-License-Identifier: MIT
"""build/sim/bench, which runs a filter alone: the images that it refuses.

tests/benchmarks/firmware/test_cycles.py tests what it measures.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import images

ROOT = Path(__file__).resolve().parents[3]
BENCH = ROOT / "build" / "sim" / "bench"
NULL = "/dev/null"
FILES = ("--samples", NULL, "--answers", NULL, "--summary", NULL)


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Firmware that is not a filter for build/sim/bench."""
    images.emulators()
    folder = tmp_path_factory.mktemp("bench")
    (folder / "other.c").write_text("int main(void) { return 0; }\n")
    words = ["avr-gcc", "-mmcu=atmega328p", "-o", folder / "other.elf"]
    subprocess.run([*words, folder / "other.c"], check=True)
    return folder / "other.elf"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "usage: bench"),
        (["--image"], "usage: bench"),
        (["--image", "{image}", "--samples", "x", "--answers", "y"], "usage: bench"),
        (["--wings", "2"], "usage: bench"),
        (["--image", "{image}", *FILES], "is no image of benchmarks/avr"),
        (["--image", "/bin/true", *FILES], "is no image of benchmarks/avr"),
    ],
)
def test_a_mistake_is_told(image: Path, words: list[str], expected: str) -> None:
    done = subprocess.run(
        [BENCH, *(word.format(image=image) for word in words)],
        capture_output=True,
        text=True,
        check=False,
        timeout=20,
    )
    assert done.returncode == 2
    assert expected in done.stderr
