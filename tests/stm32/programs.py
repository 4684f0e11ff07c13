# SPDX-License-Identifier: MIT
"""Programs over the firmware's code, built as the image of the STM32F405 is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

import images
from bits.processors import PROCESSORS, command
from length import choose

ROOT = Path(__file__).resolve().parent.parent.parent
FIRMWARE = ROOT / "firmware"


# The image leaves the FPU off. With it on, in whose registers the compiler may keep
# integers, the tests are for `make test-long`.
FLOAT_ABIS = choose(
    everyday=["soft"], long=["soft", pytest.param("hard", marks=pytest.mark.long)]
)


def board_program(float_abi: str, sources: Iterable[Path]) -> Path:
    """Of these sources; `soft` leaves the FPU off, `hard` uses it."""
    fpu = "cortex_m4_fpu" if float_abi == "hard" else "cortex_m4"
    return images.program(
        *command(PROCESSORS[fpu]),
        *("-I", ROOT / "tests" / "stm32", "-I", ROOT / "tests" / "generic"),
        *sorted(sources),
        *sorted((FIRMWARE / "core").rglob("*.c")),
        *sorted((FIRMWARE / "generic").glob("*.c")),
        *sorted((FIRMWARE / "stm32").glob("*.c")),
    )
