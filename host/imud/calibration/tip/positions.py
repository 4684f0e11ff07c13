# SPDX-License-Identifier: MIT
"""The tip from known positions of the sensor: from a tracker, or a rule. Section 9 of
the thesis, and least squares.

While the tip stays in one place, the sensor is at `p = c - R r`: on a sphere about the
tip. While an upright probe is turned about itself, the sensor is on a circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.affine import MethodError
from imud.calibration.algebra import across, units
from imud.rotation import FloatArray

ROUNDS = 50
CLOSE_M = 1e-9  # a step of Gauss-Newton after which it is done
# Factor of sigma, as errors of attitudes differ between directions.
UNEVEN = 1.1
CAP = 0.1  # of the radius: with larger errors the sphere is not known at all
FLAT = 1e-3  # smallest over largest extent of points that show a sphere, or a circle


@dataclass(frozen=True, slots=True)
class Offset:
    """The tip from the sensor in the body, and one-sigma of each axis, m."""

    offset_m: FloatArray
    sigma_m: FloatArray
    residual_m: float  # rms of a coordinate


@dataclass(frozen=True, slots=True)
class Ball:
    """A sphere. `sigma_m`: of its radius."""

    centre: FloatArray
    radius: float
    sigma_m: float
    residual_m: float


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle in space. `normal` points up; its sigma is for each way it can lean."""

    centre: FloatArray
    radius: float
    normal: FloatArray
    normal_sigma_rad: float
    radius_sigma_m: float


def pivot(places: FloatArray, attitudes: FloatArray, error_m: float) -> Offset:
    """The offset from places (n, 3) and attitudes (n, 3, 3), world_from_body, of the
    sensor while the tip stays where it is. `error_m`: one-sigma of a coordinate, which
    grows if the residual is larger. MethodError: they do not show it.
    """
    count = len(places)
    if count < 3:
        raise MethodError(f"{count} poses are too few: give 3 or more")
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))
    slopes = np.concatenate([eye, -attitudes], axis=2).reshape(-1, 6)
    if np.linalg.svd(slopes, compute_uv=False)[-1] < 0.02 * math.sqrt(count):
        raise MethodError("the attitudes are too similar: lean it in two directions")
    found = np.linalg.lstsq(slopes, places.ravel(), rcond=None)[0]
    left = places.ravel() - slopes @ found
    error = max(error_m, _spread(left, 3 * count - 6))
    sigma = UNEVEN * error * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    return Offset(found[3:], sigma[3:], float(np.sqrt(np.mean(left**2))))


def _spread(left: FloatArray, freedom: int) -> float:
    return math.sqrt(float(left @ left) / freedom) if freedom > 0 else 0.0


