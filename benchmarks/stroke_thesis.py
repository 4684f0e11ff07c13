# SPDX-License-Identifier: MIT
"""Displacement as in the TIPS thesis of 2016 (sections 6 and 8), for comparison.

At its 15 ms a sample: its noise filter of the accelerometer, gravity subtracted, and
trapezoids (8.8), with the drift that a low-pass of 0.7 Hz finds (8.10, 8.11) subtracted
from acceleration, velocity and displacement. The attitude is the true one: the thesis
had none that it trusted, and tested on a level table instead.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence

import numpy as np
import stroke_shapes
import strokes
from numpy.polynomial import Chebyshev
from report import Figure
from stroke_runs import Case, Run, measure, run_of
from stroke_shapes import Shape

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.motion import GRAVITY_M_S2, Motion
from imud.virtual.stroking import Plan, strokes_of

STEP_S = 0.015
CUT_HZ = 0.7
ALPHA = 2.0 * math.pi * CUT_HZ * STEP_S / (2.0 * math.pi * CUT_HZ * STEP_S + 1.0)
# Table I: counts of an accelerometer of 2 g, and the share of a quiet value.
CHANGE, CHANGE_SMALL = (
    counts * 2.0 * GRAVITY_M_S2 / 2**15 for counts in (200.0, 150.0)
)
QUIET = 0.025


def calmed(acc: FloatArray) -> FloatArray:
    """The noise filter of section 6, each axis by itself."""
    out = np.empty_like(acc)
    last = acc[0]
    for index, value in enumerate(acc):
        off = np.abs(value - last)
        last = np.where(
            off > CHANGE,
            value,
            np.where(
                off > CHANGE_SMALL,
                0.5 * (value + last),
                (1.0 - QUIET) * last + QUIET * value,
            ),
        )
        out[index] = last
    return out


def without_drift(x: FloatArray) -> FloatArray:
    """Equation 8.10: less what a low-pass of the samples before has found."""
    drift = np.zeros_like(x)
    for index in range(1, len(x)):
        drift[index] = (1.0 - ALPHA) * drift[index - 1] + ALPHA * x[index - 1]
    return x - drift


def integral(x: FloatArray) -> FloatArray:
    """Equation 8.8."""
    steps = 0.5 * STEP_S * (x[:-1] + x[1:])
    return np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(steps, axis=0)])


def ways(run: Run) -> tuple[FloatArray, FloatArray]:
    """Of each stroke what the thesis' method tells, m: the displacement at its end,
    world frame, and the distance travelled, which is the sum of all shifts along it,
    whatever their sign, from its start until half a second after its end.
    """
    samples = run.sampled.samples
    times = np.arange(0.0, float(run.sampled.times_s[-1]), STEP_S)
    latest = np.searchsorted(run.sampled.times_s, times, side="right") - 1
    acc = calmed(samples.acc[latest.clip(0)])
    quat = run.exact.quat
    assert quat is not None
    true = quat[np.rint(times * run.exact.rate_hz).astype(int)]
    free = rotation.rotate(true, acc) - np.array([0.0, 0.0, GRAVITY_M_S2])
    shifts = without_drift(integral(without_drift(free)))
    place = without_drift(integral(shifts))
    moved, travelled = [], []
    for stroke in strokes_of(run.exact):
        first, last = np.searchsorted(times, [stroke.start_s, stroke.end_s])
        after = np.searchsorted(times, stroke.end_s + 0.5)
        moved.append(place[last] - place[first])
        along = stroke.way_m / np.linalg.norm(stroke.way_m)
        travelled.append(STEP_S * float(np.sum(np.abs(shifts[first:after] @ along))))
    return np.array(moved), np.array(travelled)


# Table II: 10 cm along the three axes of a level sensor, 15 times. In its figures 8.3
# to 8.11 a stroke takes 30 samples; a stroke of 2 s is for comparison.
TABLE_II_S = (0.45, 1.0)
SLOW_S = 2.0
TABLE_II_CM = (
    *(8.26, 7.24, 19.28, 8.82, 6.39, 10.10, 4.18, 8.98),
    *(15.55, 12.65, 10.06, 2.69, 15.72, 8.04, 9.95),
)
STRAIGHT = Chebyshev([0.5, 0.5], domain=[0, 1])
NOTHING = Chebyshev([0.0], domain=[0, 1])


def table_ii(plan: Plan, seed: int) -> Motion:
    """Straight strokes along the axis of a level sensor that the seed names: 0 to 2."""
    random = np.random.default_rng([seed, 6])
    heading = float(random.uniform(-np.pi, np.pi))
    path = tuple(STRAIGHT if axis == seed % 3 else NOTHING for axis in range(3))
    shape = Shape("Table II", path, (NOTHING,) * 3)
    level = rotation.from_heading_pitch_roll(heading, 0.0, 0.0)
    return stroke_shapes.chain(random, plan, level, lambda: (shape, heading))


def table_ii_rows(seconds: float, first_seed: int) -> FloatArray:
    """Of each stroke, cm: our length, our error, and the thesis' method's displacement
    and distance travelled.
    """
    case = Case(f"Table II, {seconds:g} s", Plan(seconds, strokes=5), motion=table_ii)
    rows = []
    for axis in range(3):
        run = run_of(case, first_seed + axis)
        found = measure(run)
        moved, travelled = ways(run)
        ours = np.linalg.norm(found.errors + run.true, axis=1)
        error = np.linalg.norm(found.errors, axis=1)
        rows.append(np.stack([ours, error, np.linalg.norm(moved, axis=1), travelled]))
    return 100.0 * np.concatenate(rows, axis=1).T


def both(case: Case, seeds: Sequence[int]) -> FloatArray:
    """The errors of each stroke, cm: ours, and those of the thesis' method."""
    rows = []
    for seed in seeds:
        run = run_of(case, seed)
        ours = measure(run).errors
        if len(ours) == len(run.true):
            rows.append(np.linalg.norm([ours, ways(run)[0] - run.true], axis=2))
    return 100.0 * np.concatenate(rows, axis=1)


