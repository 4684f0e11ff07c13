# SPDX-License-Identifier: MIT
"""firmware/avr/fixed_mul.S against exact integers, in the virtual Nano.

The program avr/fixed_mul_test.c multiplies factors that are known here too and prints
a hash of all results of each batch.
"""

from __future__ import annotations

import math
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from length import choose

pytestmark = pytest.mark.long

BATCHES, BATCH = choose(everyday=5, long=25), 1024
# 25 batches take the program 34 s, that of avr-gcc 14.2 up to 3 s more.
SECONDS = choose(everyday=13, long=54)

EDGES = (
    *(0, 1, -1, 2, -2, 32767, 32768, -32768, 65535, 65536),
    *(0x1FFFFFFF, 0x20000000, -0x20000000, 0x3FFFFFFF, 0x40000000, -0x40000000),
    *(0x00FF00FF, -0x00FF0100, 2**31 - 1, -(2**31), -(2**31) + 1),
)

WORD = 2**32 - 1


def signed(number: int, bits: int = 32) -> int:
    """The two's complement number in the low bits."""
    return (number + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)


def term(a: int, b: int) -> int:
    """A product in a sum: 64ths of a step, without its three lowest pairs of bytes."""
    low = a % 2**8 * (b % 2**16) + (a % 2**16 - a % 2**8) * (b % 2**8)
    return (a * b - low) >> 24


def rounded(total: int, bits: int) -> int:
    return signed((total + 2 ** (bits - 1)) >> bits)


def cross(a: Sequence[int], b: Sequence[int]) -> list[int]:
    """The sums of the cross product's components."""
    return [term(a[j], b[k]) - term(a[k], b[j]) for j, k in ((1, 2), (2, 0), (0, 1))]


def multiplied(a: Sequence[int], b: Sequence[int]) -> list[int]:
    """quat_multiply()."""
    w = term(a[0], b[0]) - sum(map(term, a[1:], b[1:]))
    vector = [
        term(a[0], b_i) + term(a_i, b[0]) + both
        for a_i, b_i, both in zip(a[1:], b[1:], cross(a[1:], b[1:]), strict=True)
    ]
    return [rounded(total, 6) for total in (w, *vector)]


def rotated(q: Sequence[int], v: Sequence[int]) -> list[int]:
    """quat_rotate()."""
    t = [rounded(total, 5) for total in cross(q[1:], v)]
    return [
        v_i + rounded(term(q[0], t_i) + both, 6)
        for v_i, t_i, both in zip(v, t, cross(q[1:], t), strict=True)
    ]


def root(x: int) -> int:
    """fixed_rsqrt()."""
    y = 2289217568 - (x * 1306743800 >> 32)
    for _ in range(3):
        y = min(y, 2**31 - 1)
        factor = 1610612736 - 2 * (x * (y * y >> 32) >> 32)
        y = 4 * (y * factor >> 32)
    return min(y, 2**31 - 1)


def clamped(number: int, limit: int) -> int:
    return max(-limit, min(number, limit))


def crossed(a: Sequence[int], b: Sequence[int]) -> list[int]:
    """vector_cross()."""
    product = [[signed((x * y + 2**29) >> 30) for y in b] for x in a]
    return [product[j][k] - product[k][j] for j, k in ((1, 2), (2, 0), (0, 1))]


def matrix(q: Sequence[int]) -> list[int]:
    """matrix_from_quat(), row by row."""

    def coarse(part: int) -> int:
        rounded = signed((part + 2**14) >> 15, 16)
        return rounded if rounded > -(2**15) else 1 - 2**15 if part < 0 else 2**15 - 1

    def twice(total: int) -> int:
        return (total * 2 + 2**15) >> 16

    w, x, y, z = map(coarse, q)

    return [
        *(2**14 - twice(y * y + z * z), twice(x * y - w * z), twice(x * z + w * y)),
        *(twice(x * y + w * z), 2**14 - twice(x * x + z * z), twice(y * z - w * x)),
        *(twice(x * z - w * y), twice(y * z + w * x), 2**14 - twice(x * x + y * y)),
    ]


