# SPDX-License-Identifier: MIT
"""A run of strokes: the motion, the sensor, and the firmware's C that measures it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.common import feed
from benchmarks.common.core import Replay
from benchmarks.common.feed import Chip, Feed
from benchmarks.common.modules import module_of
from imud import rotation
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.motion import Motion, join
from imud.virtual.sensors import (
    HAND_RATE_HZ,
    NO_ERRORS,
    SensorErrors,
    World,
    stream,
)
from imud.virtual.stroking import (
    PAUSE_S,
    PRESSED_S,
    RELEASED_S,
    SETTLES_S,
    SWAYS,
    Plan,
    StrokingHand,
    strokes_of,
)
from imud.wire.messages import Message

ACC_DENSITY = 0.052**2 / 200.0  # (m/s2)^2 s

GYR_DRIFT_DPS_S = 0.003

# What the params of a calibrated module tell of these, m/s2, a fraction, uT; its
# magnetometer is exact.
SIGMAS = {
    "acc": {"sigma_m_s2": 0.01},
    "gyr": {"sigma": 0.0007},
    "mag": {"sigma_uT": 0.05},
}

ALMOST = [[1.0, 2.0**-14, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


@dataclass(frozen=True, slots=True)
class Found:
    """The strokes of a run that have a length, m, a row a stroke; none where there were
    more or fewer strokes.

    `errors`: of each, by the heading at its end. `path`: of all, by that of the last.
    """

    errors: FloatArray
    path: FloatArray
    sigmas: FloatArray


def motion_of(
    plan: Plan,
    seed: int,
    tip_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    errors: SensorErrors = NO_ERRORS,
) -> Motion:
    """All strokes of a plan, and the rests around them."""
    seconds = SETTLES_S + 4.0 + plan.strokes * (plan.seconds + PAUSE_S + 0.1)
    pieces: list[Motion] = []
    hand = stream(
        *(seed, HAND_RATE_HZ, World(tip_m=tip_m), errors),
        lambda random, rate_hz: StrokingHand(random, rate_hz, plan),
        SWAYS[plan.support],
    )
    while sum(map(len, pieces)) < seconds * HAND_RATE_HZ:
        pieces.append(next(hand))
    return join(pieces)[: round(seconds * HAND_RATE_HZ)]


@dataclass(frozen=True, slots=True)
class Case:
    """The measurement: motion, module and procedure."""

    name: str
    plan: Plan
    module: str = "calibrated"
    is_by_button: bool = True
    chip: str = "BROAD"  # whose noise it has


def params_of(case: Case) -> bytes:
    """The probe's params: its calibration, and its button."""
    params = Params()
    if case.module != "raw":
        known = {"bias_counts": [0, 0, 0], "matrix": ALMOST, "method": "guided"}
        for sensor, sigma in SIGMAS.items():
            params = params.replaced(sensor, known | sigma)
    if case.is_by_button:
        params = params.replaced("options", {"button_does": "stroke"})
    return params.encode()


@dataclass(frozen=True, slots=True)
class Run:
    """One motion: without errors, as a module measures it, and as a probe's samples."""

    case: Case
    exact: Motion
    felt: Motion
    sampled: Feed

    @property
    def true(self) -> FloatArray:
        """How far the sensor moves in each stroke, m, a row a stroke."""
        return np.array([stroke.way_m for stroke in strokes_of(self.exact)])

    def presses(self) -> Iterator[tuple[float, bool]]:
        """When the button counts as down and as up, s; nothing where it makes no
        strokes.
        """
        for stroke in strokes_of(self.exact) if self.case.is_by_button else []:
            yield stroke.start_s + PRESSED_S, True
            yield stroke.end_s + RELEASED_S, False


def run_of(case: Case, seed: int, chip: Chip = feed.LSM9DS0) -> Run:
    """A motion of this seed, measured by a module of this seed."""
    random = np.random.default_rng([seed, 3])
    exact = motion_of(case.plan, seed)
    felt = module_of(case.module, random, GYR_DRIFT_DPS_S, case.chip).measures(
        exact, random
    )
    return Run(case, exact, felt, feed.sampled(felt, chip))


def measure(run: Run) -> Found:
    """The strokes of a run, as the probe finds them."""
    ends = [*ends_of(run)]
    turned = np.array([angle for _, _, angle in ends])
    return found_of([message for message, _, _ in ends], turned, run.true)


def ends_of(run: Run) -> Iterator[tuple[Message, float, float]]:
    """What the probe tells when a stroke has ended, when, and by how much its heading
    is wrong then, rad.
    """
    replay = Replay(run.sampled.hello, params_of(run.case))
    changes = run.presses()
    at_s, is_held = next(changes, (np.inf, False))
    for raw, time_s in zip(run.sampled.raws, run.sampled.times_s, strict=True):
        if time_s >= at_s:
            replay.hold(is_held)
            at_s, is_held = next(changes, (np.inf, False))
        replay.step(raw)
        content = replay.stroke(0, 0)
        if content is not None:
            stroke = feed.message_of(content)
            if stroke.fields["end"] != "running":
                quat = np.array(feed.message_of(replay.pose(0, 0)).fields["q"], float)
                yield stroke, float(time_s), heading_of(quat, run.exact, time_s)


def heading_of(quat: FloatArray, exact: Motion, time_s: float) -> float:
    """By how much the heading is wrong at a time, rad: no error of a stroke."""
    assert exact.quat is not None
    true = exact.quat[min(round(time_s * HAND_RATE_HZ), len(exact) - 1)]
    w, _, _, z = rotation.multiply(quat, rotation.inverse(true))
    return float(2.0 * np.arctan2(z, w))


def turned_back(rows: FloatArray, angles: FloatArray | float) -> FloatArray:
    """Each row turned about the vertical by less its angle, rad."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, z = rows.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=-1)


def found_of(ends: Sequence[Message], turned: FloatArray, true: FloatArray) -> Found:
    if len(ends) != len(true):
        return Found(*np.zeros((3, 0, 3)))
    known = [each.fields["displacement"] is not None for each in ends]
    good = [each for each, is_known in zip(ends, known, strict=True) if is_known]
    displacements = np.array([each.fields["displacement"] for each in good]).reshape(
        -1, 3
    )
    sigmas = np.array([each.fields["displacement_sigma"] for each in good])
    return Found(
        turned_back(displacements, turned[known]) - true[known],
        turned_back(displacements, turned[-1:]) - true[known],
        sigmas.reshape(-1, 2)[:, [0, 0, 1]],
    )
