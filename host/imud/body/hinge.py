# SPDX-License-Identifier: MIT
"""Where a joint's axis and its centre are, in the frames of the probes beside it.

T. Seel, J. Raisch, T. Schauer, IMU-Based Joint Angle Measurement for Gait Analysis,
Sensors 14(4):6891, 2014.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.rotation import FloatArray

ROWS = 600  # samples that a fit uses at most
ROWS_MIN = 20  # and at least
ROUNDS = 30
# A motion that turns less than this about the axis (rms) is refused.
EXCITATION_MIN = math.radians(20.0)
# So is one whose rates across the axis differ by more than this share of the rate.
RESIDUAL_MAX = 0.35
FORCE_MIN_M_S2 = 0.8  # rms of the force that turning adds, for a centre
CENTRE_RESIDUAL_MAX = 0.6
INDEPENDENT_S = 0.5  # residuals of a limb resemble each other for this long


class AlignmentRefused(Exception):
    """A motion that shows too little; the text says what to do."""


@dataclass(frozen=True, slots=True)
class HingeAxis:
    """A hinge: unit vectors in the frames of the parent's and the child's probe."""

    parent: FloatArray
    child: FloatArray
    residual: float  # of the rates across the axis, a share of the rates
    sigma_rad: float  # of either direction


@dataclass(frozen=True, slots=True)
class Centre:
    """A joint's centre, m, from each probe in its frame."""

    parent: FloatArray
    child: FloatArray
    residual: float  # of forces at the centre, a share of the force that turning adds
    sigma_m: float


