# SPDX-License-Identifier: MIT
"""A stretch of a recording that is estimated at once: the most probable course of all
its states, by Gauss-Newton steps with weights that are renewed in each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from imud import rotation
from imud.refine.model import (
    BIAS,
    FIELD,
    GYR,
    NORTH,
    OWN,
    SPEED,
    STATE,
    TURN,
    WHOLE,
    BoolArray,
    Estimate,
    Priors,
    Recording,
    prior_of_whole,
)
from imud.refine.rests import find_rests, stretches
from imud.refine.rows import Intervals
from imud.refine.solve import Equations, Marginal, Solution, marginal
from imud.refine.start import level, started
from imud.refine.strapdown import Course, course_of
from imud.rotation import FloatArray

ROUNDS, LATER_ROUND, LEAST_ROUND = 10, 3, 5
SMALL_STEP = math.radians(0.01)
PIECE = 512  # intervals whose equations are in memory at once
# A rest whose field is as long and as steep as that of the first one is in its place.
SAME_UT, NEAR_UT, REST_S, BEGIN_S = 0.7, 3.0, 1.5, 15.0
LEFT_OUT_S = 1.0  # rests that are predicted by all others last longer
SETTLED_ROUND = 2  # from which on fields are known well enough to compare


@dataclass(frozen=True)
class Before:
    """What all before a window tells of its first node, and of what holds for all."""

    attitude: FloatArray  # (4,)
    state: FloatArray  # (STATE,)
    whole: FloatArray  # (WHOLE,)
    earth: FloatArray
    known: Marginal

    def away(self, estimate: Estimate) -> FloatArray:
        """How far an estimate has gone from it: a node's state, then the parameters."""
        turned = rotation.multiply(estimate.first, rotation.inverse(self.attitude))
        state = estimate.states[0] - self.state
        state[TURN] = rotation.to_rotation_vector(turned)
        return np.concatenate([state, estimate.whole - self.whole])

    def begun(self, recording: Recording) -> Estimate:
        """A first estimate of what follows."""
        states = np.tile(self.state, (recording.count + 1, 1))
        states[1:, SPEED] = 0.0
        unseen = np.zeros((recording.count, 3))
        found = Estimate(self.attitude, unseen, states, self.whole)
        level(recording, found, is_turned=False)
        return found


