# SPDX-License-Identifier: MIT
"""How far a sensor has moved between two rests, by what came before and after.

Forces less gravity are integrated from rest to rest. A hand that rests sways: its
speed at both ends is a Gaussian process, whose length its turning shows, and whose size
turning and forces show. Each size and length counts by how well it explains both rests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.refine.model import ACC, ACC_BIAS, GRAVITY, GYR
from imud.refine.rests import smooth
from imud.refine.strapdown import products
from imud.refine.window import Window
from imud.rotation import FloatArray

WINDOW_S = 0.1  # a period of a hand's tremor: its mean has little of it
REST_S, REST_LEAST = 2.0, 2  # used on each side: most, and windows
LAG_S = 0.01  # of differences that show a chip's noise
QUIET_M_S2, QUIET_RAD_S = 0.6, 0.35
TREMOR_HZ = np.linspace(8.0, 12.0, 9)
# A hand that rests moves in proportion to how it turns: m, and what it always does.
LEVER_M, SPEED_LEAST = 0.15, 1e-4
OCTAVES = (-2.0, -1.0, 0.0, 1.0, 2.0)  # of its speed: one is one sigma
LENGTHS_S = (0.15, 0.2, 0.3, 0.4)  # of its sway
ROUGH = 0.05  # share of a turning's variance that is no sway
LEVEL_M_S2, DRIFT_RAD_S = 0.1, math.radians(0.03)  # of force and of turning, at rest
GYR_WHITE = math.radians(0.01)  # rad/s/sqrt(Hz)
FLOOR_M = 1e-4


@dataclass(frozen=True, slots=True)
class Moved:
    """Metres in the world: east, north, up, and one-sigma errors."""

    way: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class Piece:
    """A stroke with a rest before and after it, in samples of its own."""

    rate_hz: float
    each: int  # samples in a window
    before: int  # windows of the rests
    after: int
    first: int  # sample of the stroke, and the one after its last
    last: int
    forces: FloatArray  # (n, 3), world, less gravity
    turning: FloatArray  # (n, 3), rad/s
    angle: float  # by which it was turned in all

    @property
    def seconds(self) -> float:
        return (self.last - self.first) / self.rate_hz

    def rests(self) -> Iterator[slice]:
        """Windows of the rests, the earliest first."""
        for count, end in ((self.before, self.first), (self.after, None)):
            start = self.last if end is None else end - count * self.each
            for at in range(start, start + count * self.each, self.each):
                yield slice(at, at + self.each)


def moved(
    window: Window, quats: FloatArray, stroke: tuple[int, int], free: tuple[int, int]
) -> Moved | None:
    """The displacement in the samples of `stroke`, begun and ended at rest. `free`: the
    samples in which no other one is. None: there are no such rests.
    """
    try:
        with np.errstate(all="ignore"):
            piece = _piece(window, quats, stroke, free)
            found = None if piece is None else _of_piece(window, piece)
    except np.linalg.LinAlgError:
        return None
    return found if found is not None and np.isfinite(found.sigma).all() else None


def _of_piece(window: Window, piece: Piece) -> Moved:
    rows, weights = _observed(piece)
    slopes, noise = _slopes(piece), _noise(piece, weights)
    sigmas = np.sqrt(np.diag(window.solution.whole_covariance))
    acc, gyr = (float(sigmas[of].max()) for of in (ACC_BIAS, GYR))
    ways, variances, logs = [], [], []
    for sway in _sways(piece):
        prior = _prior(piece, sway, acc, gyr)
        way, variance, log = _solved(rows, slopes, noise, prior)
        ways.append(way)
        variances.append(variance)
        logs.append(log + sway.log)
    share = np.exp(np.array(logs) - max(logs))
    share /= share.sum()
    way = share @ np.array(ways)
    variance = share @ (np.array(variances) + (np.array(ways) - way) ** 2)
    variance += FLOOR_M**2 + (acc / GRAVITY_M_S2) ** 2 * (way @ way)
    return Moved(way, np.sqrt(variance))


def _piece(
    window: Window, quats: FloatArray, stroke: tuple[int, int], free: tuple[int, int]
) -> Piece | None:
    recording, estimate = window.recording, window.estimate
    each = round(WINDOW_S * recording.rate_hz)
    most = round(REST_S / WINDOW_S)
    begin, end = stroke
    start = max(free[0], begin - (most + 1) * each, 0)
    stop = min(free[1], end + (most + 1) * each, len(window.course.rates))
    if min(begin - start, stop - end) < (REST_LEAST + 1) * each:
        return None
    some = slice(start, stop)
    rates = window.course.rates[some]
    steps = rotation.from_rotation_vector(rates / recording.rate_hz)
    halves = rotation.from_rotation_vector(0.5 * rates / recording.rate_hz)
    # By the gyroscope alone: what the estimate has turned unseen may be the stroke.
    nodes = rotation.multiply(quats[start], products(steps, is_left=False))
    true = (recording.acc[some] - estimate.whole[ACC_BIAS]) @ estimate.matrix(ACC).T
    forces = rotation.rotate(rotation.multiply(nodes[:-1], halves), true)
    forces[:, 2] -= estimate.whole[GRAVITY]
    first, last = begin - start, end - start
    turned = rotation.to_rotation_vector(
        rotation.multiply(nodes[last], rotation.inverse(nodes[first]))
    )
    before = _quiet(forces[:first][::-1], rates[:first][::-1], each)
    after = _quiet(forces[last:], rates[last:], each)
    if min(before, after) < REST_LEAST:
        return None
    return Piece(
        recording.rate_hz,
        each,
        before,
        after,
        first,
        last,
        forces,
        rates,
        float(np.linalg.norm(turned)),
    )


def _quiet(forces: FloatArray, rates: FloatArray, each: int) -> int:
    """How many windows from the first on are at rest; one more is there."""
    count = len(forces) // each - 1
    means = forces[: count * each].reshape(count, each, 3).mean(axis=1)
    turns = rates[: count * each].reshape(count, each, 3)
    like = means[:REST_LEAST].mean(axis=0)
    is_quiet = np.linalg.norm(means - like, axis=1) < QUIET_M_S2
    is_quiet &= np.sqrt((turns**2).mean(axis=(1, 2))) < QUIET_RAD_S
    return count if is_quiet.all() else int(np.argmin(is_quiet))


def _observed(piece: Piece) -> tuple[FloatArray, FloatArray]:
    """What is observed: mean forces of the rests' windows, the stroke's change of speed
    and its way without the speed at its begin, (rows, 3); and the weights of the
    forces in each, (rows, n).
    """
    step_s = 1.0 / piece.rate_hz
    rests = [*piece.rests()]
    weights = np.zeros((len(rests) + 2, len(piece.forces)))
    for row, rest in enumerate(rests):
        weights[row, rest] = 1.0 / piece.each
    inside = slice(piece.first, piece.last)
    weights[-2, inside] = step_s
    left_s = (np.arange(piece.last - piece.first, 0.0, -1.0) - 0.5) * step_s
    weights[-1, inside] = step_s * left_s
    # Means over a window of place and speed: a tremor is not in them.
    mean = np.full(piece.each, 1.0 / piece.each)
    weights = np.array([np.convolve(row, mean, "same") for row in weights])
    return weights @ piece.forces, weights


@dataclass(frozen=True, slots=True)
class Sway:
    """How a hand at rest may move."""

    speed: float  # m/s rms of an axis
    length_s: float
    log: float  # of its likelihood


def _sways(piece: Piece) -> Iterator[Sway]:
    """All, as the turning in both rests allows them."""
    means = np.array([piece.turning[rest].mean(axis=0) for rest in piece.rests()])
    parts = [means[: piece.before], means[piece.before :]]
    parts = [part - part.mean(axis=0) for part in parts]
    usual = math.sqrt(sum(float((part**2).sum()) for part in parts) / means.size)
    for length_s in LENGTHS_S:
        log, square = 0.0, 1e-20
        for part in parts:
            known = _alike(len(part), length_s) + ROUGH * np.eye(len(part))
            square += float((part * np.linalg.solve(known, part)).sum())
            log -= 1.5 * float(np.linalg.slogdet(known)[1])
        log -= 0.5 * means.size * math.log(square)
        speed = math.hypot(LEVER_M * usual, SPEED_LEAST)
        for octaves in OCTAVES:
            yield Sway(speed * 2.0**octaves, length_s, log - 0.5 * octaves**2)


def _alike(count: int, length_s: float) -> FloatArray:
    """Correlations of speeds a window apart, of a place that has a normal correlation
    of that length.
    """
    at = np.arange(count) * WINDOW_S / length_s
    off2 = (at[:, None] - at[None]) ** 2
    return np.asarray((1.0 - off2) * np.exp(-0.5 * off2))


# Unknown behind the speeds at the windows' edges: the way, the force at rest, its
# drift, and what the stroke has added to it.
WAY, REST, DRIFT, ADDED = -4, -3, -2, -1


def _slopes(piece: Piece) -> FloatArray:
    """What is observed by what is unknown."""
    before, after, seconds = piece.before, piece.after, piece.seconds
    found = np.zeros((before + after + 2, before + after + 6))
    for row in range(before + after):
        is_after = row >= before
        at = row + is_after
        found[row, [at, at + 1]] = -1.0 / WINDOW_S, 1.0 / WINDOW_S
        middle_s = (row - before + 0.5) * WINDOW_S + seconds * is_after
        found[row, [REST, DRIFT, ADDED]] = 1.0, middle_s, is_after
    gained, way = found[-2], found[-1]
    gained[[before + 1, before]] = 1.0, -1.0
    gained[[REST, DRIFT, ADDED]] = seconds, seconds**2 / 2, seconds / 2
    way[[WAY, before]] = 1.0, -seconds
    way[[REST, DRIFT, ADDED]] = seconds**2 / 2, seconds**3 / 6, seconds**2 / 6
    return found


def _prior(piece: Piece, sway: Sway, acc: float, gyr: float) -> FloatArray:
    """Covariance of what is unknown, of a level axis, m and s."""
    edges = piece.before + piece.after + 2
    found = np.zeros((edges + 4, edges + 4))
    start = 0
    for count in (piece.before + 1, piece.after + 1):
        some = slice(start, start + count)
        found[some, some] = sway.speed**2 * _alike(count, sway.length_s)
        start += count
    found[WAY, WAY], found[REST, REST] = 1.0, LEVEL_M_S2**2
    found[DRIFT, DRIFT] = (GRAVITY_M_S2 * DRIFT_RAD_S) ** 2
    found[ADDED, ADDED] = piece.angle**2 * ((GRAVITY_M_S2 * gyr) ** 2 + acc**2) + 1e-12
    return found


def _solved(
    rows: FloatArray, slopes: FloatArray, noise: FloatArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """The way, its variances, and the logarithm of how likely the rows are. No tilt
    moves the force along the vertical.
    """
    ways, variances, log = np.zeros(3), np.zeros(3), 0.0
    for axes, drift, added in (([0, 1], 1.0, 1.0), ([2], 0.0, 0.0)):
        known = prior.copy()
        known[DRIFT, DRIFT] = drift * prior[DRIFT, DRIFT] + 1e-12
        known[ADDED, ADDED] = added * prior[ADDED, ADDED] + 1e-12
        spread = slopes @ known @ slopes.T + noise
        gain = np.linalg.solve(spread, slopes @ known[:, WAY])
        ways[axes] = gain @ rows[:, axes]
        variances[axes] = known[WAY, WAY] - gain @ slopes @ known[:, WAY]
        off = rows[:, axes]
        log -= 0.5 * float((off * np.linalg.solve(spread, off)).sum())
        log -= 0.5 * len(axes) * float(np.linalg.slogdet(spread)[1])
    return ways, variances, log


def _noise(piece: Piece, weights: FloatArray) -> FloatArray:
    """Covariance of the rows by the chip's noise, a hand's tremor, and the gyroscope's
    noise, which tilts the force.
    """
    each, lag = piece.each, max(1, round(LAG_S * piece.rate_hz))
    white2 = fast2 = 0.0
    starts = (piece.first - piece.before * each, piece.last)
    for start, count in zip(starts, (piece.before, piece.after), strict=True):
        rest = piece.forces[start : start + count * each]
        third = rest
        for _ in range(3):  # differences that leave little of a tremor
            third = third[lag:] - third[:-lag]
        white2 += 0.5 * float((third**2).mean()) / 20.0
        fast = rest - smooth(rest, each)
        fast2 += 0.5 * float((fast**2).mean())
    found = white2 * weights @ weights.T
    turns = TREMOR_HZ[:, None] * np.arange(len(piece.forces)) / piece.rate_hz
    phases = 2.0 * math.pi * turns
    for wave in (np.cos(phases), np.sin(phases)):
        seen = weights @ wave.T
        found += max(0.0, fast2 - white2) / len(TREMOR_HZ) * seen @ seen.T
    found[-1, -1] += (GRAVITY_M_S2 * GYR_WHITE) ** 2 * piece.seconds**5 / 20.0
    return np.asarray(found)
