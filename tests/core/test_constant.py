# SPDX-License-Identifier: MIT
"""core/math/constant.h: fixed-point constants have the same bits on every compiler, of
which that of the AVR computes in floats of 24 bits.
"""

from __future__ import annotations

import math
import random
import re
import subprocess
from fractions import Fraction
from pathlib import Path

import pytest

import images

FIRMWARE = images.ROOT / "firmware"
CORE = FIRMWARE / "core"
COMPILERS = {
    "gcc": ("gcc",),
    "gcc -fsingle-precision-constant": ("gcc", "-fsingle-precision-constant"),
    "avr-gcc": ("avr-gcc", "-mmcu=atmega328p", "-Os"),
    "arm-none-eabi-gcc": ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-O2"),
}
every_compiler = pytest.mark.parametrize("compiler", COMPILERS)
# pi / 180 to 40 digits, of which the header keeps the first 12.
DEGREE = Fraction("0.0174532925199432957692369076848861271344287")


def numbers(compiler: str, folder: Path, text: str, values: list[str]) -> list[int]:
    """What a compiler makes of expressions of 64 bits, which follow the text."""
    source = folder / "numbers.c"
    made, flat = source.with_suffix(".o"), source.with_suffix(".bin")
    rows = "".join(f"    (int64_t)({value}),\n" for value in values)
    placed = '__attribute__((section(".numbers")))'
    source.write_text(
        f"{text}\n#include <stdint.h>\nextern const int64_t numbers[];\n"
        f"{placed} const int64_t numbers[] = {{\n{rows}}};\n"
    )
    command = COMPILERS[compiler]
    flags = ("-std=gnu11", "-Wall", "-Wconversion", "-Werror", "-Wno-unused-function")
    words = (*command, *flags, "-I", FIRMWARE, "-c", source, "-o", made)
    subprocess.run(words, check=True)
    copy = command[0].removesuffix("gcc") + "objcopy"
    words = (copy, "-O", "binary", "--only-section=.numbers", made, flat)
    subprocess.run(words, check=True)
    data = flat.read_bytes()
    assert len(data) == 8 * len(values)
    return [
        int.from_bytes(data[at : at + 8], "little", signed=True)
        for at in range(0, len(data), 8)
    ]


def rounded(value: Fraction) -> int:
    return math.floor(value + Fraction(1, 2))


@every_compiler
def test_a_constant_of_six_digits_is_exact(compiler: str, tmp_path: Path) -> None:
    chance = random.Random(1)  # noqa: S311, numbers to try
    texts = [
        "0",
        "1",
        "2",
        "0.35",
        "0.005",
        "999999.0",
        "1e-7",
        "0.1",
        "0.01",
        "100000",
    ]
    for _ in range(1500):
        digits = chance.randint(1, 6)
        mantissa = chance.randint(10 ** (digits - 1), 10**digits - 1)
        texts.append(f"{mantissa}e{chance.randint(-7, 5) - digits + 1}")
    bits = [chance.choice((0, 13, 14, 16, 18, 19, 21, 25, 30, 35, 39)) for _ in texts]
    found = numbers(
        compiler,
        tmp_path,
        '#include "core/math/constant.h"',
        [f"Q_OF({text}, {n})" for text, n in zip(texts, bits, strict=True)],
    )
    wanted = [
        rounded(Fraction(text) * 2**n) for text, n in zip(texts, bits, strict=True)
    ]
    assert found == wanted


@every_compiler
def test_degrees_become_radians_and_back(compiler: str, tmp_path: Path) -> None:
    cases = [
        ("Q_RAD(2, 25)", 2 * DEGREE * 2**25),
        ("Q_RAD(15.625, 30)", Fraction("15.625") * DEGREE * 2**30),
        ("Q_RAD2(900, 30)", 900 * DEGREE**2 * 2**30),
        ("Q_RAD2(0.005, 39)", Fraction("0.005") * DEGREE**2 * 2**39),
        ("Q_DEG(0.032, 30)", Fraction("0.032") / DEGREE * 2**30),
        ("Q_DEG2(40000, 0)", 40000 / DEGREE**2),
    ]
    include = '#include "core/math/constant.h"'
    found = numbers(compiler, tmp_path, include, [text for text, _ in cases])
    assert found == [rounded(exact) for _, exact in cases]