def print_table_ii(seconds: float) -> FloatArray:
    """Prints the table with strokes of this time; our errors, cm."""
    rows = table_ii_rows(seconds, 3 * round(100 * seconds))
    print(f"\nTable II, strokes of {seconds:g} s, cm")
    print(" n  printed    ours   error   thesis: end   travelled")
    for number, (row, printed) in enumerate(zip(rows, TABLE_II_CM, strict=True), 1):
        ours, error, end, sums = row
        print(
            f"{number:2d}{printed:9.2f}{ours:8.2f}{error:8.2f}{end:14.2f}{sums:12.2f}"
        )
    return np.asarray(rows[:, 1])


COMPARED = (
    *("supported, 0.75 s", "supported, 1 s", "supported, 2 s"),
    *("on paper, 2 s", "free air, 2 s"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=8, help="of 8 strokes, a case")
    args = parser.parse_args(arguments)
    print(f"{'errors, cm: median, p95':24}{'ours':>14}{'the thesis method':>22}")
    for case in strokes.CASES:
        if case.name in COMPARED:
            seeds = range(1, 2 * args.runs, 2)
            errors = both(case, [1000 * strokes.CASES.index(case) + s for s in seeds])
            low, high = np.quantile(errors, (0.5, 0.95), axis=1).T
            print(
                f"{case.name:24}{low[0]:8.2f}{low[1]:6.2f}{high[0]:16.2f}{high[1]:6.2f}"
            )
    figures: list[Figure] = []
    for seconds in (*TABLE_II_S, SLOW_S):
        error = print_table_ii(seconds)
        name = f"Table II, {seconds:g} s"
        must, goal = (1.0, 0.5) if seconds in TABLE_II_S else (np.inf, np.inf)
        rms = float(np.sqrt(np.mean(error**2)))
        figures += [
            Figure(f"{name}: worst, cm", float(error.max()), (0, must), (0, must)),
            Figure(f"{name}: rms, cm", rms, (0, must), (0, goal)),
        ]
    print(*figures, sep="\n")
    return 1 if any(each.verdict == "MISSED" for each in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
