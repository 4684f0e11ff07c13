# SPDX-License-Identifier: MIT
"""How well the tip is found from positions of the sensor that are known to 1 mm and
attitudes that are known to 0.3 degrees. Prints a table and writes
build/benchmarks/tip-positions.json; docs/tip.md explains it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from benchmarks.common.paths import RESULTS, write_results
from imud.calibration.affine import MethodError
from imud.calibration.algebra import onto, turn, units
from imud.calibration.path import UP
from imud.calibration.tip.positions import axis_of, circle, pivot, sphere
from imud.rotation import FloatArray

OUTPUT = RESULTS / "tip-positions.json"

SEED, RUNS = 0x7199, 300
LONG_M, ERROR_M, MISSED_DEG = 0.15, 1e-3, 0.3
LEAN_DEG = 30.0

# The error of one run, and what is stated for 95 %.
Measured = tuple[float, float]


def cone(random: np.random.Generator, count: int) -> tuple[FloatArray, ...]:
    """Places and attitudes of a probe that leans about its tip, and the tip."""
    tip = LONG_M * units(random.standard_normal(3))
    lean = np.radians(LEAN_DEG) * np.sqrt(random.uniform(0.0, 1.0, count))
    around = random.uniform(0.0, 2.0 * np.pi, count)
    twist = random.normal(0.0, 0.3, count)
    leans = np.stack([lean * np.cos(around), lean * np.sin(around), twist], axis=1)
    attitudes = turn(leans) @ onto(units(tip), -UP)
    return *measured(random, -attitudes @ tip, attitudes), tip


def ring(
    random: np.random.Generator, count: int, radius_m: float, turned: float
) -> tuple[FloatArray, ...]:
    """The same of a probe that is turned about its upright axis, and that axis."""
    angle = np.linspace(0.0, 2.0 * np.pi * turned, count, endpoint=False)
    turns = turn(angle[:, None] * UP)
    upright = turn(random.normal(0.0, 1.0, 3))
    places = turns @ np.array([radius_m, 0.0, LONG_M])
    return *measured(random, places, turns @ upright), upright.T @ UP


def measured(
    random: np.random.Generator, places: FloatArray, attitudes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """With the errors of a tracker."""
    off = random.normal(0.0, ERROR_M, places.shape)
    missed = random.normal(0.0, np.radians(MISSED_DEG), places.shape)
    return places + off, attitudes @ turn(missed)


def of_poses(random: np.random.Generator, count: int) -> Measured:
    places, attitudes, tip = cone(random, count)
    found = pivot(places, attitudes, ERROR_M)
    sigma = float(np.sqrt(np.mean(found.sigma_m**2)))
    return 1e3 * float(np.linalg.norm(found.offset_m - tip)), 2.8e3 * sigma


def of_sphere(random: np.random.Generator, count: int) -> Measured:
    found = sphere(cone(random, count)[0], ERROR_M)
    return 1e3 * abs(found.radius - LONG_M), 1.96e3 * found.sigma_m


def of_ring(
    random: np.random.Generator, count: int, radius_m: float, turned: float
) -> Measured:
    places, attitudes, axis = ring(random, count, radius_m, turned)
    found = axis_of(circle(places, ERROR_M), attitudes)
    off = float(np.linalg.norm(np.cross(found.axis, axis)))
    return float(np.degrees(off)), 2.45 * float(np.degrees(found.sigma_rad))


ROWS: tuple[tuple[str, Callable[[np.random.Generator], Measured]], ...] = (
    *(
        (
            f"{n} positions and attitudes: tip, mm",
            lambda random, n=n: of_poses(random, n),
        )
        for n in (4, 10, 30, 100)
    ),
    *(
        (
            f"{n} positions, sphere: distance, mm",
            lambda random, n=n: of_sphere(random, n),
        )
        for n in (10, 30, 100)
    ),
    *(
        (
            f"{n} on a circle of {1e3 * radius:.0f} mm, {turned:g} turns: axis, deg",
            lambda random, n=n, radius=radius, turned=turned: of_ring(
                random, n, radius, turned
            ),
        )
        for n, radius, turned in (
            *((3, 0.02, 1.0), (30, 0.02, 1.0)),
            *((3, 0.075, 1.0), (30, 0.075, 1.0), (30, 0.02, 0.25)),
        )
    ),
)


def main() -> int:
    print(f"{'':48}{'found %':>9}{'median':>8}{'p95':>8}{'inside':>8}")
    rows: dict[str, dict[str, float]] = {}
    for name, once in ROWS:
        random, found = np.random.default_rng(SEED), []
        for _ in range(RUNS):
            try:
                found.append(once(random))
            except MethodError:
                continue
        errors, stated = np.array(found).T
        row = rows[name] = {
            "found": 100.0 * len(found) / RUNS,
            "median": float(np.median(errors)),
            "p95": float(np.quantile(errors, 0.95)),
            "inside": 100.0 * float(np.mean(errors <= stated)),
        }
        print(
            f"{name:48}{row['found']:9.0f}{row['median']:8.2f}{row['p95']:8.2f}"
            f"{row['inside']:8.1f}"
        )
    write_results(OUTPUT, {"runs": RUNS, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
