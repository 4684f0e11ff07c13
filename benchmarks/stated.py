# SPDX-License-Identifier: MIT
"""The errors that the filter states: the share of true errors inside them, and the
parameters that bring it nearest to 95 %."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import methodcaller
from typing import TypeVar

import numpy as np
import scoring
import twin
from scoring import Coverage
from twin import Course, Params

from imud.rotation import FloatArray

# The parameters of the stated errors.
TILT = ("tilt_floor", "tilt_drift")
HEADING = ("heading_floor", "covariance_share", "level_drift", "residual_share")
FACTOR = 2.0  # at most between a drawn parameter and the firmware's, up or down
INSIDE = 0.95  # the share of true errors that stated ones should hold

T = TypeVar("T")


def draws(names: Sequence[str], count: int, seed: int) -> list[dict[str, float]]:
    """Sets of parameters, log-uniform around the firmware's."""
    known = twin.defaults()
    random = np.random.default_rng(seed)
    exponents = random.uniform(-1.0, 1.0, (count, len(names)))
    return [
        known | {n: known[n] * FACTOR**e for n, e in zip(names, row, strict=True)}
        for row in exponents.tolist()
    ]


@dataclass(frozen=True, slots=True)
class Terms:
    """True errors, and the terms whose squares add up to stated ones; degrees."""

    tilt: FloatArray
    heading: FloatArray
    drift: FloatArray  # of tilt, for a tilt_drift of 1
    across: FloatArray  # of heading, for all of the field's covariance
    leaning: FloatArray  # of heading, for a level_drift of 1
    residual: FloatArray  # of heading, for all of what readings surprise by

    @staticmethod
    def of(course: Course, params: Params) -> Terms:
        none = dict(params) | dict.fromkeys((*TILT, *HEADING, "level_sd"), 0.0)
        one, *others = (
            course.track(none | dict.fromkeys(names, 1.0), course.samples)
            for names in (
                ("tilt_drift", "covariance_share"),
                ("level_drift",),
                ("residual_share",),
            )
        )
        found = scoring.errors(one.quats, course.truth)
        terms = (*one.sigmas_deg.T, *(each.sigmas_deg[:, 1] for each in others))
        rows = np.stack([found.inclination, found.heading, *terms])
        return Terms(*rows[:, np.isfinite(rows).all(axis=0)])

    def tilt_inside(self, params: Params) -> float:
        always = params["tilt_floor"] ** 2 + params["level_sd"] ** 2
        squares = always + params["tilt_drift"] ** 2 * self.drift**2
        return share_inside(self.tilt, squares)

    def heading_inside(self, params: Params) -> float:
        squares = (
            params["heading_floor"] ** 2
            + params["covariance_share"] * self.across**2
            + params["level_drift"] ** 2 * self.leaning**2
            + params["residual_share"] * self.residual**2
        )
        return share_inside(self.heading, squares)


def share_inside(errors: FloatArray, squares: FloatArray) -> float:
    return float(np.mean(errors**2 <= scoring.SIGMAS**2 * squares))


def coverage(course: Course, params: Params) -> Coverage:
    """Shares of true errors inside those that the filter states."""
    track = course.track(params, course.samples)
    found = scoring.errors(track.quats, course.truth)
    return scoring.coverage_of(found, *track.sigmas_deg.T)


def by_group(courses: Sequence[Course], values: Iterable[T]) -> dict[str, list[T]]:
    """The values of each group's trials, for groups that occur."""
    found: dict[str, list[T]] = {}
    for course, value in zip(courses, values, strict=True):
        for name in scoring.GROUPS:
            if course.trial.is_in(name):
                found.setdefault(name, []).append(value)
    return found


def honest(
    courses: Sequence[Course], params: Params, count: int, seed: int
) -> dict[str, float]:
    """`params` with stated errors that hold nearest to 95 % of the true ones.

    Every group weighs the same: three trials with a magnet as much as 13 without.
    """
    terms = [Terms.of(course, params) for course in courses]
    found = dict(params)
    for names, inside in ((TILT, "tilt_inside"), (HEADING, "heading_inside")):

        def gap(choice: Params, inside: str = inside) -> float:
            shares = map(methodcaller(inside, choice), terms)
            groups = by_group(courses, shares).values()
            return sum(abs(float(np.mean(group)) - INSIDE) for group in groups)

        best = min(draws(names, count, seed), key=gap)
        found |= {name: best[name] for name in names}
    return found
