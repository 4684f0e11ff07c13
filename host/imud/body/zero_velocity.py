# SPDX-License-Identifier: MIT
"""The place of a foot with its error: rates and forces are integrated, and each time
the foot stands its speed is zero, which corrects place, speed, attitude and the
gyroscope's bias together (E. Foxlin, IEEE Computer Graphics 25(6):38, 2005).

The states of the error, in this order: place, m; speed, m/s; attitude, rad, all in the
world's axes; bias of the rates, rad/s, and the probe's place from where the foot
touches the ground, m, in the probe's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.calibration.algebra import skew
from imud.calibration.recording import GRAVITY_M_S2
from imud.rotation import FloatArray

PLACE, SPEED, ATTITUDE, BIAS, LEVER = (slice(3 * at, 3 * at + 3) for at in range(5))
STATES = 15

# One-sigma errors at the beginning.
SPEED_SIGMA_M_S = 0.02
BIAS_SIGMA_RAD_S = math.radians(0.3)
LEVER_SIGMA_M = 0.08
# Noise: of forces and rates as such, m/s2 and rad/s over a root of Hz, and the share of
# what is felt that scale, cross-axis and the samples' distance in time make of it.
FORCE_NOISE, RATE_NOISE = 0.02, math.radians(0.02)
FORCE_SHARE, RATE_SHARE = 0.006, 0.002
BIAS_WANDER = math.radians(0.01)
WEIGH_S = 0.3  # in which gravity is weighed
LEVER_WANDER_M = 0.03  # over a root of rests
# Of samples at the end of the range nobody knows how much more there was.
CLIPPED_M_S2, CLIPPED_RAD_S = 100.0, 10.0

# What stands, moves by some mm/s.
STANDING_M_S = 0.01
# Neighbouring samples have the same errors: so many seconds count as one.
SAME_S = 0.04
# A speed further from zero than this, its mean square over that expected, is that of a
# foot that moves.
FAR, FAR_STANDING = 4.0, 30.0  # of one that swung, and of one that stood before
# How far speeds are off says how much noise there is: each rest counts so little, and
# says no more than SAYS_MAX.
BELIEF = 6.0
SAYS_MAX = 4.0
STRETCH_MIN, STRETCH_MAX = 0.25, 100.0
FAR_HEADING = 5.0  # sigmas
# Headings of a filter have the same error for some time.
HEADING_SAME_S = 15.0
HEADING_SIGMA_MIN = math.radians(1.0)

EYE = np.eye(STATES)
_ABOUT_UP = np.zeros(STATES)
_ABOUT_UP[ATTITUDE.stop - 1] = 1.0


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
        self.covariance = np.diag(sigmas**2)
        self._gravity = GRAVITY_M_S2
        self.stretch = 1.0  # of the noise, by how speeds agreed: a variance's factor
        self._last: tuple[FloatArray, FloatArray] | None = None
        self._was_clipped = False

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma errors of the place, m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[PLACE]))

    def advance(
        self, step_s: float, gyr: FloatArray, acc: FloatArray, *, is_clipped: bool
    ) -> Step:
        """To the next sample, of rates rad/s and forces m/s2 in the probe's frame."""
        last_gyr, last_acc = self._last if self._last is not None else (gyr, acc)
        self._last = gyr, acc
        rate = (gyr + last_gyr) / 2.0 - self.bias
        turn = rotation.from_rotation_vector(rate * step_s)
        turned = rotation.multiply(self.quat, turn)
        axes = _matrix(turned)
        force = (_matrix(self.quat) @ last_acc + axes @ acc) / 2.0
        pull = force.copy()
        pull[2] -= self._gravity
        transition = EYE.copy()
        leaning = skew(force) * -step_s
        transition[PLACE, SPEED] = EYE[PLACE, PLACE] * step_s
        transition[SPEED, ATTITUDE] = leaning
        transition[PLACE, ATTITUDE] = leaning * (step_s / 2.0)
        transition[ATTITUDE, BIAS] = axes * -step_s
        self.place = self.place + (self.speed + pull * (step_s / 2.0)) * step_s
        self.speed = self.speed + pull * step_s
        self.quat = turned / np.linalg.norm(turned)
        before = self.covariance
        after = transition @ before @ transition.T
        after[np.diag_indices(STATES)] += self._noise(
            step_s,
            float(np.linalg.norm(pull)),
            float(np.linalg.norm(rate)),
            is_clipped or self._was_clipped,  # the force is the mean of both
        )
        self._was_clipped = is_clipped
        self.covariance = after
        return Step(transition, before, after)

    def _noise(
        self, step_s: float, pull: float, rate: float, is_clipped: bool
    ) -> FloatArray:
        """What a step adds to the variances."""
        found = np.zeros(STATES)
        force = FORCE_NOISE**2 * step_s + (FORCE_SHARE * pull) ** 2 * step_s * SAME_S
        turn = RATE_NOISE**2 * step_s + (RATE_SHARE * rate) ** 2 * step_s * SAME_S
        if is_clipped:
            force += (CLIPPED_M_S2 * step_s) ** 2
            turn += (CLIPPED_RAD_S * step_s) ** 2
        found[SPEED] = force
        found[PLACE] = force * step_s * step_s / 4.0
        found[ATTITUDE] = turn
        found[BIAS] = BIAS_WANDER**2 * step_s
        return found * self.stretch

    def weigh(self, acc: FloatArray, step_s: float) -> None:
        """A sample of a foot that surely stands: an accelerometer that is off by some
        mg along gravity would lift the path stride by stride.
        """
        off = float(np.linalg.norm(acc)) - self._gravity
        self._gravity += off * min(1.0, step_s / WEIGH_S)

    def agrees(
        self, gyr: FloatArray, sigma: float, *, is_new: bool, must: bool
    ) -> bool:
        """Whether its speed may be that of a foot that stands, but for `sigma`, m/s.
        `is_new`: it did not stand before, so that this tells how good the speed was.
        `must`: it stands, so that what its speed seems says how far that is off.
        """
        shown, off = self._standing(gyr)
        spread = shown @ self.covariance @ shown.T + sigma**2 * np.eye(3)
        far = float(off @ np.linalg.solve(spread, off)) / 3.0
        if far > (FAR if is_new else FAR_STANDING):
            if not must:
                return False
            self.covariance = self.covariance * far
        if not is_new:
            return True
        seen = min(far, SAYS_MAX) * self.stretch
        self.stretch += (seen - self.stretch) / BELIEF
        self.stretch = min(max(self.stretch, STRETCH_MIN), STRETCH_MAX)
        self.covariance[LEVER, LEVER] += LEVER_WANDER_M**2 * np.eye(3)
        return True

    def stand(self, gyr: FloatArray, sigma: float) -> FloatArray:
        """It stands but for `sigma`, m/s; to be said once in SAME_S. Returns what all
        states are corrected by.
        """
        noise = math.hypot(STANDING_M_S, sigma) ** 2 * EYE[:3, :3]
        return self._correct(*self._standing(gyr), noise)

    def _standing(self, gyr: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A foot that stands turns about where it touches the ground: what its speed
        shows of the states, and by how much it is off, m/s.
        """
        moves = _matrix(self.quat) @ skew(gyr - self.bias)
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
        """By what a measurement is off; returns what all states are corrected by."""
        seen = self.covariance @ shown.T
        gain = np.linalg.solve(shown @ seen + noise, seen.T).T
        kept = EYE - gain @ shown
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        change = gain @ off
        self.place = self.place + change[PLACE]
        self.speed = self.speed + change[SPEED]
        self.bias = self.bias + change[BIAS]
        self.lever = self.lever + change[LEVER]
        turned = rotation.from_rotation_vector(change[ATTITUDE])
        self.quat = rotation.multiply(turned, self.quat)
        return np.asarray(change)


def smoothed(
    steps: list[Step], change: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the correction at the end of the steps makes of the places before each of
    them, m, (n, 3), and their one-sigma errors (Rauch, Tung and Striebel 1965).
    `covariance`: after the correction.
    """
    changes, sigmas = np.empty((len(steps), 3)), np.empty((len(steps), 3))
    for index in range(len(steps) - 1, -1, -1):
        step = steps[index]
        tiny = np.eye(STATES) * (1e-9 * np.trace(step.after) / STATES + 1e-15)
        gain = np.linalg.solve(step.after + tiny, step.transition @ step.before).T
        change = gain @ change
        covariance = step.before + gain @ (covariance - step.after) @ gain.T
        changes[index] = change[PLACE]
        variances = np.diag(covariance)[PLACE]
        sigmas[index] = np.sqrt(np.maximum(variances, 0.0))
    return changes, sigmas


def _matrix(quat: FloatArray) -> FloatArray:
    """world_from_probe of one quaternion."""
    w, x, y, z = quat.tolist()
    return np.array(rotation.matrix_rows((w, x, y, z)))
