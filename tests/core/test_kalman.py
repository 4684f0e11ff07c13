# SPDX-License-Identifier: MIT
"""Scalar readings of small Kalman filters against doubles, and at their bounds."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import ONE, ffi, lib
from length import choose

ROW = 2.0**14  # q2_14
SUM_MAX = 2**28  # of the variances


def packed(matrix: desk.Array) -> list[int]:
    rows, columns = np.tril_indices(len(matrix))
    return np.rint(matrix[rows, columns]).astype(int).tolist()


def unpacked(pairs: object, states: int) -> desk.Array:
    matrix = np.zeros((states, states))
    rows, columns = np.tril_indices(states)
    matrix[rows, columns] = [pairs[i] for i in range(len(rows))]
    return matrix + np.tril(matrix, -1).T


def read(pairs: object, states: int, row: desk.Array, noise: int) -> desk.Array:
    """Changes the covariance and returns the gains."""
    gain = ffi.new("q2_30_t[]", lib.KALMAN_STATES)
    padded = np.zeros(lib.KALMAN_STATES, int)
    padded[:states] = np.rint(row * ROW)
    lib.kalman_read(pairs, states, padded.tolist(), noise, gain)
    return np.array(list(gain))[:states] / ONE


def covariance_of(random: np.random.Generator, states: int, size: float) -> desk.Array:
    """Any covariance whose variances add up to `size`, well conditioned or not."""
    spread = np.exp(random.uniform(-6, 0, states))
    factor = random.standard_normal((states, states)) * spread
    matrix = factor @ factor.T
    return matrix / np.trace(matrix) * size


def row_of(random: np.random.Generator, states: int) -> desk.Array:
    return desk.unit_rows(random, 1, states)[0] * random.uniform(0.1, 1.8)


@pytest.mark.parametrize("states", [1, 4, 6, 7])
def test_gains_and_covariance_are_those_of_doubles(states):
    random = np.random.default_rng(states)
    for _ in range(400):
        size = float(np.exp(random.uniform(np.log(1e5), np.log(SUM_MAX))))
        before = covariance_of(random, states, size)
        noise = int(np.exp(random.uniform(np.log(1e4), np.log(2**29))))
        row = np.rint(row_of(random, states) * ROW) / ROW
        pairs = ffi.new("int32_t[]", packed(before))
        before = unpacked(pairs, states)
        shared = before @ row
        spread = row @ shared + noise
        if spread > 2**30 - 1:
            continue
        gains = shared / spread
        is_forgotten = np.abs(gains) > 1
        if (np.abs(np.abs(gains) - 1) < 1e-6).any():
            continue  # either way
        gains[is_forgotten] = 0
        found = read(pairs, states, row, noise)
        # Rounding of `shared`, a step, over the spread, and of the gain itself.
        assert np.abs(found - gains).max() < 4 / spread + 1e-8
        apart = np.eye(states, dtype=bool)
        is_kept = apart | ~(is_forgotten[:, None] | is_forgotten[None, :])
        after = np.where(is_kept, before - np.outer(gains, shared), 0)
        assert np.abs(unpacked(pairs, states) - after).max() < 8 + 1e-7 * size


def test_a_state_that_is_forgotten_keeps_its_variance():
    before = covariance_of(np.random.default_rng(3), 7, SUM_MAX)
    pairs = ffi.new("int32_t[]", packed(before))
    known = unpacked(pairs, 7)
    variance = lib.kalman_forget(pairs, 7, 4)
    assert variance == pairs + lib.kalman_variance(4)
    found = unpacked(pairs, 7)
    assert found[4, 4] == known[4, 4]
    assert (np.delete(found[4], 4) == 0).all()
    others = np.ix_([0, 1, 2, 3, 5, 6], [0, 1, 2, 3, 5, 6])
    assert (found[others] == known[others]).all()


@pytest.mark.parametrize("first", [0, 3])
def test_three_variances_wander_up_to_a_limit_and_nothing_else_changes(first):
    before = [10, 1, 2**20 - 50, 1, 1, 2**20, *range(100, 115), 5]
    pairs = ffi.new("int32_t[]", before)
    lib.kalman_wander(pairs, first, 70, 2**20 // 2**16)
    for place, value in enumerate(pairs):
        is_one = place in [lib.kalman_variance(first + i) for i in range(3)]
        assert value == (min(before[place] + 70, 2**20) if is_one else before[place])


def test_the_indices_of_variances():
    assert [lib.kalman_variance(a) for a in range(7)] == [0, 2, 5, 9, 14, 20, 27]
    assert lib.KALMAN_PAIRS == 28


@pytest.mark.parametrize("noise", [1, 2**20, 2**29, 2**30 - 2])
def test_the_largest_variances_and_rows_fit(noise):
    for signs in range(64):
        sign = np.array([1 if signs >> bit & 1 else -1 for bit in range(6)])
        whole = SUM_MAX / 6 * np.outer(sign, sign)  # six states that move as one
        pairs = ffi.new("int32_t[]", packed(whole))
        gains = read(pairs, 6, sign * 1.8 / np.sqrt(6), noise)
        assert np.abs(gains).max() <= 1
        assert (np.diag(unpacked(pairs, 6)) >= 1).all()


def test_a_covariance_that_is_none_is_survived():
    random = np.random.default_rng(7)
    for _ in range(300):
        wrong = random.uniform(-1, 1, (6, 6)) * SUM_MAX / 6
        pairs = ffi.new("int32_t[]", packed(wrong))
        gains = read(pairs, 6, row_of(random, 6), int(random.integers(1, 2**29)))
        assert np.abs(gains).max() <= 1


@pytest.mark.long
def test_a_covariance_stays_one_over_thousands_of_readings():
    # As the filter of the fields does: variances wander up, readings bring them down.
    random = np.random.default_rng(8)
    pairs = ffi.new("int32_t[]", packed(np.eye(6) * 2.0**19))
    turns = desk.unit_rows(random, 200, 4)
    for count in range(choose(everyday=25_000, long=100_000)):
        w, x, y, z = turns[count % 200]
        rows = (
            (
                1,
                0,
                0,
                1 - 2 * (y * y + z * z),
                2 * (x * y - w * z),
                2 * (x * z + w * y),
            ),
            (
                0,
                1,
                0,
                2 * (x * y + w * z),
                1 - 2 * (x * x + z * z),
                2 * (y * z - w * x),
            ),
        )
        for state in range(6):
            pairs[lib.kalman_variance(state)] += 1
        read(pairs, 6, np.array(rows[count % 2], float), 2**21)
    eigenvalues = np.linalg.eigvalsh(unpacked(pairs, 6))
    assert eigenvalues.min() > -10
    assert eigenvalues.max() < 2**21
