# SPDX-License-Identifier: MIT
"""Chains of nodes with shared parameters: as dense linear algebra solves them."""

from __future__ import annotations

import numpy as np
import pytest

from imud.refine.model import STATE, WHOLE
from imud.refine.rows import COLUMNS, Rows
from imud.refine.solve import Equations, marginal
from imud.rotation import FloatArray

COUNT = 4
SIZE = (COUNT + 1) * STATE + WHOLE


def chain(random: np.random.Generator, count: int = COUNT) -> list[Rows]:
    """Rows that determine all states and parameters."""
    kinds = []
    for _ in range(24):
        slopes = random.standard_normal((count, 3, COLUMNS))
        weight = random.uniform(0.5, 2.0, count)
        away = random.standard_normal((count, 3))
        kinds.append(Rows(away, weight, ((slice(0, COLUMNS), slopes),)))
    return kinds


def dense(kinds: list[Rows], size: int = SIZE) -> tuple[FloatArray, FloatArray]:
    """The same sums in one matrix."""
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for rows in kinds:
        for node in range(len(rows.away)):
            slopes = np.zeros((3, size))
            ((_, values),) = rows.slopes
            first = node * STATE
            slopes[:, first : first + 2 * STATE] = values[node, :, : 2 * STATE]
            slopes[:, -WHOLE:] = values[node, :, 2 * STATE :]
            matrix += rows.weight[node] * slopes.T @ slopes
            right += rows.weight[node] * slopes.T @ rows.away[node]
    return matrix, right


@pytest.fixture(name="kinds")
def _kinds() -> list[Rows]:
    return chain(np.random.default_rng(1))


def equations_of(kinds: list[Rows], some: slice = slice(None)) -> Equations:
    parts = [
        Rows(k.away[some], k.weight[some], ((k.slopes[0][0], k.slopes[0][1][some]),))
        for k in kinds
    ]
    found = Equations(len(parts[0].away))
    found.add(parts, 0)
    return found


def test_a_step_and_its_covariances_are_those_of_the_dense_matrix(
    kinds: list[Rows],
) -> None:
    matrix, right = dense(kinds)
    solution = equations_of(kinds).solved()
    step = -np.linalg.solve(matrix, right)
    assert np.concatenate([solution.step.ravel(), solution.whole_step]) == (
        pytest.approx(step, rel=1e-6)
    )
    inverse = np.linalg.inv(matrix)
    for node, found in enumerate(solution.covariances()):
        own = slice(node * STATE, (node + 1) * STATE)
        assert found == pytest.approx(inverse[own, own], rel=1e-6)
    column = solution.covariance_with(2, 5).ravel()
    assert column == pytest.approx(inverse[:-WHOLE, 2 * STATE + 5], rel=1e-6)


def test_what_came_before_a_node_is_all_in_its_marginal(kinds: list[Rows]) -> None:
    whole = equations_of(kinds).solved()
    before = marginal(equations_of(kinds, slice(2)))
    after = equations_of(kinds, slice(2, None))
    after.add_sums(0, before.matrix, before.right)
    found = after.solved()
    assert found.step == pytest.approx(whole.step[2:], rel=1e-5)
    assert found.whole_step == pytest.approx(whole.whole_step, rel=1e-5)
    assert found.covariances()[1] == pytest.approx(whole.covariances()[3], rel=1e-5)