def constants(path: Path) -> list[str]:
    """The constants that a source of the core computes from plain numbers."""
    text = path.read_text("utf-8").replace("\\\n", " ")
    made = r"^#define (\w+) [^\n]*\b(?:Q\w+|ROUNDED|[A-Z]+_VARIANCE)\("
    return re.findall(made, text, re.MULTILINE)


SOURCES = sorted(path for path in CORE.rglob("*.[ch]") if constants(path))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_constants_are_the_same_on_every_compiler(path: Path, tmp_path: Path) -> None:
    names = constants(path)
    found = {
        compiler: numbers(compiler, tmp_path, f'#include "{path}"', names)
        for compiler in COMPILERS
    }
    for compiler, values in found.items():
        assert dict(zip(names, values, strict=True)) == dict(
            zip(names, found["gcc"], strict=True)
        ), compiler


def test_constants_of_all_rooms_are_compared() -> None:
    names = [name for path in SOURCES for name in constants(path)]
    assert len(names) > 110
    assert {"LAG_Q35", "TURNING_NOISE", "KP_Q25", "LEAN_MIN_Q30"} <= set(names)


def limits(path: Path) -> list[str]:
    """The constants of which FIXED_HIGH() takes the upper half; of a choice, both."""
    inside = r"FIXED_HIGH\(((?:[^()]|\([^()]*\))*)\)"
    found = re.findall(inside, path.read_text("utf-8"))
    choices = [text.partition("?")[2] or text for text in found]
    return sorted({one.strip() for text in choices for one in text.split(":")})


LIMITS = {path: limits(path) for path in CORE.rglob("*.c")}


@pytest.mark.parametrize(
    "path",
    [path for path, names in LIMITS.items() if names],
    ids=lambda path: path.name,
)
def test_a_limit_that_is_loaded_by_its_upper_half_has_no_lower_one(
    path: Path, tmp_path: Path
) -> None:
    names = LIMITS[path]
    found = numbers("gcc", tmp_path, f'#include "{path}"', names)
    uneven = [name for name, n in zip(names, found, strict=True) if n % 65536]
    assert uneven == []


# What products of 32 bits need of the filter's numbers: the one to blame, the product
# at its largest, and how many bits that may have.
PRODUCTS = [
    # sqrt(16 * 4096 * (3^2 + 3 * 90^2)): three axes of a surprise of 90 uT.
    (
        "FUSE_FIELD_NOISE_UT2_S",
        "fuse_field.c",
        "INT64_C(39910) * (FIELD_NOISE / 768)",
        31,
    ),
    (
        "FUSE_TURNING_SHARE",
        "fuse_field.c",
        "INT64_C(1) * (TURNING_FAR + FIELD_UNIT_FINE) * TURNING_NOISE"
        " + INT64_C(1) * TURNING_LEANING_MAX_Q18 * TURNING_LEANING",
        31,
    ),
    (
        "FUSE_MOTION_DRIFT_S",
        "fuse_gyro.c",
        "MOTION_NOISE + INT64_C(1) * MOTION_DRIFT_MAX_Q30 * MOTION_DRIFT",
        30,
    ),
    (
        "FUSE_WARMING_DPS2_S",
        "fuse_gyro.c",
        "BIAS_VARIANCE(FUSE_PER_WINDOW(FUSE_WARMING_DPS2_S) * WARMING_STEPS)",
        16,
    ),
    (
        "FUSE_STROKE_NOISE_MAX_M2_S4",
        "fuse_stroke.c",
        "INT64_C(1) * DRIFT_NOISE_MAX * DRIFT_NOISE + 1",
        30,
    ),
]


@pytest.mark.parametrize(("name", "file", "product", "bits"), PRODUCTS)
def test_a_number_of_the_filter_keeps_its_products_in_range(
    name: str, file: str, product: str, bits: int, tmp_path: Path
) -> None:
    include = f'#include "{CORE / "fusion" / file}"'
    (found,) = numbers("gcc", tmp_path, include, [product])
    assert 0 < found < 2**bits, f"{name} in fuse_params.h is too large: {found}"
