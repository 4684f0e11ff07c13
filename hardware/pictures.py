# SPDX-License-Identifier: MIT
"""Shaded pictures of meshes, by a depth buffer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from hardware.mesh import Floats, Mesh

LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
PAPER = (255, 255, 255)
OVER = 2  # pixels are drawn finer, then averaged
EDGE_STEP = 0.6  # mm of depth between neighbours that counts as an outline
NOWHERE = -1e6  # depth where nothing is
CREASE = 0.9  # cosine between neighbouring faces


@dataclass(frozen=True)
class View:
    """Where one looks from: azimuth about z from x, and height, degrees."""

    azimuth: float
    height: float

    @property
    def matrix(self) -> Floats:
        """Rows: right, up, towards the eye."""
        a, h = np.radians(self.azimuth), np.radians(self.height)
        eye = np.array([np.cos(h) * np.cos(a), np.cos(h) * np.sin(a), np.sin(h)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return np.array([right, np.cross(eye, right), eye])


def render(
    meshes: list[tuple[Mesh, tuple[int, int, int]]],
    view: View,
    size: tuple[int, int],
    scale: float | None = None,
) -> Image.Image:
    """A picture of coloured meshes that fills `size`; `scale`: pixels to the mm."""
    turned = [(mesh.points @ view.matrix.T, mesh, tint) for mesh, tint in meshes]
    everything = np.concatenate([points for points, _, _ in turned])
    low, high = everything.min(axis=0), everything.max(axis=0)
    width, height = size[0] * OVER, size[1] * OVER
    if scale is None:
        scale = 0.94 * min(size[0] / (high[0] - low[0]), size[1] / (high[1] - low[1]))
    scale *= OVER
    middle = (low + high) / 2
    canvas = Canvas(width, height)
    for points, mesh, tint in turned:
        flat = np.empty_like(points)
        flat[:, 0] = width / 2 + scale * (points[:, 0] - middle[0])
        flat[:, 1] = height / 2 - scale * (points[:, 1] - middle[1])
        flat[:, 2] = points[:, 2]
        normals = mesh.normals @ view.matrix.T
        # From above and from the eye, so that undersides are seen, too.
        shade = 0.3 + 0.4 * np.clip(mesh.normals @ LIGHT, 0, 1)
        shade += 0.3 * np.clip(normals[:, 2], 0, 1)
        for corners, normal, bright in zip(
            flat[mesh.triangles], normals, shade, strict=True
        ):
            if normal[2] > 0:
                canvas.fill(corners, normal, bright * np.array(tint))
    canvas.outline()
    picture = Image.fromarray(np.clip(canvas.color, 0, 255).astype(np.uint8))
    return picture.resize(size, Image.Resampling.BOX)


class Canvas:
    """Pixels with the depth and the normal of what is seen in them."""

    def __init__(self, width: int, height: int) -> None:
        self.color = np.full((height, width, 3), PAPER, dtype=np.float64)
        self._depth = np.full((height, width), NOWHERE)
        self._normal = np.zeros((height, width, 3))

    def fill(self, corners: Floats, normal: Floats, tint: Floats) -> None:
        """One triangle: columns, rows, depth."""
        rows, columns = self._depth.shape
        x0, y0 = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int), 0)
        x1, y1 = np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1
        window = (slice(y0, min(y1, rows)), slice(x0, min(x1, columns)))
        y, x = np.mgrid[window] + 0.5
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-9 or x.size == 0:
            return
        v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        z = az + v * (bz - az) + w * (cz - az)
        seen = (v >= -1e-6) & (w >= -1e-6) & (v + w <= 1 + 1e-6)
        seen &= z > self._depth[window]
        self._depth[window][seen] = z[seen]
        self._normal[window][seen] = normal
        self.color[window][seen] = tint

    def outline(self) -> None:
        """Darkens pixels where depth jumps or a face ends."""
        is_line = np.zeros(self._depth.shape, dtype=bool)
        for axis, there in ((0, np.s_[1:, :]), (1, np.s_[:, 1:])):
            before = np.s_[:-1, :] if axis == 0 else np.s_[:, :-1]
            jump = np.abs(np.diff(self._depth, axis=axis)) > EDGE_STEP
            turn = (self._normal[there] * self._normal[before]).sum(axis=2) < CREASE
            is_drawn = np.minimum(self._depth[there], self._depth[before]) > NOWHERE
            is_line[there] |= jump | (turn & is_drawn)
        self.color[is_line] *= 0.6


def beside(pictures: list[Image.Image]) -> Image.Image:
    width = sum(picture.width for picture in pictures)
    height = max(picture.height for picture in pictures)
    whole = Image.new("RGB", (width, height), PAPER)
    x = 0
    for picture in pictures:
        whole.paste(picture, (x, (height - picture.height) // 2))
        x += picture.width
    return whole


def save(picture: Image.Image, path: Path) -> None:
    """A small file: shades of few colours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.quantize(48, dither=Image.Dither.NONE).save(path, optimize=True)
