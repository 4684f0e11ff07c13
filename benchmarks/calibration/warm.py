# SPDX-License-Identifier: MIT
"""The stated and the true tilt errors of poses 30 K from the temperature of the
calibration: modules whose accelerometers drift, at rest in any attitude, by the
firmware's C. Once as calibrated once, and once as calibrated at two temperatures, of
which the second calibration learns the drift.

Prints a table and writes build/benchmarks/warm.json; seeds for judging are not used
during development.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from benchmarks.accuracy import report
from benchmarks.calibration import simulated
from benchmarks.common import engines, jobs, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST
from benchmarks.common.feed import sampled
from benchmarks.common.figure import SETS, Figure
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.honesty.cases import EARTH_UT, SAMPLES_C
from imud import rotation
from imud.calibration.guided import whole
from imud.calibration.guided.result import result_of_fit
from imud.params.trusted import known_to, place_of
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import calibrated, shop
from imud.virtual.motions.groups import exact
from imud.virtual.motions.module import MG
from imud.virtual.motions.ride import Ride, times
from imud.virtual.motions.room import Room

OUTPUT = RESULTS / "warm.json"

MODULES = 100  # of each kind
AWAY_K = 30.0  # from the calibration
APART_K = (10.0, 35.0)  # between two calibrations
ATTITUDES = 3  # of a module
SECONDS, SETTLED_S = 20.0, 12.0
INSIDE = 1.96  # sigmas
MUST, GOAL = (93.0, 100.0), (95.0, 100.0)
SALT = 0x3A12

# How the drifts of axes are distributed, mg/K. PS-MPU-9250A-01, table 2, has 1.5.
KINDS: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "0.8 mg/K, normal": lambda random: random.normal(0.0, 0.8, 3),
    "up to 1.5 mg/K": lambda random: random.uniform(-1.5, 1.5, 3),
    "0.2 mg/K, normal": lambda random: random.normal(0.0, 0.2, 3),
}


@dataclass(frozen=True, slots=True)
class Row:
    """Of one module: true and stated errors of tilt, degrees, once for each
    attitude; by one calibration and by two.
    """

    kind: str
    once: list[tuple[float, float]]
    twice: list[tuple[float, float]]


def calibrations(seed: int, drift: FloatArray) -> tuple[Params, FloatArray]:
    """The params of the second of two guided calibrations, and by how much their bias
    is wrong at its own temperature, m/s2.
    """
    random = np.random.default_rng([seed, SALT])
    apart_k = random.uniform(*APART_K) * random.choice([-1.0, 1.0])
    module, params, left = shop(random, 0.0), Params(), np.zeros(3)
    for index, degc in enumerate((SAMPLES_C - apart_k, SAMPLES_C)):
        bias = module.acc_bias + drift * (degc - SAMPLES_C)
        feeling = replace(module, acc_bias=bias)
        samples = simulated.samples(feeling, 2 * seed + index)
        fit = whole.fit(simulated.recorded(samples))
        assert fit is not None
        fit = replace(fit, temperature_c=degc)
        params = result_of_fit(fit, SCALE, params).params
        left = bias - fit.acc.bias
    return params, left


def stated(of: Calibration | None, error: FloatArray, seed: int) -> tuple[float, float]:
    """The tilt's error and its stated sigma of a probe at rest AWAY_K from the
    calibration, whose accelerometer is then off by `error`.
    """
    assert of is not None
    assert of.sigma is not None
    random = np.random.default_rng([seed, SALT, 1])
    records = Params.decode(
        known_to(of.sigma, 0.05, temperature_c=SAMPLES_C - AWAY_K, **place_of(EARTH_UT))
    )
    acc = {**(records.plain("acc") or {}), "drift_m_s2_k": of.drift_m_s2_k}
    lean = rotation.from_rotation_vector(
        math.pi * random.uniform(-1.0, 1.0, 3) / math.sqrt(3.0)
    )
    ride = Ride(RigidBody.still(lean, len(times(SECONDS))), rest_s=-1.0)
    motion = calibrated().measures(exact(ride, Room(EARTH_UT)), random)
    motion = replace(motion, acc=motion.acc + error)
    fed = sampled(motion, BOARDS["nano"].chip, records.replaced("acc", acc).encode())
    found = engines.ENGINES[HOST](fed)
    assert found.tilt_sigma_deg is not None
    errors = scoring.errors_at(found.times_s, found.quats, motion)
    keep = found.times_s > SETTLED_S
    return (
        float(np.sqrt(np.mean(errors.inclination[keep] ** 2))),
        float(np.median(found.tilt_sigma_deg[keep])),
    )


def measure(run: tuple[str, int]) -> Row:
    """A module of a kind."""
    kind, seed = run
    drift = MG * KINDS[kind](np.random.default_rng([seed, SALT, 2]))
    params, left = calibrations(seed, drift)
    error, twice = left + AWAY_K * drift, params.acc
    assert twice is not None
    once = msgspec.structs.replace(twice, drift_m_s2_k=None)
    tasks = [ATTITUDES * seed + index for index in range(ATTITUDES)]
    return Row(
        kind,
        [stated(once, error, task) for task in tasks],
        [stated(twice, error, task) for task in tasks],
    )


HEADS = ("true rms", "stated", "inside 95 %, %", "true / stated", "verdict")


def line_of(errors: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Of one kind and one way to calibrate it; angles in degrees."""
    true, sigma = np.array(errors).T
    return {
        "true_rms_deg": float(np.sqrt(np.mean(true**2))),
        "stated_deg": float(np.median(sigma)),
        "inside": 100.0 * float((true <= INSIDE * sigma).mean()),  # %
        "true_over_stated": float(np.sqrt(np.mean((true / sigma) ** 2))),
    }


def cells(line: dict[str, float]) -> list[str]:
    """A row of the table, as HEADS name it."""
    inside = Figure("", line["inside"], MUST, GOAL)
    return [
        f"{line['true_rms_deg']:.2f}",
        f"{line['stated_deg']:.2f}",
        f"{inside.value:.1f}",
        f"{line['true_over_stated']:.2f}",
        inside.verdict,
    ]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/calibration/warm.py --jobs 2"
    )
    parser.add_argument("--set", choices=SETS, default="judging")
    parser.add_argument("--modules", type=int, default=MODULES, help="of each kind")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(argv)
    seeds = [2 * index + SETS[args.set] for index in range(args.modules)]
    work = [(kind, seed) for kind in KINDS for seed in seeds]
    rows = list(jobs.each(measure, work, args.jobs, "modules"))
    lines = {}
    for kind in KINDS:
        of = [row for row in rows if row.kind == kind]
        for how in ("once", "twice"):
            errors = [each for row in of for each in getattr(row, how)]
            lines[f"{kind}, calibrated {how}"] = line_of(errors)
    title = f"{args.set}, {AWAY_K:.0f} K away, {args.modules} modules a line: degrees"
    report.print_table(title, HEADS, {name: cells(lines[name]) for name in lines})
    found = {"set": args.set, "modules": args.modules, "lines": lines}
    write_results(OUTPUT, found)


if __name__ == "__main__":
    main(sys.argv[1:])
