# SPDX-License-Identifier: MIT
"""Where the tip is, from a wobble about it while it stands in a dimple.

The sensor is at `R r` from the tip, with `r` constant in the body: the force that it
feels is the second derivative of that, and gravity. Integrated over blocks of 50 ms
this needs the rate at the ends of each block, but no derivative of it. The equations
are linear in r, gravity, the two biases, the gyroscope's scales and the delay of the
accelerometer, but for the attitude, which is integrated again in each pass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.algebra import integrated, skew, turn
from imud.calibration.recording import IntArray
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

BLOCK_S = 0.05
# The first pass finds r and gravity, without which the biases do nothing.
PASSES = (3, 8)
TURNED_RAD = 1e-4  # less than this over the whole wobble needs no further pass
PARTS = 8  # stretches that are left out in turn
LEAST_BLOCKS = 8 * PARTS

# Columns of the equations. Those of a base that gives are for a test only.
R, G, ACC, GYR, SCALE, LAG = (slice(i, i + 3) for i in range(0, 18, 3))
LAG = slice(15, 16)
UNKNOWNS, GIVES, ALL = 16, slice(16, 18), 18

# One-sigma values of the priors, beside the calibration's own.
BIAS_RAD_S = math.radians(1.0)  # the gyroscope's, after its rest was subtracted
LAG_S = 0.005
GRAVITY_SIGMA_M_S2 = 0.003 * GRAVITY_M_S2
FREE_M, FREE_M_S2 = 1.0, 100.0

# Of a sample. A quieter module's residual is motion between samples: with its own noise
# its wobbles are refused as slips, 23 of 25 with an LSM6DSV.
NOISE_M_S2 = (0.02, 0.2)
# By so much noise is stronger at low frequencies than between two samples: 520 ug/rtHz
# of real rests of an MPU-9250, whose data sheet says 300.
RED = 1.3


@dataclass(frozen=True, slots=True)
class Trust:
    """One-sigma errors of the calibrated readings."""

    acc_m_s2: float = 0.2  # bias
    gyr: float = 0.01  # scale, a fraction
    share: float = 0.015  # of the offset's length that is unsure for all they leave


@dataclass(frozen=True, slots=True)
class DimpleFit:
    """The result of a wobble."""

    offset_m: FloatArray  # of the tip from the sensor, body frame
    sigma_m: FloatArray  # of each axis, by the noise and by how stretches differ
    residual_m_s2: float  # rms of a block
    noise_m_s2: float  # that it would have if the tip stood still
    give: float  # how surely the base gives: a chi-square of two unknowns
    give_sigma: float  # one sigma of the share of the way by which it gives
    gravity_m_s2: float
    unknowns: FloatArray  # all of them


@dataclass(frozen=True, slots=True)
class _Blocks:
    """The integrals of the readings in the equations, along one attitude, (m, ...)
    each.
    """

    seconds: float
    force: FloatArray  # integral of R f
    turned: FloatArray  # integral of R
    swept: FloatArray  # integral of the integral of R since the beginning
    scaled: FloatArray  # of R diag(w)
    lagged: FloatArray  # [R f] - integral of R (w x f)
    start: FloatArray  # R at the beginning
    end: FloatArray
    rate_start: FloatArray
    rate_end: FloatArray
    step: FloatArray  # [R f]

    def __len__(self) -> int:
        return len(self.force)


def fit(
    force: FloatArray,
    rate: FloatArray,
    step_s: float,
    trust: Trust | None = None,
    before: DimpleFit | None = None,
) -> DimpleFit | None:
    """The offset of the tip, from calibrated readings (n, 3) in m/s2 and rad/s at a
    constant rate; None if there are too few. `before`: of the same wobble so far, which
    saves passes.
    """
    trust = trust or Trust()
    size = max(2, round(BLOCK_S / step_s))
    if len(force) // size < LEAST_BLOCKS:
        return None
    noise = noise_of(force) / math.sqrt(size)
    found = np.zeros(ALL) if before is None else before.unknowns
    rows, left = np.zeros((0, 3, ALL)), np.zeros((0, 3))
    least = PASSES[0] if before is None else 2  # residuals are of the last
    for number in range(PASSES[1]):
        true = rate - found[GYR] + rate * found[SCALE]
        blocks = _blocks(force, true, step_s, size)
        rows, left = _equations(blocks, found)
        change = _change(found, rows, left, noise * blocks.seconds, trust)
        found = found + change
        turned = float(np.linalg.norm(change[GYR])) * len(rate) * step_s
        if number + 1 >= least and turned < TURNED_RAD:
            break
    return _judged(found, rows, left, noise, size * step_s, trust)


def noise_of(force: FloatArray) -> float:
    """The accelerometer's noise at the low frequencies of a wobble, as of a sample,
    m/s2: by second differences, in which slow motion is nothing.
    """
    second = force[2:] - 2.0 * force[1:-1] + force[:-2]
    # The median is that of a normal variable's magnitude; passing knocks do not count.
    white = float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6.0)
    return float(np.clip(RED * white, *NOISE_M_S2))


def _blocks(force: FloatArray, rate: FloatArray, step_s: float, size: int) -> _Blocks:
    count = len(force) // size
    used = count * size
    force, rate = force[: used + 1], rate[: used + 1]
    attitude = integrated(rate[:used], step_s)
    middle, ends = attitude[:-1] @ turn(0.5 * step_s * rate[:used]), attitude[::size]

    def summed(values: FloatArray) -> FloatArray:
        parts = values.reshape(count, size, *values.shape[1:])
        return np.asarray(parts.sum(axis=1) * step_s)

    edges = np.arange(0, used + 1, size)
    rate_at, force_at = _between(rate, edges), _between(force, edges)
    turned = np.einsum("tij,tj->ti", middle, force[:used])
    across = np.cross(rate[:used], force[:used])
    step = np.diff(np.einsum("kij,kj->ki", ends, force_at), axis=0)
    since, scaled = middle * step_s, middle * rate[:used, None, :] * step_s
    return _Blocks(
        size * step_s,
        summed(turned),
        summed(middle),
        summed(np.cumsum(since, axis=0) - 0.5 * since),
        summed(np.cumsum(scaled, axis=0) - 0.5 * scaled),
        step - summed(np.einsum("tij,tj->ti", middle, across)),
        ends[:-1],
        ends[1:],
        rate_at[:-1],
        rate_at[1:],
        step,
    )


def _between(values: FloatArray, edges: IntArray) -> FloatArray:
    """The values at the beginning of steps of which they are the means."""
    after = values[np.minimum(edges, len(values) - 1)]
    before = values[np.maximum(edges - 1, 0)]
    return 0.5 * (before + after)


def _equations(blocks: _Blocks, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes (m, 3, ALL) of the integrated force, and its residuals, (m, 3)."""
    r, gravity = at[R], at[G]
    eye = np.broadcast_to(np.eye(3), (len(blocks), 3, 3))
    rows = np.zeros((len(blocks), 3, ALL))
    # The sensor's velocity by r, and by an error of the rate.
    end, start = (
        blocks.end @ skew(blocks.rate_end),
        blocks.start @ skew(blocks.rate_start),
    )
    rows[:, :, R] = end - start
    rows[:, :, G] = eye * blocks.seconds
    rows[:, :, ACC] = blocks.turned
    turn_end, turn_start = blocks.end @ skew(r), blocks.start @ skew(r)
    rows[:, :, GYR] = turn_end - turn_start - skew(gravity) @ blocks.swept
    rows[:, :, SCALE] = skew(gravity) @ blocks.scaled - (
        turn_end * blocks.rate_end[:, None, :]
        - turn_start * blocks.rate_start[:, None, :]
    )
    rows[:, :, 15] = -blocks.lagged
    # The base yields along the sensor's deflection, in phase and with its speed.
    up = gravity / max(float(np.linalg.norm(gravity)), 1e-9)
    level = np.eye(3) - np.outer(up, up)
    rows[:, :, 16] = (end - start) @ r @ level
    rows[:, :, 17] = blocks.step @ level
    predicted = rows[:, :, :9] @ at[:9] + rows[:, :, 15] * at[15]
    return rows, blocks.force - predicted


