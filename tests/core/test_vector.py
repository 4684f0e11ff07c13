# SPDX-License-Identifier: MIT
"""Vectors of fixed point against numpy's doubles, up to the limits of vector.h."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core import desk
from core.desk import INT32_MAX, INT32_MIN, ONE, ffi, lib

components = st.integers(-INT32_MAX, INT32_MAX)


def vector(*xyz: int) -> object:
    return ffi.new("struct vector *", xyz)


def normalised(v: desk.Array) -> tuple[desk.Array, desk.Array]:
    unit, norm = np.zeros_like(v), np.zeros(len(v), np.int32)
    desk.call(lib.loop_normalise, len(v), v, unit, norm)
    return unit, norm


def assert_normalised(v: desk.Array) -> None:
    unit, norm = normalised(v)
    length = desk.norms(v)
    assert desk.norms(unit / ONE - v / length[:, None]).max() < 7e-8
    held = np.minimum(length, INT32_MAX)
    assert (np.abs(norm - held) <= 1 + 7e-8 * held).all()


def test_directions_are_within_7e_8_whatever_the_length():
    random = np.random.default_rng(1)
    length = 2.0 ** random.uniform(2, 31.5, (200_000, 1))
    v = np.round(desk.unit_rows(random, len(length), 3) * length)
    v = np.clip(v, -INT32_MAX, INT32_MAX).astype(np.int32)
    assert_normalised(v[v.any(axis=1)])


def test_every_small_vector_has_its_direction_and_length():
    small = np.array(list(product(range(-9, 10), repeat=3)), np.int32)
    assert_normalised(small[small.any(axis=1)])


def test_a_vector_along_an_axis_is_that_axis():
    for axis, length in product(range(3), (1, 2, 3, 1000, 2**30 - 1, 2**30, INT32_MAX)):
        for sign in (1, -1):
            v = np.zeros((1, 3), np.int32)
            v[0, axis] = sign * length
            unit, norm = normalised(v)
            wanted = np.zeros(3)
            wanted[axis] = sign
            assert np.abs(unit[0] / ONE - wanted).max() < 7e-8
            assert abs(int(norm[0]) - length) <= 1 + 7e-8 * length


def test_vectors_at_the_edges_of_the_range_are_normalised():
    edges = [0, 1, -1, 2**15, 2**29, -(2**30), 2**30 - 1, INT32_MAX, -INT32_MAX]
    v = np.array(list(product(edges, repeat=3)), np.int32)
    assert_normalised(v[v.any(axis=1)])


def test_a_length_beyond_the_range_is_held_at_its_end():
    for v in ((INT32_MAX, 1 << 20, 0), (INT32_MAX,) * 3, (-INT32_MAX, 0, INT32_MAX)):
        _, norm = normalised(np.array([v], np.int32))
        assert norm[0] == INT32_MAX


def test_only_a_zero_vector_has_the_length_0_and_it_stays_as_it_is():
    v = vector(0, 0, 0)
    assert lib.vector_normalise(v) == 0
    assert (v.x, v.y, v.z) == (0, 0, 0)
    for shortest in ((1, 0, 0), (0, -1, 0), (0, 0, 1)):
        assert lib.vector_normalise(vector(*shortest)) == 1


def test_a_vector_is_normalised_and_its_length_told():
    v = vector(3000, -4000, 12000)
    assert lib.vector_normalise(v) == 13000
    for found, part in zip((v.x, v.y, v.z), (3, -4, 12), strict=True):
        assert abs(found - part / 13 * ONE) < 7e-8 * ONE + 1


@given(components, components, components)
def test_any_vector_is_normalised(x, y, z):
    if x or y or z:
        assert_normalised(np.array([[x, y, z]], np.int32))


def test_squares_as_q30_are_within_2_steps_up_to_their_limit():
    random = np.random.default_rng(2)
    radius = 2**30.5 * (1 - 1e-8)  # the square is 2 less a few steps
    rows = np.round(desk.unit_rows(random, 100_000, 3) * radius)
    v = rows.astype(np.int32)
    square = desk.mapped(lib.loop_square_q30, v)
    assert np.abs(square - (v.astype(float) ** 2).sum(axis=1) / ONE).max() <= 2
    assert square.max() > INT32_MAX - 2**6


def test_squares_as_q32_fit_for_every_vector_and_are_at_most_3_steps_low():
    random = np.random.default_rng(3)
    corners = np.array(list(product((INT32_MIN, INT32_MAX, 0), repeat=3)))
    some = random.integers(INT32_MIN, INT32_MAX, (20_000, 3), endpoint=True)
    v = np.concatenate([corners, some]).astype(np.int32)
    squares = desk.mapped(lib.loop_square_q32, v, dtype=np.uint32)
    for row, square in zip(v.tolist(), squares.tolist(), strict=True):
        exact = sum(component**2 for component in row)
        assert square * 2**32 <= exact < (square + 3) * 2**32
    assert squares.max() == 3 * 2**30


@given(components, components, components, st.integers(-(2**30), 2**30))
def test_a_scaled_vector_is_the_rounded_product_also_in_place(x, y, z, gain):
    v, out = vector(x, y, z), vector()
    lib.vector_scale(v, gain, out)
    lib.vector_scale(v, gain, v)
    wanted = tuple((c * gain + 2**29) >> 30 for c in (x, y, z))
    assert (out.x, out.y, out.z) == wanted
    assert (v.x, v.y, v.z) == wanted


def test_differences_are_exact_up_to_the_ends_of_the_range_also_in_place():
    a, b, out = vector(INT32_MAX, -1, -7), vector(0, INT32_MAX, -9), vector()
    lib.vector_subtract(a, b, out)
    assert (out.x, out.y, out.z) == (INT32_MAX, INT32_MIN, 2)
    lib.vector_subtract(a, b, b)
    assert (b.x, b.y, b.z) == (INT32_MAX, INT32_MIN, 2)


def test_a_clamp_holds_each_component_also_in_place():
    v, out = vector(INT32_MIN, 5, INT32_MAX), vector()
    lib.vector_clamp(v, 100, out)
    lib.vector_clamp(v, 100, v)
    assert (out.x, out.y, out.z) == (-100, 5, 100)
    assert (v.x, v.y, v.z) == (-100, 5, 100)


def test_a_vector_exceeds_a_limit_where_one_component_is_above_it():
    for axis, sign in product(range(3), (1, -1)):
        at, above = [0, 0, 0], [0, 0, 0]
        at[axis], above[axis] = sign * 100, sign * 101
        assert not lib.vector_exceeds(vector(*at), 100)
        assert lib.vector_exceeds(vector(*above), 100)
    assert lib.vector_exceeds(vector(0, INT32_MIN, 0), INT32_MAX)
    assert not lib.vector_exceeds(vector(-INT32_MAX, 0, INT32_MAX), INT32_MAX)


ends = st.integers(-(2**29), 2**29)


@given(st.tuples(ends, ends, ends), st.tuples(ends, ends, ends))
def test_a_cross_product_is_of_rounded_products(a, b):
    out = vector()
    lib.vector_cross(vector(*a), vector(*b), out)
    made = [[(x * y + 2**29) >> 30 for y in b] for x in a]
    assert (out.x, out.y, out.z) == tuple(
        made[j][k] - made[k][j] for j, k in ((1, 2), (2, 0), (0, 1))
    )
