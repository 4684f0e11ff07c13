# SPDX-License-Identifier: MIT
"""How simulated modules are calibrated: how often and where they are laid, and whether
that is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.calibration import simulated
from imud.calibration import poses
from imud.calibration.algebra import units
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided import faults, whole
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import find_stops
from imud.rotation import FloatArray
from imud.virtual.calibrating import Manners
from imud.virtual.modules import shop
from imud.virtual.motions.module import Module
from imud.virtual.sensors import World


@dataclass(frozen=True, slots=True)
class Case:
    """How modules are calibrated."""

    name: str
    poses: int = 12
    stop_s: float = 2.0
    user: str = "guided"
    uneven_ut: float = 0.0
    warm_degc: float = 0.0
    is_held: bool = False
    has_housing: bool = False


CASES = (
    Case("12 poses"),
    Case("4 poses", poses=4),
    Case("6 poses", poses=6),
    Case("9 poses", poses=9),
    Case("18 poses", poses=18),
    Case("12, stops of 1 s", stop_s=1.0),
    Case("12, six faces only", user="faces"),
    Case("12, never upside down", user="upright"),
    Case("12, lazy: 20 degrees of tilt", user="lazy"),
    Case("12, field uneven by 2 uT", uneven_ut=2.0),
    Case("12, field uneven by 5 uT", uneven_ut=5.0),
    Case("12, 5 degC of warm-up", warm_degc=5.0),
    Case("12 and the housing", has_housing=True),
)
USERS = ("guided", "faces", "free", "upright", "lazy", "two axes")


def ups_of(case: Case, random: np.random.Generator) -> list[FloatArray | None]:
    """Where up is in the body, pose by pose; None: half a turn where it lies."""
    count = case.poses
    faces = [pose.up for pose in poses.ALL[:6]]
    if case.user == "guided":
        order = [*poses.TWELVE, *(p for p in poses.ALL if p not in poses.TWELVE)]
        found = np.array([pose.up for pose in order[:count]])
    elif case.user == "faces":
        found = np.array([faces[index % 6] for index in range(count)])
    else:
        found = random.standard_normal((count, 3))
        if case.user == "upright":
            found[:, 2] = np.abs(found[:, 2]) + 0.1
        elif case.user == "lazy":
            found = np.append(0.35 * found[:, :2], np.ones((count, 1)), axis=1)
        elif case.user == "two axes":
            found[:, 0] *= 0.15
    ups: list[FloatArray | None] = list(units(found))
    return [*ups, poses.BASE_DOWN.up, None] if case.has_housing else ups


@dataclass(frozen=True, slots=True)
class Laid:
    """A module in a hand, and how that lays it."""

    module: Module
    seed: int
    ups: list[FloatArray | None]
    manners: Manners
    world: World

    def recording(self, more: Sequence[FloatArray] = ()) -> SensorRecording:
        """With `more` poses after its own."""
        ups = [*self.ups, *more]
        return simulated.recorded(
            simulated.samples(self.module, self.seed, ups, self.manners, self.world)
        )


def laid(case: Case, seed: int) -> Laid:
    """A module, as the case has it."""
    random = np.random.default_rng([seed, 0xCA11])
    module = shop(random, case.warm_degc)
    manners = Manners(
        stop_s=case.stop_s,
        off_rad=math.radians(2.0 if case.user == "faces" else 8.0),
        is_held=case.is_held,
    )
    world: World = simulated.EARTH
    if case.uneven_ut > 0.0:
        world = simulated.uneven(case.uneven_ut, random)
    return Laid(module, seed, ups_of(case, random), manners, world)


def crowd(seed: int) -> Case:
    """A recording of any kind."""
    random = np.random.default_rng([seed, 0xC0D])
    return Case(
        "any",
        poses=int(random.integers(4, 19)),
        stop_s=float(random.uniform(0.75, 3.0)),
        user=str(random.choice(USERS)),
        uneven_ut=float(random.choice([0.0, random.uniform(0.0, 6.0)])),
        warm_degc=float(random.choice([0.0, random.uniform(0.0, 8.0)])),
        is_held=bool(random.random() < 0.15),
    )


Judged = tuple[ModuleFit | None, CalibrationFault | None]


def judged(recording: SensorRecording) -> Judged:
    """Its fit, and the reason for refusing it."""
    fit, stops = whole.fit(recording), find_stops(recording)
    fault = faults.of_module(recording, stops, fit)
    fault = fault or faults.of_score(fit, len(stops), has_mag=True)
    return fit, fault