def _spread(trust: Trust) -> FloatArray:
    """One-sigma values of the unknowns before; all are expected to be 0."""
    sigma = np.ones(ALL)
    sigma[R], sigma[G], sigma[ACC] = FREE_M, FREE_M_S2, trust.acc_m_s2
    sigma[GYR], sigma[SCALE], sigma[LAG] = BIAS_RAD_S, trust.gyr, LAG_S
    return sigma


def _change(
    found: FloatArray,
    rows: FloatArray,
    left: FloatArray,
    sigma: float,
    trust: Trust,
) -> FloatArray:
    """A Gauss-Newton step of the unknowns, with their priors."""
    slopes = rows[:, :, :UNKNOWNS].reshape(-1, UNKNOWNS) / sigma
    prior = _spread(trust)[:UNKNOWNS] ** -2.0
    normal = slopes.T @ slopes + np.diag(prior)
    right = slopes.T @ left.ravel() / sigma
    right -= prior * found[:UNKNOWNS]
    gravity = found[G]
    length = float(np.linalg.norm(gravity))
    if length > 0.5 * GRAVITY_M_S2:
        along = np.zeros(UNKNOWNS)
        along[G] = gravity / length / GRAVITY_SIGMA_M_S2
        normal += np.outer(along, along)
        right += along * (GRAVITY_M_S2 - length) / GRAVITY_SIGMA_M_S2
    change = np.zeros(ALL)
    change[:UNKNOWNS] = np.linalg.solve(normal, right)
    return change


