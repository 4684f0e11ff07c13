# SPDX-License-Identifier: MIT
"""Linear equations of a chain of nodes that share some parameters.

The chain's matrix is block tridiagonal, and the shared parameters are a border:
Gauss-Newton steps by the Schur complement, as in B. Triggs et al., "Bundle Adjustment -
A Modern Synthesis", 2000, section 6. `Chain` eliminates every second node at once
(D. Heller, "Some Aspects of the Cyclic Reduction Algorithm for Block Tridiagonal Linear
Systems", 1976).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from imud.refine.model import STATE, WHOLE
from imud.refine.rows import ALL, COLUMNS, NEXT, Rows
from imud.rotation import FloatArray


class Equations:
    """The sums of all rows: matrix @ step = -right."""

    def __init__(self, count: int) -> None:
        nodes = count + 1
        self.diagonal = np.zeros((nodes, STATE, STATE))
        self.below = np.zeros((count, STATE, STATE))  # of the next node by this one
        self.border = np.zeros((nodes, STATE, WHOLE))
        self.corner = np.zeros((WHOLE, WHOLE))
        self.right = np.zeros((nodes, STATE))
        self.right_whole = np.zeros(WHOLE)

    def add(self, rows: Iterable[Rows], start: int) -> None:
        """Rows of the intervals from `start` on."""
        kinds = list(rows)
        count = len(kinds[0].away)
        by_kind = np.zeros((count, len(kinds), 3, COLUMNS))
        for index, kind in enumerate(kinds):
            kind.put(by_kind[:, index])
        slopes = by_kind.reshape(count, -1, COLUMNS)
        away = np.concatenate([kind.away for kind in kinds], axis=1)
        weight = np.stack([kind.weight for kind in kinds], axis=1).repeat(3, axis=1)
        weighted = (slopes * weight[..., None]).transpose(0, 2, 1)
        matrix = weighted @ slopes
        right = (weighted @ away[..., None])[..., 0]
        now, then = slice(start, start + count), slice(start + 1, start + 1 + count)
        self.diagonal[now] += matrix[:, :NEXT, :NEXT]
        self.diagonal[then] += matrix[:, NEXT:ALL, NEXT:ALL]
        self.below[now] += matrix[:, NEXT:ALL, :NEXT]
        self.border[now] += matrix[:, :NEXT, ALL:]
        self.border[then] += matrix[:, NEXT:ALL, ALL:]
        self.corner += matrix[:, ALL:, ALL:].sum(axis=0)
        self.right[now] += right[:, :NEXT]
        self.right[then] += right[:, NEXT:ALL]
        self.right_whole += right[:, ALL:].sum(axis=0)

    def add_at(self, node: int, away: FloatArray, slopes: FloatArray) -> None:
        """Whitened rows of one node: slopes (rows, STATE + WHOLE)."""
        matrix, right = slopes.T @ slopes, slopes.T @ away
        self.add_sums(node, matrix, right)

    def add_sums(self, node: int, matrix: FloatArray, right: FloatArray) -> None:
        """Sums of rows of one node: of size STATE + WHOLE."""
        self.diagonal[node] += matrix[:STATE, :STATE]
        self.border[node] += matrix[:STATE, STATE:]
        self.corner += matrix[STATE:, STATE:]
        self.right[node] += right[:STATE]
        self.right_whole += right[STATE:]

    def solved(self) -> Solution:
        """numpy.linalg.LinAlgError where they do not determine a step."""
        return Solution(self)


@dataclass(frozen=True, slots=True)
class Marginal:
    """What is known of a node and of the parameters by all before it: sums of rows."""

    matrix: FloatArray  # (STATE + WHOLE, STATE + WHOLE)
    right: FloatArray


class Solution:
    """The step that solves equations, and its covariance."""

    def __init__(self, equations: Equations) -> None:
        self._chain = Chain(equations.diagonal, equations.below)
        self._border = equations.border
        right = equations.right[..., None]
        found = self._chain.solve(np.concatenate([right, self._border], axis=2))
        of_right, self._of_border = found[..., 0], found[..., 1:]
        schur = equations.corner - _summed(self._border, self._of_border)
        left = equations.right_whole - _summed(self._border, of_right)
        self.whole_covariance = np.linalg.inv(schur)
        self.whole_step = -self.whole_covariance @ left
        self.step = -of_right - self._of_border @ self.whole_step

    def covariances(self) -> FloatArray:
        """Of each node, (nodes, STATE, STATE)."""
        shared = self._of_border
        found, _ = self._chain.inverse()
        return found + shared @ self.whole_covariance @ shared.transpose(0, 2, 1)

    def last_covariance(self) -> FloatArray:
        """Of the last node and of what holds for all, (STATE + WHOLE,) squared."""
        node, _ = self._chain.inverse()
        shared, whole = self._of_border[-1], self.whole_covariance
        across = -shared @ whole
        own = node[-1] - across @ shared.T
        return np.block([[own, across], [across.T, whole]])

    def covariance_with(self, node: int, state: int) -> FloatArray:
        """Of every state with one state of one node, (nodes, STATE)."""
        one = np.zeros((*self.step.shape, 1))
        one[node, state] = 1.0
        found = self._chain.solve(one)[..., 0]
        shared = self.whole_covariance @ _summed(self._border, found)
        return np.asarray(found + self._of_border @ shared)


def _summed(border: FloatArray, columns: FloatArray) -> FloatArray:
    """border^T @ columns, over all nodes."""
    return np.asarray(np.tensordot(border, columns, axes=((0, 1), (0, 1))))


class Chain:
    """The inverse of a positive definite block tridiagonal matrix, by its blocks on the
    diagonal (n, s, s) and below it (n - 1, s, s). numpy.linalg.LinAlgError of another.
    """

    def __init__(self, diagonal: FloatArray, below: FloatArray) -> None:
        is_one = len(diagonal) == 1
        odd = diagonal if is_one else diagonal[1::2]
        # With ones on their diagonals they lose less by rounding.
        scale = 1.0 / np.sqrt(np.diagonal(odd, axis1=1, axis2=2))
        scales = scale[:, :, None] * scale[:, None, :]
        root = np.linalg.inv(np.linalg.cholesky(odd * scales))
        self._odd = root.transpose(0, 2, 1) @ root * scales
        self._even: Chain | None = None
        if is_one:
            return
        # What ties an odd node to the one before and to the one after it, if any.
        self._before, self._after = below[0::2], below[1::2].transpose(0, 2, 1)
        self._both = len(self._after)
        self._by_before = self._odd @ self._before
        self._by_after = self._odd[: self._both] @ self._after
        even = diagonal[0::2].copy()
        even[: len(odd)] -= self._before.transpose(0, 2, 1) @ self._by_before
        even[1:] -= self._after.transpose(0, 2, 1) @ self._by_after
        by_both = self._by_before[: self._both]
        self._even = Chain(even, -self._after.transpose(0, 2, 1) @ by_both)

    def solve(self, columns: FloatArray) -> FloatArray:
        """The inverse times columns (n, s, any)."""
        if self._even is None:
            return np.asarray(self._odd @ columns)
        odd, even = self._odd @ columns[1::2], columns[0::2].copy()
        even[: len(odd)] -= self._before.transpose(0, 2, 1) @ odd
        even[1:] -= self._after.transpose(0, 2, 1) @ odd[: self._both]
        even = self._even.solve(even)
        odd -= self._by_before @ even[: len(odd)]
        odd[: self._both] -= self._by_after @ even[1:]
        found = np.empty_like(columns)
        found[0::2], found[1::2] = even, odd
        return found

    def inverse(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the inverse, on the diagonal and below it."""
        if self._even is None:
            return self._odd, self._odd[:0]
        even, between = self._even.inverse()
        before, after, both = self._by_before, self._by_after, self._both
        with_before = -before @ even[: len(before)]
        with_before[:both] -= after @ between
        with_after = -before[:both] @ between.transpose(0, 2, 1) - after @ even[1:]
        odd = self._odd - with_before @ before.transpose(0, 2, 1)
        odd[:both] -= with_after @ after.transpose(0, 2, 1)
        found = np.empty((len(even) + len(odd), *even.shape[1:]))
        found[0::2], found[1::2] = even, odd
        below = np.empty((len(found) - 1, *even.shape[1:]))
        below[0::2], below[1::2] = with_before, with_after.transpose(0, 2, 1)
        return found, below


def marginal(equations: Equations) -> Marginal:
    """Of the last node, where no row of it but of the interval before was added."""
    border = equations.border
    chain = Chain(equations.diagonal[:-1], equations.below[:-1])
    coupling = np.zeros((len(border) - 1, STATE, STATE + WHOLE))
    coupling[-1, :, :STATE] = equations.below[-1].T
    coupling[..., STATE:] = border[:-1]
    right = equations.right[:-1, :, None]
    found = chain.solve(np.concatenate([right, coupling], axis=2))
    matrix = np.zeros((STATE + WHOLE, STATE + WHOLE))
    matrix[:STATE, :STATE] = equations.diagonal[-1]
    matrix[:STATE, STATE:] = border[-1]
    matrix[STATE:, :STATE] = border[-1].T
    matrix[STATE:, STATE:] = equations.corner
    whole = np.concatenate([equations.right[-1], equations.right_whole])
    return Marginal(
        matrix - _summed(coupling, found[..., 1:]),
        whole - _summed(coupling, found[..., 0]),
    )
