# SPDX-License-Identifier: MIT
"""Shared by the fits: cross-product matrices, integrated turns, symmetric matrices."""

from __future__ import annotations

import numpy as np

from imud import rotation
from imud.rotation import FloatArray

MEDIAN = 1.538  # of the length of three normal variables, in their sigma


def skew(vectors: FloatArray) -> FloatArray:
    """Matrices of shape (..., 3, 3) that multiply as `vectors` cross does."""
    x, y, z = rotation.components(vectors)
    found = np.zeros((*vectors.shape, 3))
    found[..., 0, 1], found[..., 0, 2] = -z, y
    found[..., 1, 0], found[..., 1, 2] = z, -x
    found[..., 2, 0], found[..., 2, 1] = -y, x
    return found


def turn(vector: FloatArray) -> FloatArray:
    """Rotation matrices of rotation vectors, rad."""
    return rotation.to_matrix(rotation.from_rotation_vector(vector))


def integrated(rate: FloatArray, step_s: float) -> FloatArray:
    """Attitudes at the beginning of each step and after the last, as matrices of shape
    (n + 1, 3, 3), world_from_body; the first is the identity. `rate` in rad/s.
    """
    turned = np.concatenate(
        [rotation.IDENTITY[None], rotation.from_rotation_vector(rate * step_s)]
    )
    reach = 1
    while reach < len(turned):  # after each round an entry spans `2 reach` steps
        turned[reach:] = rotation.multiply(turned[:-reach], turned[reach:])
        reach *= 2
    return rotation.to_matrix(turned)


def onto(start: FloatArray, end: FloatArray) -> FloatArray:
    """The rotation matrix of the smallest turn from one unit vector to another."""
    normal = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(normal)), float(start @ end)
    if sine < 1e-12:
        if cosine > 0.0:
            return np.eye(3)
        return turn(across(start) * np.pi)
    return turn(normal / sine * np.arctan2(sine, cosine))


def across(vector: FloatArray) -> FloatArray:
    """A unit vector at right angles to a vector."""
    return units(np.cross(vector, np.eye(3)[np.argmin(np.abs(vector))]))


def units(vectors: FloatArray) -> FloatArray:
    """The same directions with length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def closest_turn(matrix: FloatArray) -> FloatArray:
    """The rotation matrix that is nearest to a matrix of positive determinant."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def symmetric(six: FloatArray) -> FloatArray:
    """The symmetric matrix of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def symmetric_slopes(vectors: FloatArray) -> FloatArray:
    """Derivatives of symmetric(six) @ vector by the six: shape (..., 3, 6)."""
    zero = np.zeros(vectors.shape[:-1])
    x, y, z = np.moveaxis(vectors, -1, 0)
    rows = [[x, zero, zero, y, z, zero], [zero, y, zero, x, zero, z]]
    rows.append([zero, zero, z, zero, x, y])
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def row_slopes(vectors: FloatArray) -> FloatArray:
    """Derivatives of matrix @ vector by the nine entries, rows first: shape (..., 3,
    9).
    """
    slopes = np.zeros((*vectors.shape[:-1], 3, 9))
    for row in range(3):
        slopes[..., row, 3 * row : 3 * row + 3] = vectors
    return slopes


def spread(random: np.random.Generator, count: int) -> FloatArray:
    """Attitudes as matrices, each as likely as any other."""
    quats = random.standard_normal((count, 4))
    return rotation.to_matrix(units(quats))


def triple(vector: FloatArray) -> tuple[float, float, float]:
    """A vector (3,) as plain numbers."""
    x, y, z = map(float, vector)
    return x, y, z