def _judged(
    found: FloatArray,
    rows: FloatArray,
    left: FloatArray,
    noise: float,
    seconds: float,
    trust: Trust,
) -> DimpleFit:
    """The errors of the offset: by the noise, and by leaving out stretches."""
    slopes, errors = rows / (noise * seconds), left / (noise * seconds)
    prior = np.diag(_spread(trust) ** -2.0)
    parts = np.array_split(np.arange(len(rows)), PARTS)
    normals = np.array([_normal(slopes[part]) for part in parts])
    rights = np.array([_right(slopes[part], errors[part]) for part in parts])
    normal, right = normals.sum(axis=0), rights.sum(axis=0)
    usual = slice(0, UNKNOWNS)
    covariance = np.linalg.inv((normal + prior)[usual, usual])
    chi = max(1.0, float(np.mean(errors**2)))
    others = np.array(
        [
            np.linalg.solve((normal - n + prior)[usual, usual], (right - r)[usual])[R]
            for n, r in zip(normals, rights, strict=True)
        ]
    )
    jackknife = np.sqrt((PARTS - 1) * others.var(axis=0))
    white = np.sqrt(chi * np.diag(covariance)[R])
    return DimpleFit(
        -found[R],
        np.maximum(white, jackknife),
        float(np.sqrt(np.mean(left**2))) / seconds,
        noise,
        *_give(normal + prior, right, chi),
        float(np.linalg.norm(found[G])),
        found,
    )


def _normal(slopes: FloatArray) -> FloatArray:
    flat = slopes.reshape(-1, ALL)
    return np.asarray(flat.T @ flat)


def _right(slopes: FloatArray, errors: FloatArray) -> FloatArray:
    return np.asarray(slopes.reshape(-1, ALL).T @ errors.ravel())


def _give(normal: FloatArray, right: FloatArray, chi: float) -> tuple[float, float]:
    """How much better a yielding base explains the residual: chi-square of two
    unknowns; and the sigma of its share.
    """
    inverse = np.linalg.inv(normal)
    give, covariance = (inverse @ right)[GIVES], inverse[GIVES, GIVES] * chi
    better = float(give @ np.linalg.solve(covariance, give))
    return better, float(np.sqrt(covariance[0, 0]))
