# SPDX-License-Identifier: MIT
"""The equations of an interval: what each sensor read, and how little a state changes.

Each kind has three rows an interval: `away` is what is left of it now, `slopes` its
derivatives by the state at its node, at the next one, and by what holds for all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imud import rotation
from imud.calibration.algebra import skew
from imud.refine.model import (
    ACC,
    ACC_BIAS,
    BIAS,
    FIELD,
    GRAVITY,
    GYR,
    LAG,
    MAG,
    NORTH,
    OWN,
    PLACE,
    SPEED,
    STATE,
    TURN,
    WHOLE,
    BoolArray,
    Estimate,
    Priors,
    Recording,
)
from imud.refine.strapdown import Course
from imud.rotation import FloatArray

NEXT, ALL = STATE, 2 * STATE  # columns of the next node and of what holds for all
COLUMNS = ALL + WHOLE
# Degrees of freedom of Student's t, by which what is far off counts less: one that
# is 1 or less lets a value jump.
READING_NU, ROOM_NU, OWN_NU = 3.0, 1.0, 0.5
# Weights of what a bad interval has: within 1 rad, 10 m/s and 10 m.
TURN_LOST, SPEED_LOST = 1.0, 0.01
# Jumps of the own field are found only if it may wander at first: this many times its
# variance, and a tenth of it in each round.
OWN_OPENED = 1e4


@dataclass(frozen=True, slots=True)
class Rows:
    """Three equations for each of k intervals."""

    away: FloatArray  # (k, 3)
    weight: FloatArray  # (k,): 1 / variance
    slopes: tuple[tuple[slice, FloatArray], ...]  # columns; (k, 3, columns) or (3, ..)

    def put(self, dense: FloatArray) -> None:
        """The slopes into zeros (k, 3, COLUMNS)."""
        for columns, values in self.slopes:
            dense[:, :, columns] += values


def following(columns: slice) -> slice:
    """The columns of the same state at the next node."""
    return slice(columns.start + NEXT, columns.stop + NEXT)


def of_all(columns: slice) -> slice:
    return slice(columns.start + ALL, columns.stop + ALL)


def robust(squares: FloatArray, nu: float) -> FloatArray:
    """Weights of three normal values with these sums of squares, in variances."""
    return np.asarray((nu + 3.0) / (nu + squares))


@dataclass(frozen=True)
class Intervals:
    """Some intervals of a recording, at an estimate."""

    recording: Recording
    priors: Priors
    estimate: Estimate
    ends: FloatArray  # (n, 4), attitudes at the ends of the samples; late: as measured
    middles: FloatArray
    late: FloatArray
    biases: FloatArray
    rates: FloatArray
    turned: FloatArray  # (k, 3), from node to node
    is_rest: BoolArray
    own_opened: float  # by which the own field wanders more in the first rounds
    is_first: bool  # round

    @staticmethod
    def of(
        recording: Recording,
        priors: Priors,
        estimate: Estimate,
        course: Course,
        is_rest: BoolArray,
        step: int,
        some: slice,
    ) -> Intervals:
        """Those of `some`, in the given round of the search."""
        start, end = some.start, min(some.stop, recording.count)
        samples = slice(start * recording.each, end * recording.each)
        nodes = course.nodes[start : end + 1]
        turned = rotation.multiply(nodes[1:], rotation.inverse(nodes[:-1]))
        late = float(estimate.whole[LAG][0]) * recording.rate_hz
        return Intervals(
            recording.part(start, end),
            priors,
            Estimate(
                estimate.first,
                estimate.unseen[start:end],
                estimate.states[start : end + 1],
                estimate.whole,
            ),
            course.ends[samples],
            course.middles[samples],
            course.late(late)[samples],
            course.biases[samples],
            course.rates[samples],
            rotation.to_rotation_vector(turned),
            is_rest[start:end],
            max(1.0, OWN_OPENED * 0.1**step),
            step == 0,
        )

    def rows(self) -> Iterator[Rows]:
        """All kinds."""
        yield self.attitude()
        yield self.speed()
        yield self.place()
        yield self.room()
        yield self.own()
        yield self.constant(BIAS, self.priors.bias_wander**2 * self.node_s)
        yield self.field()
        yield from self.bounds()

    @property
    def node_s(self) -> float:
        return self.recording.node_s

    @property
    def now(self) -> FloatArray:
        return self.estimate.states[:-1]

    @property
    def then(self) -> FloatArray:
        return self.estimate.states[1:]

    @cached_property
    def turns(self) -> FloatArray:
        """Matrices amid each sample."""
        return rotation.to_matrix(self.middles)

    def mean(self, rows: FloatArray) -> FloatArray:
        return np.asarray(self.recording.by_node(rows).mean(axis=1))

    def by_entries(self, turns: FloatArray, vectors: FloatArray) -> FloatArray:
        """Derivatives of turns @ matrix @ vectors by the entries of the matrix."""
        found = turns[..., None] * vectors[:, None, None, :]
        return found.reshape(len(vectors), 3, 9)

    def attitude(self) -> Rows:
        """What the gyroscope did not see."""
        priors, node_s = self.priors, self.node_s
        measured = self.recording.gyr - self.biases
        by_bias = 0.5 * node_s * self.mean(self.turns @ self.estimate.matrix(GYR))
        by_gyr = node_s * self.mean(self.by_entries(self.turns, measured))
        turning = self.mean((self.rates**2).sum(axis=1))
        variance = priors.gyr_noise**2 + priors.gyr_turning**2 * turning
        one = np.eye(3)
        return Rows(
            self.estimate.unseen,
            self.believed(1.0 / (node_s * variance), TURN_LOST),
            (
                (TURN, -one),
                (following(TURN), one),
                (BIAS, by_bias),
                (following(BIAS), by_bias),
                (of_all(GYR), -by_gyr),
            ),
        )

    def believed(self, weight: FloatArray, lost: float) -> FloatArray:
        """The weights, almost none where samples are bad."""
        return np.where(self.recording.is_bad_node, lost, weight)

    @cached_property
    def forces(self) -> FloatArray:
        """(n, 3), in the world, m/s2."""
        true = (
            self.recording.acc - self.estimate.whole[ACC_BIAS]
        ) @ self.estimate.matrix(ACC).T
        return rotation.rotate(self.middles, true)

    @property
    def gravity(self) -> FloatArray:
        return np.array([0.0, 0.0, self.estimate.whole[GRAVITY][0]])

    def speed(self) -> Rows:
        """What the accelerometer did not see."""
        priors, node_s = self.priors, self.node_s
        force = self.mean(self.forces)
        measured = self.recording.acc - self.estimate.whole[ACC_BIAS]
        by_turn = 0.5 * node_s * skew(force)
        by_bias = node_s * self.mean(self.turns @ self.estimate.matrix(ACC))
        by_acc = node_s * self.mean(self.by_entries(self.turns, measured))
        moving = self.mean(((self.forces - self.gravity) ** 2).sum(axis=1))
        variance = node_s * (priors.acc_noise**2 + priors.acc_moving**2 * moving)
        one = np.eye(3)
        return Rows(
            self.then[:, SPEED] - self.now[:, SPEED] - node_s * (force - self.gravity),
            self.believed(1.0 / variance, SPEED_LOST),
            (
                (SPEED, -one),
                (following(SPEED), one),
                (TURN, by_turn),
                (following(TURN), by_turn),
                (of_all(ACC_BIAS), by_bias),
                (of_all(ACC), -by_acc),
                (of_all(GRAVITY), np.array([[0.0], [0.0], [node_s]])),
            ),
        )

    def place(self) -> Rows:
        """The speed, added up."""
        node_s = self.node_s
        left_s = (self.recording.each - np.arange(self.recording.each) - 0.5)[:, None]
        lever = self.recording.step_s**2 * left_s
        moved = (self.recording.by_node(self.forces) * lever).sum(axis=1)
        one = np.eye(3)
        away = self.then[:, PLACE] - self.now[:, PLACE] - node_s * self.now[:, SPEED]
        return Rows(
            away - moved + 0.5 * node_s**2 * self.gravity,
            self.believed(np.full(len(away), 1e6), SPEED_LOST),
            (
                (PLACE, -one),
                (following(PLACE), one),
                (SPEED, -node_s * one),
                (TURN, 0.5 * node_s**2 * skew(self.mean(self.forces))),
            ),
        )

    def room(self) -> Rows:
        """The field of the place returns to its mean as the probe moves."""
        priors, node_s = self.priors, self.node_s
        stays = np.where(self.is_rest, 1.0, np.exp(-node_s / priors.room_s))
        mean = self.estimate.mean_field
        away = self.then[:, FIELD] - mean - stays[:, None] * (self.now[:, FIELD] - mean)
        moving = priors.room**2 * (1.0 - stays**2) + 1e-9
        variance = np.where(self.is_rest, priors.room_rest**2 * node_s, moving)
        weight = robust((away**2).sum(axis=1) / variance, ROOM_NU) / variance
        one, north = np.eye(3), np.eye(3)[:, 1:]
        return Rows(
            away,
            weight,
            (
                (FIELD, -stays[:, None, None] * one),
                (following(FIELD), one),
                (of_all(NORTH), (stays - 1.0)[:, None, None] * north),
            ),
        )

    def own(self) -> Rows:
        """The probe's own field stays, but for jumps where a magnet is put on."""
        variance = self.priors.own_wander**2 * self.node_s * self.own_opened
        rows = self.constant(OWN, variance)
        if self.is_first:
            return rows
        weight = robust((rows.away**2).sum(axis=1) / variance, OWN_NU) / variance
        return Rows(rows.away, weight, rows.slopes)

    def constant(self, of: slice, variance: float) -> Rows:
        """A state changes by no more than its wander."""
        one = np.eye(3)
        away = self.then[:, of] - self.now[:, of]
        weight = np.full(len(away), 1.0 / variance)
        return Rows(away, weight, ((of, -one), (following(of), one)))

    @cached_property
    def read(self) -> FloatArray:
        """(k,): readings of the magnetometer in each interval."""
        return np.asarray(self.recording.by_node(self.recording.has_mag).sum(axis=1))

    def mean_read(self, rows: FloatArray) -> FloatArray:
        """Means over an interval's readings of the magnetometer; 0 without any."""
        has = self.recording.has_mag
        sums = self.recording.by_node(rows[: len(has)])
        shape = (len(self.read), self.recording.each) + (1,) * (rows.ndim - 1)
        sums = (sums * has.reshape(shape)).sum(axis=1)
        least = np.maximum(self.read, 1).reshape(-1, *(1,) * (rows.ndim - 1))
        return np.asarray(sums / least)

    def field(self) -> Rows:
        """What the magnetometer read, turned into the world: the field of the place as
        the sensor distorts it, and its own.
        """
        turns = rotation.to_matrix(self.late)
        back = turns.transpose(0, 2, 1)
        read = np.nan_to_num(self.recording.mag)
        soft = self.estimate.matrix(MAG)
        place = np.repeat(self.now[:, FIELD], self.recording.each, axis=0)
        felt = (back @ place[..., None])[..., 0]
        turn = self.mean_read(turns)
        own = (turn @ self.now[:, OWN, None])[..., 0]
        measured = self.mean_read(rotation.rotate(self.late, read))
        as_felt = self.mean_read(rotation.rotate(self.late, felt @ soft.T))
        turned = np.cross(self.rates, read)
        away = measured - as_felt - own
        variance = self.priors.mag_noise**2
        squares = (away**2).sum(axis=1) / variance
        weight = 1.0 / (1.0 + squares) if self.is_first else robust(squares, READING_NU)
        by_turn = -0.5 * skew(measured - own)
        by_lag = -self.mean_read(rotation.rotate(self.late, turned))[..., None]
        return Rows(
            away,
            np.where(self.read > 0, weight, 0.0) / variance,
            (
                (TURN, by_turn),
                (following(TURN), by_turn),
                (FIELD, -self.mean_read(turns @ soft @ back)),
                (OWN, -turn),
                (of_all(MAG), -self.mean_read(self.by_entries(turns, felt))),
                (of_all(LAG), by_lag),
            ),
        )

    def bounds(self) -> Iterator[Rows]:
        """A hand moves within its reach; at rest nothing moves or turns."""
        priors, node_s, one = self.priors, self.node_s, np.eye(3)
        moving = node_s / priors.speed**2
        weight = np.where(self.is_rest, 1.0 / priors.rest_speed**2, moving)
        yield Rows(self.now[:, SPEED], weight, ((SPEED, one),))
        weight = np.full(len(self.now), node_s / priors.place**2)
        yield Rows(self.now[:, PLACE], weight, ((PLACE, one),))
        still = 1.0 / (priors.rest_turn**2 * node_s)
        yield Rows(
            self.turned,
            np.where(self.is_rest, still, 0.0),
            ((TURN, -one), (following(TURN), one)),
        )