def _round(near: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Centre, radius and slopes of the sphere or the circle with the least squares of
    distances, for points (n, 3) or (n, 2) around 0. It begins with the algebraic fit,
    which is biased on a cap.
    """
    ones = np.ones(len(near))
    slopes = np.column_stack([2.0 * near, ones])
    start = np.linalg.lstsq(slopes, (near**2).sum(axis=1), rcond=None)[0]
    centre, square = start[:-1], start[-1] + start[:-1] @ start[:-1]
    radius = math.sqrt(max(float(square), 1e-12))
    for _ in range(ROUNDS):
        away = near - centre
        distance = np.linalg.norm(away, axis=1)
        slopes = np.column_stack([-away / distance[:, None], -ones])
        change = np.linalg.lstsq(slopes, radius - distance, rcond=None)[0]
        centre, radius = centre + change[:-1], radius + float(change[-1])
        if np.linalg.norm(change) < CLOSE_M:
            break
    return centre, radius, slopes


def sphere(places: FloatArray, error_m: float) -> Ball:
    """The sphere with the least squares of distances; four points lie on theirs."""
    if len(places) < 4:
        raise MethodError(f"{len(places)} points are too few for a sphere: give 4")
    middle = places.mean(axis=0)
    near = places - middle
    extent = np.linalg.svd(near, compute_uv=False)
    if extent[-1] < FLAT * extent[0]:
        raise MethodError("the points lie in a plane: lean the probe in two directions")
    centre, radius, slopes = _round(near)
    left = np.linalg.norm(near - centre, axis=1) - radius
    error = max(error_m, _spread(left, len(near) - 4))
    sigma = error * math.sqrt(float(np.linalg.inv(slopes.T @ slopes)[3, 3]))
    rms = float(np.sqrt(np.mean(left**2)))
    if sigma > CAP * radius:
        raise MethodError("the points show too little of a sphere: lean it further")
    return Ball(centre + middle, radius, sigma, rms)


def circle(places: FloatArray, error_m: float) -> Circle:
    """The circle of least squares in the plane of least squares; three points lie on
    theirs.
    """
    if len(places) < 3:
        raise MethodError(f"{len(places)} points are too few for a circle: give 3")
    middle = places.mean(axis=0)
    near = places - middle
    _, extent, axes = np.linalg.svd(near, full_matrices=False)
    if extent[1] < FLAT * extent[0]:
        raise MethodError("the points lie on a line: turn the probe further")
    normal = np.cross(axes[0], axes[1])
    normal = normal if normal[2] >= 0.0 else -normal
    flat = near @ axes[:2].T
    centre, radius, slopes = _round(flat)
    left = np.linalg.norm(flat - centre, axis=1) - radius
    above = near @ normal
    error = max(error_m, _spread(left, len(flat) - 3), _spread(above, len(flat) - 3))
    # The plane leans by the error over the extent, most about the longer axis.
    covariance = error**2 * np.linalg.inv(slopes.T @ slopes)
    return Circle(
        middle + centre @ axes[:2],
        radius,
        np.asarray(normal),
        error / float(extent[1]),
        math.sqrt(float(covariance[2, 2])),
    )


@dataclass(frozen=True, slots=True)
class ProbeAxis:
    """The probe's axis in the body, a unit vector, and how far it may lean each way."""

    axis: FloatArray
    sigma_rad: float


def axis_of(found: Circle, attitudes: FloatArray) -> ProbeAxis:
    """The axis from attitudes (n, 3, 3) along the circle. In a full turn an error of
    the normal comes from all sides of the body, and cancels.
    """
    seen = np.einsum("kji,j->ki", attitudes, found.normal)
    axis = units(seen.mean(axis=0))
    own = math.sqrt(float(seen.var(axis=0).sum()) / 2.0 / len(seen))
    return ProbeAxis(
        axis, math.hypot(own, found.normal_sigma_rad * _bias(axis, attitudes))
    )


def _bias(axis: FloatArray, attitudes: FloatArray) -> float:
    """The remaining share of an error of the world in the mean over the attitudes: 1
    without a turn, 0 in a full one.
    """
    return float(np.linalg.norm((attitudes @ across(axis)).mean(axis=0)))


def tip_below(
    found: Circle,
    places: FloatArray,
    attitudes: FloatArray,
    distance_m: float,
    distance_sigma_m: float,
) -> Offset:
    """The offset of a tip that is `distance_m` from the sensor, as the thesis has it:
    below the middle of the circle. MethodError: it is nearer than the circle is wide.
    """
    if distance_m <= found.radius:
        raise MethodError(
            f"the circle's radius is {1000.0 * found.radius:.1f} mm, more than the "
            f"tip's distance of {1000.0 * distance_m:.1f} mm"
        )
    below = math.sqrt(distance_m**2 - found.radius**2)
    tip = found.centre - below * found.normal
    offsets = np.einsum("kji,kj->ki", attitudes, tip - places)
    axis = axis_of(found, attitudes)
    along = math.hypot(
        distance_m * distance_sigma_m, found.radius * found.radius_sigma_m
    )
    spread = float(offsets.var(axis=0).mean()) / len(places)
    aside = 2.0 * (below * axis.sigma_rad) ** 2 + (along / below) ** 2
    sigma = math.sqrt(aside / 3.0 + spread)
    left = offsets - offsets.mean(axis=0)
    return Offset(
        offsets.mean(axis=0), np.full(3, sigma), float(np.sqrt(np.mean(left**2)))
    )
