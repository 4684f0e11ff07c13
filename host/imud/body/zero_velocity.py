# SPDX-License-Identifier: MIT
"""The place of a foot with its error: rates and forces are integrated, and each time
the foot stands its speed is zero, which corrects place, speed, attitude and the
gyroscope's bias together (E. Foxlin, IEEE Computer Graphics 25(6):38, 2005).

The states of the error, in this order: place, m; speed, m/s; attitude, rad, all in the
world's axes; bias of the rates, rad/s, the probe's place from where the foot touches
the ground, m, bias of the forces, m/s2, and the errors of the gyroscope's scales and
axes, shares, column by column: all in the probe's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.calibration.algebra import skew
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

PLACE, SPEED, ATTITUDE, BIAS, LEVER, PUSH = (
    slice(3 * at, 3 * at + 3) for at in range(6)
)
SCALE = slice(18, 27)
STATES = 27

# One-sigma errors at the beginning.
SPEED_SIGMA_M_S = 0.02
BIAS_SIGMA_RAD_S = math.radians(0.3)
LEVER_SIGMA_M = 0.08
# Of a calibrated accelerometer, some mg, and the variation of gravity between places.
PUSH_SIGMA_M_S2 = 0.05
# A share, of a calibrated gyroscope that is shaken besides: with sigmas as params state
# them (0.1 %, and 0.02 m/s2 above) simulated bare feet are off by a quarter more.
SCALE_SIGMA = 0.005
# Noise: of forces and rates as such, m/s2 and rad/s over a root of Hz, and the share of
# what is felt that scale, cross-axis and the samples' distance in time make of it.
FORCE_NOISE, RATE_NOISE = 0.02, math.radians(0.02)
FORCE_SHARE, RATE_SHARE = 0.006, 0.002
# The rate error by a force: 0.1 deg/s a g, by data sheets of MEMS, over three axes. The
# mean of a gait over MEAN_S is not that of standing.
RATE_BY_FORCE, MEAN_S = math.radians(0.06) / GRAVITY_M_S2, 1.5
# Over a root of a second: as a module warms up.
BIAS_WANDER, PUSH_WANDER = math.radians(0.01), 0.003
SWAY_RAD_S = math.radians(0.05)  # in the mean of a second, of a foot that stands
LEVER_WANDER_M = 0.03  # over a root of rests
# Of samples at the end of the range, the largest excess that is assumed.
CLIPPED_M_S2, CLIPPED_RAD_S = 150.0, 20.0

# A standing foot moves by some mm/s.
STANDING_M_S = 0.01
# Neighbouring samples have the same errors: so many seconds count as one.
SAME_S = 0.04
# A speed further from zero than this, its mean square over that expected, is that of a
# foot that moves.
FAR, FAR_STANDING = 4.0, 30.0  # of one that swung, and of one that stood before
# The errors of speeds show the noise: each rest has this small weight, and at most
# SAYS_MAX.
BELIEF = 6.0
SAYS_MAX = 4.0
STRETCH_MIN, STRETCH_MAX = 0.25, 100.0
FAR_HEADING, FAR_RATE = 5.0, 4.0  # sigmas
# Headings of a filter have the same error for some time.
HEADING_SAME_S = 15.0
HEADING_SIGMA_MIN = math.radians(1.0)

EYE = np.eye(STATES)
_ABOUT_UP = np.zeros(STATES)
_ABOUT_UP[ATTITUDE.stop - 1] = 1.0


@dataclass(frozen=True, slots=True)
class Clipped:
    """Whether a sample is at the end of the range."""

    rate: bool = False
    force: bool = False


UNCLIPPED = Clipped()


@dataclass(slots=True)
class Beyond:
    """The missing part of a sensor at the end of its range: as much as it rose
    before, for half the time that it has been there; `most` at most.
    """

    most: float
    slope: float = 0.0
    passed_s: float = 0.0
    lost: float = 0.0  # so far: it adds up

    def variance(self, is_clipped: bool, change: FloatArray, step_s: float) -> float:
        """The error that a step adds, by the change since the last sample."""
        if not is_clipped:
            self.slope = _length(change) / max(step_s, 1e-4)
            self.passed_s = self.lost = 0.0
            return 0.0
        self.passed_s += step_s
        before = self.lost
        self.lost += min(self.slope * self.passed_s / 2.0, self.most) * step_s
        return self.lost**2 - before**2


@dataclass(frozen=True, slots=True)
class Step:
    """One step forward, to be smoothed: the covariance before and after it."""

    transition: FloatArray
    before: FloatArray
    after: FloatArray


class ZeroVelocity:
    """Goes forward sample by sample; stand() at each that rests."""

    def __init__(
        self, quat: FloatArray, tilt_sigma: float, heading_sigma: float
    ) -> None:
        """`quat`: world_from_probe of a foot that stands; errors in rad, a heading
        without reference has none.
        """
        self.place, self.speed = np.zeros(3), np.zeros(3)
        self.bias, self.lever = np.zeros(3), np.zeros(3)
        self.quat = quat
        sigmas = np.zeros(STATES)
        sigmas[SPEED] = SPEED_SIGMA_M_S
        sigmas[ATTITUDE] = tilt_sigma, tilt_sigma, heading_sigma
        sigmas[BIAS] = BIAS_SIGMA_RAD_S
        sigmas[LEVER] = LEVER_SIGMA_M
        sigmas[PUSH] = PUSH_SIGMA_M_S2
        sigmas[SCALE] = SCALE_SIGMA
        self.covariance = np.diag(sigmas**2)
        self.push, self.scale = np.zeros(3), np.zeros((3, 3))
        self.stretch = 1.0  # of the noise, by how speeds agreed: a variance's factor
        self._last: tuple[FloatArray, FloatArray] | None = None
        self._was_force_clipped = False
        self._beyond = Beyond(CLIPPED_M_S2), Beyond(CLIPPED_RAD_S)
        # Of forces: the mean of the last while, and when it last stood; and what was
        # added to the variance of the bias since.
        self._mean: FloatArray | None = None
        self._stood: FloatArray | None = None
        self._added = 0.0

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma errors of the place, m."""
        return np.asarray(np.sqrt(self.covariance.diagonal()[PLACE]))

    def advance(
        self,
        step_s: float,
        gyr: FloatArray,
        acc: FloatArray,
        clipped: Clipped = UNCLIPPED,
    ) -> Step:
        """To the next sample, of rates rad/s and forces m/s2 in the probe's frame."""
        last_gyr, last_acc = self._last if self._last is not None else (gyr, acc)
        self._last = gyr, acc
        rate = (gyr + last_gyr) / 2.0 - self.bias
        rate = rate - self.scale @ rate
        turn = rotation.from_rotation_vector(rate * step_s)
        turned = rotation.multiply(self.quat, turn)
        axes = rotation.to_matrix(turned)
        force = rotation.to_matrix(self.quat) @ (last_acc - self.push)
        force = (force + axes @ (acc - self.push)) / 2.0
        pull = force.copy()
        pull[2] -= GRAVITY_M_S2
        transition = EYE.copy()
        leaning = skew(force) * -step_s
        transition[PLACE, SPEED] = EYE[PLACE, PLACE] * step_s
        transition[SPEED, ATTITUDE] = leaning
        transition[PLACE, ATTITUDE] = leaning * (step_s / 2.0)
        transition[SPEED, PUSH] = axes * -step_s
        transition[PLACE, PUSH] = axes * (-0.5 * step_s * step_s)
        transition[ATTITUDE, BIAS] = axes * -step_s
        by_scale = axes[:, None, :] * (rate * -step_s)[:, None]
        transition[ATTITUDE, SCALE] = by_scale.reshape(3, 9)
        self.place = self.place + (self.speed + pull * (step_s / 2.0)) * step_s
        self.speed = self.speed + pull * step_s
        self.quat = turned / _length(turned)
        before = self.covariance
        after = transition @ before @ transition.T
        found = self._noise(step_s, _length(pull), _length(rate))
        # The force is the mean of both samples.
        is_force = clipped.force or self._was_force_clipped
        found[SPEED] += self._beyond[0].variance(is_force, acc - last_acc, step_s)
        swung = gyr - last_gyr
        found[ATTITUDE] += self._beyond[1].variance(clipped.rate, swung, step_s)
        after.flat[:: STATES + 1] += found
        self._was_force_clipped = clipped.force
        after[BIAS, BIAS] += self._biased(step_s, acc) * EYE[:3, :3]
        self.covariance = after
        return Step(transition, before, after)

    def _noise(self, step_s: float, pull: float, rate: float) -> FloatArray:
        """The variances that a step adds."""
        found = np.zeros(STATES)
        force = FORCE_NOISE**2 * step_s + (FORCE_SHARE * pull) ** 2 * step_s * SAME_S
        turn = RATE_NOISE**2 * step_s + (RATE_SHARE * rate) ** 2 * step_s * SAME_S
        found[SPEED] = force
        found[PLACE] = force * step_s * step_s / 4.0
        found[ATTITUDE] = turn
        found *= self.stretch
        found[BIAS] = BIAS_WANDER**2 * step_s
        found[PUSH] = PUSH_WANDER**2 * step_s
        return found

    def _biased(self, step_s: float, acc: FloatArray) -> float:
        """The variance that forces add to the rates' bias since it last stood."""
        if self._mean is None or self._stood is None:
            self._mean = self._stood = acc
        self._mean = self._mean + (acc - self._mean) * min(1.0, step_s / MEAN_S)
        off = self._mean - self._stood
        most = RATE_BY_FORCE**2 * float(off @ off)
        added = max(0.0, most - self._added)
        self._added += added
        return added

    def still(self, gyr: FloatArray) -> None:
        """The mean rate of a second in which the foot surely stood: its own is zero."""
        off = gyr - self.bias
        shown = EYE[BIAS]
        spread = np.diag(self.covariance)[BIAS] + SWAY_RAD_S**2
        # A foot that rolls on evenly does not stand.
        if (off**2 < FAR_RATE**2 * spread).all():
            self._correct(shown, off, SWAY_RAD_S**2 * EYE[:3, :3])
            self._stood, self._added = self._mean, 0.0

    def agrees(
        self, gyr: FloatArray, sigma: float, *, is_new: bool, must: float
    ) -> bool:
        """Whether its speed may be that of a foot that stands, but for `sigma`, m/s.
        `is_new`: it did not stand before, so this shows how good the speed was. `must`:
        it stands in spite of the large difference, which is then the error of its
        speed.
        """
        shown, off = self._standing(gyr)
        known = shown @ self.covariance @ shown.T
        spread = known + sigma**2 * np.eye(3)
        far = float(off @ np.linalg.solve(spread, off)) / 3.0
        if far > (FAR if is_new else FAR_STANDING):
            if far > must:
                return False
            self.covariance = self.covariance * far
        if not is_new:
            return True
        # If the rest itself is the least certain, it shows little of the noise.
        share = float(np.trace(known) / np.trace(spread))
        self.stretch *= 1.0 + share * (min(far, SAYS_MAX) - 1.0) / BELIEF
        self.stretch = min(max(self.stretch, STRETCH_MIN), STRETCH_MAX)
        self.covariance[LEVER, LEVER] += LEVER_WANDER_M**2 * np.eye(3)
        return True

    def stand(self, gyr: FloatArray, sigma: float) -> FloatArray:
        """It stands but for `sigma`, m/s; call it once in SAME_S. Returns the
        correction of all states.
        """
        noise = math.hypot(STANDING_M_S, sigma) ** 2 * EYE[:3, :3]
        return self._correct(*self._standing(gyr), noise)

    def _standing(self, gyr: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A foot that stands turns about where it touches the ground: the slopes of its
        speed by the states, and its difference, m/s.
        """
        moves = rotation.to_matrix(self.quat) @ skew(gyr - self.bias)
        shown = EYE[SPEED].copy()
        shown[:, LEVER] = -moves
        return shown, moves @ self.lever - self.speed

    def face(self, quat: FloatArray, sigma: float, passed_s: float) -> None:
        """The heading that the probe's own filter gives, `passed_s` since the last."""
        off = rotation.multiply(quat, rotation.inverse(self.quat))
        turn = float(rotation.to_rotation_vector(off)[2])
        noise = max(sigma, HEADING_SIGMA_MIN) ** 2 * max(
            1.0, HEADING_SAME_S / max(passed_s, 1e-3)
        )
        spread = float(self.covariance[ATTITUDE, ATTITUDE][2, 2]) + sigma**2
        if turn * turn < FAR_HEADING**2 * spread:
            self._correct(_ABOUT_UP[None], np.array([turn]), np.array([[noise]]))

    def _correct(
        self, shown: FloatArray, off: FloatArray, noise: FloatArray
    ) -> FloatArray:
        """Takes a measurement's residual; returns the correction of all states."""
        seen = self.covariance @ shown.T
        gain = np.linalg.solve(shown @ seen + noise, seen.T).T
        kept = EYE - gain @ shown
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        change = gain @ off
        self.place = self.place + change[PLACE]
        self.speed = self.speed + change[SPEED]
        self.bias = self.bias + change[BIAS]
        self.lever = self.lever + change[LEVER]
        self.push = self.push + change[PUSH]
        self.scale = self.scale + change[SCALE].reshape(3, 3).T
        turned = rotation.from_rotation_vector(change[ATTITUDE])
        self.quat = rotation.multiply(turned, self.quat)
        return np.asarray(change)


def smoothed(
    steps: list[Step], change: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The smoothed places before each step, by the correction at their end, m, (n, 3),
    and their one-sigma errors (Rauch, Tung and Striebel 1965). `covariance`: after the
    correction.
    """
    changes, sigmas = np.empty((len(steps), 3)), np.empty((len(steps), 3))
    for index in range(len(steps) - 1, -1, -1):
        step = steps[index]
        tiny = EYE * (1e-9 * np.trace(step.after) / STATES + 1e-15)
        gain = np.linalg.solve(step.after + tiny, step.transition @ step.before).T
        change = gain @ change
        covariance = step.before + gain @ (covariance - step.after) @ gain.T
        changes[index] = change[PLACE]
        variances = covariance.diagonal()[PLACE]
        sigmas[index] = np.sqrt(np.maximum(variances, 0.0))
    return changes, sigmas


def _length(vector: FloatArray) -> float:
    return math.sqrt(float(vector @ vector))
