# SPDX-License-Identifier: MIT
"""Every function of fixed.h that is exact against exact integers, to the bounds that
fixed.h promises. test_fixed_approximations.py has the others."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import native
from core import desk
from core.desk import INT32_MAX, INT32_MIN

# The products as the firmware has them, not the guarded ones of the desk.
ffi, lib = native.load()

EDGES = sorted(
    {
        sign * (2**bits + off)
        for bits in (0, 1, 2, 14, 15, 16, 28, 29, 30, 31)
        for off in (-1, 0, 1)
        for sign in (-1, 1)
        if INT32_MIN <= sign * (2**bits + off) <= INT32_MAX
    }
)
UNSIGNED_EDGES = sorted(
    {
        2**bits + off
        for bits in range(33)
        for off in (-2, -1, 0, 1, 2)
        if 0 <= 2**bits + off < 2**32
    }
)

int32s = st.integers(INT32_MIN, INT32_MAX) | st.sampled_from(EDGES)
uint32s = st.integers(0, 2**32 - 1) | st.sampled_from(UNSIGNED_EDGES)


def nearest(numerator: int, bits: int) -> int:
    """numerator / 2^bits, ties towards +infinity."""
    return (2 * numerator + 2**bits) // 2 ** (bits + 1)


def fits(value: int) -> bool:
    return INT32_MIN <= value <= INT32_MAX


def held(value: int) -> int:
    return max(INT32_MIN, min(INT32_MAX, value))


def test_products_of_all_edges_equal_exact_integers():
    pairs = [(a, b) for a, b in product(EDGES, EDGES) if fits(nearest(a * b, 30))]
    assert (INT32_MIN, 2**30) in pairs
    assert (INT32_MIN, INT32_MIN) not in pairs
    for a, b in pairs:
        assert lib.fixed_mul_q30(a, b) == nearest(a * b, 30), (a, b)
    for a, b in product(EDGES, EDGES):
        assert lib.fixed_mul_q32(a, b) == nearest(a * b, 32), (a, b)
    for a, b in product(UNSIGNED_EDGES, UNSIGNED_EDGES):
        assert lib.fixed_umul_q32(a, b) == a * b >> 32, (a, b)


def test_the_largest_product_that_fits_32_bits_is_exact():
    assert nearest(INT32_MAX * 2**30, 30) == INT32_MAX
    assert lib.fixed_mul_q30(INT32_MAX, 2**30) == INT32_MAX
    assert lib.fixed_mul_q30(2**30, INT32_MAX) == INT32_MAX
    assert lib.fixed_mul_q30(INT32_MIN, 2**30) == INT32_MIN
    assert lib.fixed_mul_q30(INT32_MAX, -(2**30)) == -INT32_MAX


def test_products_round_ties_towards_plus_infinity():
    for odd in (1, 3, 5, 2**20 + 1, 2**30 - 1):
        assert lib.fixed_mul_q30(odd, 2**29) == (odd + 1) // 2
        assert lib.fixed_mul_q30(-odd, 2**29) == (1 - odd) // 2
        assert lib.fixed_mul_q30(2**29, -odd) == (1 - odd) // 2
    for odd in (1, 3, 5, 2**20 + 1):
        assert lib.fixed_mul_q32(odd * 2**8, 2**23) == (odd + 1) // 2
        assert lib.fixed_mul_q32(-odd * 2**8, 2**23) == (1 - odd) // 2


@given(int32s, st.integers(-(2**15), 2**15 - 1), int32s)
def test_a_product_with_an_element_is_rounded_and_may_be_added(value, element, before):
    exact = nearest(value * element, 14)
    if not fits(exact):
        return
    assert lib.fixed_mul_q14(value, element) == exact
    if fits(before + exact):
        total = ffi.new("int32_t *", before)
        lib.fixed_add_product(value, element, total)
        assert total[0] == before + exact


@given(int32s)
def test_a_square_is_the_product_with_itself(value):
    if fits(nearest(value * value, 30)):
        assert lib.fixed_square_q30(value) == nearest(value * value, 30)


@given(int32s, st.integers(1, 255))
def test_a_quotient_is_rounded_towards_zero(value, divisor):
    exact = abs(value) // divisor
    assert lib.fixed_divide(value, divisor) == (exact if value > 0 else -exact)


@given(int32s, int32s)
def test_products_of_any_numbers_equal_exact_integers(a, b):
    if fits(nearest(a * b, 30)):
        assert lib.fixed_mul_q30(a, b) == nearest(a * b, 30)
    assert lib.fixed_mul_q32(a, b) == nearest(a * b, 32)
    assert lib.fixed_umul_q32(a % 2**32, b % 2**32) == (a % 2**32) * (b % 2**32) >> 32


@given(st.tuples(*[int32s] * 3), st.tuples(*[st.integers(-(2**15), 2**15 - 1)] * 3))
def test_a_row_times_a_vector_is_rounded_once(v, m):
    exact = nearest(sum(a * b for a, b in zip(v, m, strict=True)), 14)
    if fits(exact):
        assert lib.fixed_dot3_q14(v, m) == exact


def test_a_row_times_a_vector_is_exact_at_its_edges():
    edges = (-(2**15), -1, 0, 1, 2**14, 2**15 - 1)
    large = (INT32_MIN, -(2**30), -1, 0, 8191, 8192, 2**30, INT32_MAX)
    checked = 0
    for v in product(large, repeat=3):
        for m in product(edges, repeat=3):
            exact = nearest(sum(a * b for a, b in zip(v, m, strict=True)), 14)
            if fits(exact):
                checked += 1
                assert lib.fixed_dot3_q14(v, m) == exact, (v, m)
    assert checked > 10_000
    # Ties go towards +infinity.
    assert lib.fixed_dot3_q14((8192, 0, 0), (1, 0, 0)) == 1
    assert lib.fixed_dot3_q14((0, 8192, 0), (0, -1, 0)) == 0


def test_loops_over_arrays_call_the_functions_they_are_named_after():
    a, b = np.array([7, -5, INT32_MAX], np.int32), np.array([2**29] * 3, np.int32)
    for name in ("mul_q30", "mul_q32"):
        out = desk.mapped(getattr(desk.lib, f"loop_{name}"), a, b)
        wanted = [
            getattr(lib, f"fixed_{name}")(*pair) for pair in zip(a, b, strict=True)
        ]
        assert out.tolist() == wanted
    unsigned = [array.astype(np.uint32) for array in (a, b)]
    out = desk.mapped(desk.lib.loop_umul_q32, *unsigned, dtype=np.uint32)
    assert out.tolist() == [
        lib.fixed_umul_q32(*pair) for pair in zip(*unsigned, strict=True)
    ]


@pytest.mark.parametrize(
    ("call", "is_sound"),
    [
        ("fixed_mul_q30(2**31 - 1, 2**30)", True),
        ("fixed_mul_q30(2**31 - 1, 2**30 + 1)", False),
        ("fixed_mul_q30(-(2**31), 2**30 + 1)", False),
    ],
)
def test_where_the_other_tests_work_a_product_beyond_32_bits_ends_the_process(
    call, is_sound
):
    script = f"from core.desk import lib; lib.{call}; print('survived')"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=native.environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode == 0) == is_sound, done.stderr
    assert ("leaves 32 bits" in done.stderr) != is_sound


@given(int32s, st.integers(0, INT32_MAX))
def test_a_clamp_holds_the_value_within_plus_and_minus_the_limit(value, limit):
    assert lib.fixed_clamp(value, limit) == max(-limit, min(limit, value))


def test_a_clamp_holds_the_most_negative_number():
    assert lib.fixed_clamp(INT32_MIN, INT32_MAX) == -INT32_MAX
    assert lib.fixed_clamp(INT32_MIN, 0) == 0


@given(int32s, st.integers(0, 2**15 - 1))
def test_a_limit_may_be_given_by_its_upper_half(value, high):
    limit = high * 2**16
    assert lib.fixed_clamp_high(value, high) == max(-limit, min(limit, value))


@given(
    st.integers(-(2**30), 2**30),
    st.integers(-(2**30), 2**30 - 1),
    st.integers(0, 2**15 - 1),
)
def test_a_number_in_memory_is_added_to_and_subtracted_from(before, step, high):
    limit = high * 2**16
    number = ffi.new("int32_t *", before)
    lib.fixed_add(step, number)
    assert number[0] == before + step
    lib.fixed_subtract(step, number)
    assert number[0] == before
    lib.fixed_add_clamped_high(step, high, number)
    assert number[0] == max(-limit, min(limit, before + step))
    number[0] = before
    lib.fixed_add_clamped(step, limit + 1, number)
    assert number[0] == max(-limit - 1, min(limit + 1, before + step))


def test_a_number_times_a_factor_fits_up_to_the_ends_of_32_bits():
    for value, factor in ((32768, 65535), (-32768, 65535), (INT32_MIN, 1), (7, 0)):
        assert lib.fixed_times(value, factor) == value * factor


def test_magnitude_is_exact_even_for_the_most_negative_number():
    for value in EDGES:
        assert lib.fixed_magnitude(value) == abs(value)
    assert lib.fixed_magnitude(INT32_MIN) == 2**31


@given(int32s, st.integers(0, 31))
def test_scaling_up_multiplies_by_a_power_of_two(value, bits):
    if fits(value * 2**bits):
        assert lib.fixed_scale_up(value, bits) == value * 2**bits


@given(uint32s, st.integers(0, 31))
def test_scaling_up_may_be_held_at_the_end_of_the_range(value, bits):
    assert lib.fixed_scale_up_sat(value, bits) == held(value * 2**bits)


@given(int32s, st.integers(1, 30))
def test_scaling_down_rounds_to_nearest_ties_up(value, bits):
    if fits(value + 2 ** (bits - 1)):
        assert lib.fixed_scale_down(value, bits) == nearest(value, bits)


@pytest.mark.parametrize("bits", range(1, 31))
def test_scaling_down_is_exact_where_its_rounding_just_fits(bits):
    largest = INT32_MAX - 2 ** (bits - 1)
    for value in (largest, largest - 1, INT32_MIN, INT32_MIN + 1):
        assert lib.fixed_scale_down(value, bits) == nearest(value, bits)


def test_halves_are_rounded_down():
    for value in EDGES:
        assert lib.fixed_half_floor(value) == value // 2


@given(int32s, int32s)
def test_angles_wrap_at_half_a_turn(a, b):
    assert lib.turn32_add(a, b) == (a + b + 2**31) % 2**32 - 2**31


def test_half_a_turn_and_a_step_is_minus_half_a_turn():
    assert lib.turn32_add(INT32_MAX, 1) == INT32_MIN


def ratio_is_floored(numerator: int, denominator: int) -> bool:
    return bool(
        lib.fixed_ratio(numerator, denominator) == numerator * 2**30 // denominator
    )


def test_ratios_at_their_limits_are_floored():
    for denominator in (1, 2, 3, 2**15, 2**30, 2**31 - 1, 2**31):
        for numerator in (0, 1, denominator - 1, denominator, 2 * denominator - 1):
            assert ratio_is_floored(numerator, denominator), (numerator, denominator)


@given(st.integers(1, 2**31), st.data())
def test_a_ratio_below_two_is_floored(denominator, data):
    assert ratio_is_floored(data.draw(st.integers(0, 2 * denominator - 1)), denominator)


def test_roots_are_floored_at_every_edge():
    roots = [0, 1, 2, 3, 255, 256, 2**15, 2**16 - 2, 2**16 - 1]
    squares = {root**2 + off for root in roots for off in (-1, 0, 1)}
    for x in {x for x in squares if x >= 0} | set(UNSIGNED_EDGES):
        assert lib.fixed_sqrt(x) == math.isqrt(x), x


@given(uint32s)
def test_any_root_is_floored(x):
    assert lib.fixed_sqrt(x) == math.isqrt(x)


@given(uint32s.filter(bool))
def test_leading_zeros_are_counted(x):
    assert lib.fixed_leading_zeros(x) == 32 - x.bit_length()


def test_leading_zeros_are_counted_at_every_edge():
    for x in UNSIGNED_EDGES[1:]:
        assert lib.fixed_leading_zeros(x) == 32 - x.bit_length()