class Hashes:
    """The running hashes, as `mix` in the program makes them."""

    def __init__(self) -> None:
        self.values = [0] * 12

    def mix(self, index: int, result: int) -> None:
        value = self.values[index]
        self.values[index] = ((value << 7 | value >> 25) + result) & WORD

    def multiply(self, a: int, b: int) -> None:
        product = signed(a) * signed(b)
        row = (
            signed(a) * signed(b >> 8, 16)
            + signed(b) * signed(a, 16)
            + signed(a ^ b) * signed(a + b, 16)
        )
        results = (
            (product + 2**29) >> 30,
            (product + 2**31) >> 32,
            (a * b) >> 32,
            (row + 2**13) >> 14,
        )
        for i, result in enumerate(results):
            self.mix(i, result)
        self.mix(0, results[0])  # of numbers in memory
        v = [signed(a), signed(b), signed(a ^ b)]
        p, q = [*v, signed(a + b)], [*v[1:], signed(a - b), v[0]]
        for number in multiplied(p, q):
            self.mix(4, number)
        for number in rotated(q, v):
            self.mix(5, number)
        self.limit(a, b)
        self.add_up(a, b)
        for number in crossed(v, q[1:]):
            self.mix(9, number)
        rows = matrix(q)
        for number in rows:
            self.mix(10, number % 2**16)
        for i in (0, 3, 6):
            row = (signed(element, 16) for element in rows[i : i + 3])
            total = sum(x * y for x, y in zip(v, row, strict=True))
            self.mix(10, signed((total + 2**13) >> 14))

    def limit(self, a: int, b: int) -> None:
        bound = b % 2**31
        self.mix(6, clamped(signed(a), bound))
        v = [clamped(signed(signed(a) + bound // 2), bound), a // 2, signed(a ^ b)]
        self.mix(6, v[0])
        high = bound // 2**16 * 2**16
        self.mix(6, clamped(signed(a), high))
        self.mix(6, clamped(signed(signed(a) + bound // 2), high))
        self.mix(6, (signed(a) >> 1) + bound // 2)
        self.mix(6, (signed(a) >> 1) + bound // 2 - bound)
        v = [signed((number * signed(b) + 2**29) >> 30) for number in v]
        for number in (*v, *(clamped(number, bound) for number in v)):
            self.mix(7, number)
        self.mix(8, a // 2 * 2**30 // max(bound + 1, a // 4 + 1))
        self.mix(8, math.isqrt(a))
        self.mix(8, root(a | 2**30))

    def add_up(self, a: int, b: int) -> None:
        def product(x: int, y: int) -> int:
            return signed((x * y + 2**29) >> 30)

        v = [signed(a), signed(b), signed(a ^ b)]
        element = signed(b >> 16, 16) * 2**16
        self.mix(11, product(v[0], v[0]))
        self.mix(11, (v[0] >> 16) * (b % 2**16))
        self.mix(11, product(v[0], element))
        self.mix(11, v[1] + product(v[0], element))
        self.mix(11, sum(product(x, x) for x in v))
        self.mix(11, sum(x * x >> 32 for x in v))
        for x, y in zip(v, (v[2], *v[:2]), strict=True):
            self.mix(11, x - y)

    def line(self, batch: int) -> str:
        return f"{batch} " + " ".join(f"{value:08x}" for value in self.values)


def drawn(state: int) -> Iterator[int]:
    """Marsaglia's xorshift32."""
    while True:
        state ^= state << 13 & WORD
        state ^= state >> 17
        state ^= state << 5 & WORD
        yield state


def expected() -> Iterator[str]:
    hashes = Hashes()
    for a in EDGES:
        for b in EDGES:
            hashes.multiply(a & WORD, b & WORD)
    yield hashes.line(0)
    factors = drawn(0x12345678)
    for batch in range(1, BATCHES + 1):
        for _ in range(BATCH):
            hashes.multiply(next(factors), next(factors))
        yield hashes.line(batch)


@pytest.fixture(scope="module")
def printed(
    root: Path, nano: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[str]:
    """What the program printed, line by line."""
    folder = tmp_path_factory.mktemp("fixed_mul")
    program, record = folder / "program.elf", folder / "record"
    subprocess.run(
        [
            *("avr-gcc", "-mmcu=atmega328p", "-std=gnu11", "-Os"),
            *("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"),
            f"-DBATCHES={BATCHES}",
            *("-I", root / "firmware", "-o", program),
            root / "tests" / "core" / "avr" / "fixed_mul_test.c",
            root / "firmware" / "core" / "math" / "fixed.c",
            root / "firmware" / "avr" / "fixed_mul.S",
        ],
        check=True,
    )
    subprocess.run(
        [
            *(nano, "--image", program, "--record", record),
            *("--fast", "--seconds", str(SECONDS)),
        ],
        check=True,
        capture_output=True,
    )
    return record.read_text(encoding="ascii").splitlines()


def test_the_avr_multiplies_exactly_at_the_edges_and_thousands_of_times_between(
    printed: list[str],
) -> None:
    assert printed[1:] == [*expected(), "done"]


def test_the_avr_multiplies_in_the_cycles_that_the_source_says(
    printed: list[str], root: Path
) -> None:
    source = (root / "firmware" / "avr" / "fixed_mul.S").read_text(encoding="utf-8")
    cycles = printed[0].removeprefix("cycles ").split()
    names = ("fixed_mul_q30", "fixed_mul_q32", "fixed_umul_q32")
    text = ", ".join(f"{name} {n}" for name, n in zip(names, cycles, strict=True))
    assert text in source.replace("\n; ", " ")