@dataclass
class Window:
    """An estimate of a stretch; `before`: what came before it."""

    recording: Recording
    priors: Priors
    before: Before | None = None
    like: Window | None = None  # of the same stretch: begins with its estimate
    is_rest: BoolArray = field(init=False)
    estimate: Estimate = field(init=False)
    earth: FloatArray = field(init=False)  # rad/s
    course: Course = field(init=False)
    solution: Solution = field(init=False)
    round: int = 0

    def __post_init__(self) -> None:
        self.recording = self.recording.part(0, self.recording.count)
        if self.like is not None:
            self.is_rest, self.earth = self.like.is_rest, self.like.earth
            self.estimate, self.course = self.like.copied(), self.like.course
            return
        self.is_rest = find_rests(self.recording)
        if self.before is None:
            begun = started(self.recording, self.priors, self.is_rest)
            self.estimate, self.earth = begun
        else:
            self.estimate = self.before.begun(self.recording)
            self.earth = self.before.earth
        self.course = course_of(self.recording, self.estimate, self.earth)

    def search(self) -> Iterator[float]:
        """Takes steps until they are small; yields the largest turn in each, rad.
        numpy.linalg.LinAlgError where its equations determine none.
        """
        begin = 0 if self.like is None else LATER_ROUND
        for self.round in range(begin, ROUNDS):
            equations = self._equations(self.recording.count)
            self._add_known(equations)
            self.solution = equations.solved()
            if not np.isfinite(self.solution.whole_covariance).all():
                raise np.linalg.LinAlgError("not finite")
            self._take(self.solution.step, self.solution.whole_step)
            step = float(np.abs(self.solution.step[:, TURN]).max())
            yield step
            if self.round >= LEAST_ROUND and step < SMALL_STEP:
                return

    def copied(self) -> Estimate:
        """The estimate, to be moved on."""
        found = self.estimate
        return replace(found, unseen=found.unseen.copy(), states=found.states.copy())

    @property
    def share_done(self) -> float:
        return (self.round + 1) / ROUNDS

    def _equations(
        self, count: int, begin: int = 0, is_rest: BoolArray | None = None
    ) -> Equations:
        """Those of the intervals from `begin` to before `count`."""
        found = Equations(count - begin)
        for start in range(begin, count, PIECE):
            some = slice(start, min(start + PIECE, count))
            found.add(self.intervals(some, is_rest).rows(), start - begin)
        return found

    def intervals(self, some: slice, is_rest: BoolArray | None = None) -> Intervals:
        """Those of `some`; `is_rest`: where it is not to be that of the window."""
        return Intervals.of(
            self.recording,
            self.priors,
            self.estimate,
            self.course,
            self.is_rest if is_rest is None else is_rest,
            self.round,
            some,
        )

    def known_before(self, node: int) -> Before:
        """What all before a node tells of it, once the search is over."""
        equations = self._equations(node)
        self._add_known(equations)
        return Before(
            self.course.nodes[node],
            self.estimate.states[node],
            self.estimate.whole,
            self.earth,
            marginal(equations),
        )

    def halves_apart(self) -> tuple[FloatArray, FloatArray]:
        """By how much the two halves of a search that is over differ where they meet,
        turns about east, north and up, and the one-sigma error of that.
        """
        seam = self.recording.count // 2
        first = self._equations(seam)
        self._add_known(first)
        second = self._equations(self.recording.count, seam)
        for node in self.same_place():
            if seam <= node < self.recording.count:
                self._add_north(second, node, node - seam)
        self._add_priors(second)
        ahead, back = first.solved(), second.solved()
        variances = ahead.covariances()[-1] + back.covariances()[0]
        apart = ahead.step[-1, TURN] - back.step[0, TURN]
        return apart, np.sqrt(np.diag(variances)[TURN])

    def rests_off(self) -> float:
        """The largest difference between the gyroscope's bias as a rest shows it and
        as all else does, in sigmas of that; 0 with fewer than two rests.
        """
        rests = [
            (start, end)
            for start, end in stretches(self.is_rest)
            if (end - start) * self.recording.node_s > LEFT_OUT_S
        ]
        most = 0.0
        for out in (rests[::2], rests[1::2]) if len(rests) > 1 else ():
            is_rest = self.is_rest.copy()
            for start, end in out:
                is_rest[start:end] = False
            equations = self._equations(self.recording.count, is_rest=is_rest)
            self._add_known(equations)
            others = equations.solved()
            variances = np.diagonal(others.covariances(), axis1=1, axis2=2)
            at = [(start + end) // 2 for start, end in out]
            off = np.abs(others.step[at, BIAS]) / np.sqrt(variances[at, BIAS])
            most = max(most, float(off.max()))
        return most

    def _add_known(self, equations: Equations) -> None:
        """What is known beforehand, and rests in the same place."""
        for node in self.same_place():
            if node < len(equations.below):
                self._add_north(equations, node, node)
        if self.before is not None:
            known = self.before.known
            right = known.right + known.matrix @ self.before.away(self.estimate)
            equations.add_sums(0, known.matrix, right)
            return
        self._add_priors(equations, self.estimate.states[0])

    def _add_priors(
        self, equations: Equations, state: FloatArray | None = None
    ) -> None:
        """Of what holds for all, and of the first node. Without its state nothing is
        taken to be wrong there.
        """
        away, sigma = prior_of_whole(self.estimate.whole, self.priors)
        equations.corner += np.diag(1.0 / sigma**2)
        equations.right_whole += away / sigma**2
        slopes = np.zeros((STATE, STATE + WHOLE))
        slopes[:, :STATE] = np.diag(self._begin_weights())
        state = np.zeros(STATE) if state is None else state
        equations.add_at(0, slopes[:, :STATE] @ state, slopes)

    def _begin_weights(self) -> FloatArray:
        weights = np.full(STATE, 1e-4)
        weights[BIAS], weights[OWN] = 1.0 / self.priors.bias, 1.0 / self.priors.own
        return weights

    def _add_north(self, equations: Equations, node: int, at: int) -> None:
        """The field at a node is that of the place; `at`: its number there."""
        weight = 1.0 / self.priors.north
        slopes = np.zeros((3, STATE + WHOLE))
        slopes[:, FIELD] = weight * np.eye(3)
        shared = slice(STATE + NORTH.start, STATE + NORTH.stop)
        slopes[:, shared] = -weight * np.eye(3)[:, 1:]
        away = self.estimate.states[node, FIELD] - self.estimate.mean_field
        equations.add_at(at, weight * away, slopes)

    def same_place(self) -> list[int]:
        """The recording's first node, and nodes of rests that seem to be there, too."""
        found = [0] if self.before is None else []
        if self.round < SETTLED_ROUND:
            return found
        node_s, states = self.recording.node_s, self.estimate.states
        rests = [
            (start, end)
            for start, end in stretches(self.is_rest)
            if (end - start) * node_s > REST_S
        ]
        fields = [states[start:end, FIELD].mean(axis=0) for start, end in rests]
        first = self.estimate.mean_field
        if self.before is None:
            if not rests or rests[0][0] * node_s > BEGIN_S:
                return found
            first = fields[0]
            del rests[0], fields[0]
        for (start, end), other in zip(rests, fields, strict=True):
            longer = abs(np.linalg.norm(other) - np.linalg.norm(first))
            steeper = abs(other[2] - first[2])
            is_near = np.linalg.norm(other - first) < NEAR_UT
            if max(longer, steeper) < SAME_UT and is_near:
                found.append((start + end) // 2)
        return found

    def _take(self, step: FloatArray, whole: FloatArray) -> None:
        """Moves the estimate by a step."""
        estimate, turns = self.estimate, step[:, TURN]
        estimate.unseen = self._unseen(step, whole)
        estimate.first = rotation.multiply(
            rotation.from_rotation_vector(turns[0]), estimate.first
        )
        estimate.states[:, TURN.stop :] += step[:, TURN.stop :]
        estimate.whole = estimate.whole + whole
        self.course = course_of(self.recording, estimate, self.earth)

    def _unseen(self, step: FloatArray, whole: FloatArray) -> FloatArray:
        """What the gyroscope did not see, after a step."""
        found = np.empty_like(self.estimate.unseen)
        for start in range(0, len(found), PIECE):
            some = slice(start, min(start + PIECE, len(found)))
            rows = self.intervals(some).attitude()
            move = np.concatenate(
                [step[some], step[some.start + 1 : some.stop + 1]], axis=1
            )
            left = rows.away.copy()
            for columns, slopes in rows.slopes:
                if columns.start < 2 * STATE:
                    left += (slopes @ move[:, columns, None])[..., 0]
                else:
                    left += slopes @ whole[GYR]
            found[some] = left
        return found
