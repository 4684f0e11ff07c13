# SPDX-License-Identifier: MIT
"""Programs over the firmware's code, built as the image of the STM32F405 is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

import images
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
    fpu = ("-mfpu=fpv4-sp-d16",) if float_abi == "hard" else ()
    return images.program(
        *("arm-none-eabi-gcc", "-mthumb", "-mcpu=cortex-m4"),
        *(f"-mfloat-abi={float_abi}", *fpu, "-DF_CPU=168000000L"),
        *("-std=gnu11", "-O2", "-ffreestanding", "-fbuiltin", "-fno-common"),
        *("-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections"),
        *("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"),
        *("-nostdlib", "-Wl,--fatal-warnings", "-I", FIRMWARE),
        *("-I", FIRMWARE / "stm32" / "libc", "-I", ROOT / "tests" / "stm32"),
        *("-T", FIRMWARE / "stm32" / "stm32f405.ld", *sorted(sources)),
        *sorted((FIRMWARE / "core").rglob("*.c")),
        *sorted((FIRMWARE / "generic").glob("*.c")),
        *sorted((FIRMWARE / "stm32").glob("*.c")),
    )
