# SPDX-License-Identifier: MIT
"""A part as triangles: for slicers, checks and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CHORD_MM = 0.02  # how far a triangle may be off a curved face
ANGLE_RAD = 0.2


@dataclass(frozen=True)
class Mesh:
    points: Floats  # one row each
    triangles: Ints  # three indices each, counter-clockwise as seen from outside

    @cached_property
    def corners(self) -> Floats:
        return self.points[self.triangles]

    @cached_property
    def _cross(self) -> Floats:
        a, b, c = (self.corners[:, k] for k in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def areas(self) -> Floats:
        return np.asarray(0.5 * np.linalg.norm(self._cross, axis=1))

    @cached_property
    def normals(self) -> Floats:
        return self._cross / np.maximum(2 * self.areas, 1e-12)[:, None]

    @property
    def volume(self) -> float:
        return float(np.einsum("ij,ij->", self.corners[:, 0], self._cross) / 6)

    def turned(self, matrix: Floats) -> Mesh:
        return Mesh(self.points @ matrix.T, self.triangles)


def of(part: Any, turn: Floats | None = None) -> Mesh:
    """The triangles of a solid; points that faces share are one point."""
    vertices, triangles = part.tessellate(CHORD_MM, ANGLE_RAD)
    raw = np.array([(v.X, v.Y, v.Z) for v in vertices])
    _, first, index = np.unique(
        np.round(raw, 5), axis=0, return_index=True, return_inverse=True
    )
    joined = index.reshape(-1)[np.array(triangles)]
    a, b, c = joined.T
    mesh = Mesh(raw[first], joined[(a != b) & (b != c) & (c != a)])
    return mesh if turn is None else mesh.turned(turn)


def open_edges(mesh: Mesh) -> int:
    """Edges that do not have one triangle on each side: none in a closed surface."""
    t = mesh.triangles
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    size = len(mesh.points)
    ways, counts = np.unique(directed[:, 0] * size + directed[:, 1], return_counts=True)
    back = directed[:, 1] * size + directed[:, 0]
    return int((counts != 1).sum() + (~np.isin(back, ways)).sum())


def depths(mesh: Mesh, origins: Floats, directions: Floats) -> Floats:
    """How far each ray goes until it meets the surface; infinity: never. Triangles that
    the ray passes farther away than they are large are left out.
    """
    middles = mesh.corners.mean(axis=1)
    sizes = np.linalg.norm(mesh.corners - middles[:, None], axis=2).max(axis=1)
    found = np.full(len(origins), np.inf)
    for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        way = middles - origin
        along = way @ direction
        aside = np.einsum("ij,ij->i", way, way) - along**2
        near = (aside <= sizes**2) & (along > -sizes)
        found[k] = _depth(mesh.corners[near], origin, direction)
    return found


def _depth(corners: Floats, origin: Floats, direction: Floats) -> float:
    """Of one ray, by the test of Moeller and Trumbore."""
    a, b, c = (corners[:, k] for k in range(3))
    one, two = b - a, c - a
    p = np.cross(direction, two)
    det = np.einsum("ij,ij->i", one, p)
    usable = np.abs(det) > 1e-12
    inverse = 1 / np.where(usable, det, 1)
    s = origin - a
    u = np.einsum("ij,ij->i", s, p) * inverse
    q = np.cross(s, one)
    v = (q @ direction) * inverse
    t = np.einsum("ij,ij->i", two, q) * inverse
    hit = usable & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 1e-3)
    return float(t[hit].min(initial=np.inf))


def samples(mesh: Mesh, count: int, seed: int) -> tuple[Floats, Floats]:
    """Points spread evenly over the surface, and the normals there."""
    random = np.random.default_rng(seed)
    share = mesh.areas / mesh.areas.sum()
    chosen = random.choice(len(share), size=count, p=share)
    u, v = random.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (mesh.corners[chosen, k] for k in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), mesh.normals[chosen]