def axis(
    parent: FloatArray,
    child: FloatArray,
    rate_hz: float,
    residual_max: float = RESIDUAL_MAX,
) -> HingeAxis:
    """The axis from two gyroscopes, rad/s, (n, 3) each at the same times.

    Across the axis both turn equally fast, whatever the angle. Signs are arbitrary.
    Raises AlignmentRefused.
    """
    fast = np.linalg.norm(parent, axis=1) + np.linalg.norm(child, axis=1)
    order = np.sort(np.argsort(fast)[-min(len(fast), 4 * ROWS) :])
    rows = order[:: max(1, len(order) // ROWS)]
    if len(rows) < ROWS_MIN:
        raise AlignmentRefused("too few samples; move for a few seconds")
    first, second = parent[rows], child[rows]
    # From each of the main directions of both: a limb may turn more than its joint.
    tried = [
        _fitted(first, second, np.concatenate([one, other]))
        for one in _mains(first)
        for other in _mains(second)
    ]
    both = min(tried, key=lambda each: each[0])[1]
    error, _ = _across(first, second, both)
    moved = float(np.sqrt((first**2).sum(axis=1).mean() + (second**2).sum(1).mean()))
    residual = float(np.sqrt((error**2).mean())) / max(moved, 1e-9)
    if moved < EXCITATION_MIN:
        raise AlignmentRefused(
            f"it turned at {math.degrees(moved):.0f} deg/s; bend it faster and further"
        )
    if residual > residual_max:
        raise AlignmentRefused(
            f"no hinge fits: the residual is {100 * residual:.0f} % of the rates"
        )
    # Each probe's axis is seen by how fast it turns about it itself.
    own = min(
        float(((first @ both[:3]) ** 2).mean()), ((second @ both[3:]) ** 2).mean()
    )
    independent = max(1.0, len(parent) / rate_hz / INDEPENDENT_S)
    play = float((error**2).mean())
    sigma = math.sqrt(play / max(own, 1e-6) / independent)
    return HingeAxis(both[:3], both[3:], residual, min(sigma, math.pi / 2))


def _across(
    parent: FloatArray, child: FloatArray, both: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """|g1 x j1| - |g2 x j2| of each row, and its slope by j1 and j2."""
    errors, slopes = [], []
    for rates, axis_, sign in ((parent, both[:3], 1.0), (child, both[3:], -1.0)):
        cross = np.cross(rates, axis_)
        size = np.maximum(np.sqrt((cross * cross).sum(axis=1)), 1e-6)
        errors.append(sign * size)
        slopes.append(sign * np.cross(cross, rates) / size[:, None])
    return errors[0] + errors[1], np.concatenate(slopes, axis=1)


def _mains(rates: FloatArray) -> FloatArray:
    """Three directions in rows, the one about which it turns most last."""
    return np.asarray(np.linalg.eigh(rates.T @ rates)[1].T)


def _fitted(
    parent: FloatArray, child: FloatArray, both: FloatArray
) -> tuple[float, FloatArray]:
    """The mean of the error, and both axes, from a first guess."""
    cost = np.inf
    for _ in range(ROUNDS):
        error, slope = _across(parent, child, both)
        scale = max(1.5 * float(np.median(np.abs(error))), 1e-9)
        weight = 1.0 / np.maximum(1.0, np.abs(error) / scale)
        normal = slope.T @ (weight[:, None] * slope) + 1e-9 * len(error) * np.eye(6)
        step = np.linalg.solve(normal, slope.T @ (weight * error))
        both = both - step
        both = np.concatenate([_unit(both[:3]), _unit(both[3:])])
        now = float((weight * error**2).sum())
        if abs(cost - now) < 1e-9 * max(now, 1e-12):
            break
        cost = now
    return float(np.abs(_across(parent, child, both)[0]).mean()), both


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def centre(
    parent: tuple[FloatArray, FloatArray],
    child: tuple[FloatArray, FloatArray],
    rate_hz: float,
) -> Centre:
    """The centre from rates (rad/s) and specific forces (m/s2) of two probes.

    The force at the centre is as large in both. Raises AlignmentRefused.
    """
    terms = [levers(gyr, rate_hz) for gyr, _ in (parent, child)]
    rows = slice(2, -2, max(1, len(parent[0]) // (2 * ROWS)))
    forces = [acc[rows] for _, acc in (parent, child)]
    arms = [each[rows] for each in terms]
    both = np.full(6, 0.05)
    for _ in range(ROUNDS):
        error, slope = _forces(forces, arms, both)
        scale = max(1.5 * float(np.median(np.abs(error))), 1e-9)
        weight = 1.0 / np.maximum(1.0, np.abs(error) / scale)
        # A weak prior at 10 cm keeps directions that the motion does not show near the
        # probe.
        normal = slope.T @ (weight[:, None] * slope) + 10.0 * np.eye(6)
        step = np.linalg.solve(normal, slope.T @ (weight * error) + 10.0 * both)
        both = both - step
        if np.abs(step).max() < 1e-6:
            break
    error, slope = _forces(forces, arms, both)
    added = [each @ part for each, part in zip(arms, (both[:3], both[3:]), strict=True)]
    excitation = float(np.sqrt(np.mean([(each**2).sum(1).mean() for each in added])))
    if excitation < FORCE_MIN_M_S2:
        raise AlignmentRefused(
            f"turning changes forces by only {excitation:.1f} m/s2; move it faster"
        )
    residual = float(np.sqrt((error**2).mean())) / excitation
    if residual > CENTRE_RESIDUAL_MAX:
        raise AlignmentRefused(
            f"no centre fits: the residual is {100 * residual:.0f} % of the forces"
        )
    independent = max(1.0, len(parent[0]) / rate_hz / INDEPENDENT_S)
    spread = np.linalg.inv(slope.T @ slope / len(error) + 1e-9 * np.eye(6))
    sigma = math.sqrt(float((error**2).mean() * np.diag(spread).max() / independent))
    return Centre(both[:3], both[3:], residual, sigma)


def levers(gyr: FloatArray, rate_hz: float) -> FloatArray:
    """Matrices (n, 3, 3), 1/s2, that take a place in the probe's frame to the force
    that turning adds there.
    """
    change = np.gradient(gyr, 1.0 / rate_hz, axis=0)
    square = gyr[:, :, None] * gyr[:, None, :]
    square = square - np.eye(3) * (gyr**2).sum(axis=1)[:, None, None]
    x, y, z = change.T
    none = np.zeros_like(x)
    cross = np.array([[none, -z, y], [z, none, -x], [-y, x, none]])
    return np.asarray(np.moveaxis(cross, 2, 0) + square)


def _forces(
    forces: list[FloatArray], levers: list[FloatArray], both: FloatArray
) -> tuple[FloatArray, FloatArray]:
    errors, slopes = [], []
    parts = (both[:3], both[3:])
    for force, lever, place, sign in zip(
        forces, levers, parts, (1.0, -1.0), strict=True
    ):
        there = force + lever @ place
        size = np.maximum(np.linalg.norm(there, axis=1), 1e-6)
        errors.append(sign * size)
        along = np.einsum("ni,nij->nj", there, lever)
        slopes.append(sign * along / size[:, None])
    return errors[0] + errors[1], np.concatenate(slopes, axis=1)
