# SPDX-License-Identifier: MIT
"""Strokes by the method of the TIPS thesis of 2016 (sections 6 and 8), and by the
firmware's C, from the same samples. Prints tables and writes
build/benchmarks/strokes-thesis.json; docs/strokes-methods.md explains them.

The thesis' method takes a sample each 15 ms. It calms the accelerometer with a noise
filter, subtracts gravity and integrates by trapezoids (8.8). From acceleration, from
velocity and from displacement it subtracts the drift that a low-pass of 0.7 Hz finds
(8.10, 8.11). The attitude is the true one: the thesis had none that it trusted, and
used a level table.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict

import numpy as np

from benchmarks.common.figure import SETS, Figure
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.strokes import on_host
from benchmarks.strokes.runs import Case, Run, measure, run_of
from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.hand import HandMove, Stance
from imud.virtual.stroking import PAUSE_S, SETTLES_S, Plan, strokes_of

OUTPUT = RESULTS / "strokes-thesis.json"

STEP_S = 0.015
CUT_HZ = 0.7
ALPHA = 2.0 * math.pi * CUT_HZ * STEP_S / (2.0 * math.pi * CUT_HZ * STEP_S + 1.0)
# Table I: counts of an accelerometer of 2 g, and the share of a quiet value.
CHANGE, CHANGE_SMALL = (
    counts * 2.0 * GRAVITY_M_S2 / 2**15 for counts in (200.0, 150.0)
)
QUIET = 0.025

COMPARED = (
    *("supported, 0.75 s", "supported, 1 s", "supported, 2 s"),
    *("on paper, 2 s", "free air, 2 s"),
)

# Table II: 10 cm along the three axes of a level sensor, 15 times. In its figures 8.3
# to 8.11 a stroke takes 30 samples; strokes of 1 and 2 s are for comparison.
TABLE_II_S = (0.45, 1.0, 2.0)
TABLE_II_CM = (
    *(8.26, 7.24, 19.28, 8.82, 6.39, 10.10, 4.18, 8.98),
    *(15.55, 12.65, 10.06, 2.69, 15.72, 8.04, 9.95),
)
LIMITS = {0.45: (1.0, 0.5), 1.0: (1.0, 0.5)}  # of the worst and the rms error, cm


def calmed(acc: FloatArray) -> FloatArray:
    """The noise filter of section 6, each axis by itself."""
    out = np.empty_like(acc)
    last = acc[0]
    for index, value in enumerate(acc):
        off = np.abs(value - last)
        quiet = (1.0 - QUIET) * last + QUIET * value
        last = np.where(off > CHANGE_SMALL, 0.5 * (value + last), quiet)
        out[index] = last = np.where(off > CHANGE, value, last)
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
    times = np.arange(0.0, float(run.sampled.times_s[-1]), STEP_S)
    latest = np.searchsorted(run.sampled.times_s, times, side="right") - 1
    acc = calmed(run.sampled.samples.acc[latest.clip(0)])
    assert run.exact.quat is not None
    true = run.exact.quat[np.rint(times * run.exact.rate_hz).astype(int)]
    free = rotation.rotate(true, acc) - np.array([0.0, 0.0, GRAVITY_M_S2])
    shifts = without_drift(integral(without_drift(free)))
    place = without_drift(integral(shifts))
    moved, travelled = [], []
    for stroke in strokes_of(run.exact):
        first, last, after = np.searchsorted(
            times, [stroke.start_s, stroke.end_s, stroke.end_s + 0.5]
        )
        moved.append(place[last] - place[first])
        along = stroke.way_m / np.linalg.norm(stroke.way_m)
        travelled.append(STEP_S * float(np.sum(np.abs(shifts[first:after] @ along))))
    return np.array(moved), np.array(travelled)


class LevelHand:
    """Rests, then straight strokes along an axis of a level sensor, with rests."""

    def __init__(
        self, random: np.random.Generator, rate_hz: float, plan: Plan, *, axis: int
    ) -> None:
        self._random, self._rate_hz, self._plan = random, rate_hz, plan
        heading = float(random.uniform(-np.pi, np.pi))
        self._quat = rotation.from_heading_pitch_roll(heading, 0.0, 0.0)
        self._way = rotation.rotate(self._quat, plan.length_m * np.eye(3)[axis])

    def moves(self) -> Iterator[HandMove]:
        def move(start: int, end: int, seconds: float) -> HandMove:
            """From the end of one stroke to that of another."""
            before, after = (
                Stance(number * self._way, self._quat, held=0.0, free=0.0)
                for number in (start, end)
            )
            records = round(seconds * self._rate_hz)
            return HandMove(before, after, records, is_stroke=start != end)

        yield move(0, 0, SETTLES_S + PAUSE_S)
        for number in range(self._plan.strokes):
            yield move(number, number, PAUSE_S + self._random.uniform(0.0, 0.1))
            yield move(number, number + 1, self._plan.seconds)
        while True:
            yield move(self._plan.strokes, self._plan.strokes, PAUSE_S)


def table_ii(seconds: float, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each stroke, cm: our length, our error, and the distance travelled by the
    thesis' method.
    """
    rows = []
    for axis in range(3):
        hand = functools.partial(LevelHand, axis=axis)
        case = Case("Table II", Plan(seconds, strokes=5), hand=hand)
        run = run_of(case, seed + 2 * axis)
        errors = measure(run).errors
        if len(errors) != len(run.true):
            raise SystemExit(f"Table II, {seconds:g} s: a stroke has no length")
        ours = np.linalg.norm(errors + run.true, axis=1)
        rows.append(np.array([ours, np.linalg.norm(errors, axis=1), ways(run)[1]]))
    ours, error, travelled = 100.0 * np.concatenate(rows, axis=1)
    return ours, error, travelled


def spread(lengths: Sequence[float] | FloatArray) -> dict[str, float]:
    """Of lengths in cm, where each should be 10."""
    return {
        "least": float(np.min(lengths)),
        "mean": float(np.mean(lengths)),
        "most": float(np.max(lengths)),
        "within 1 cm": int(np.sum(np.abs(np.subtract(lengths, 10.0)) < 1.0)),
    }


def both(case: Case, seeds: Sequence[int]) -> FloatArray:
    """The errors of each stroke that has a length, cm: ours, and those of the thesis'
    method.
    """
    rows = []
    for seed in seeds:
        run = run_of(case, seed)
        ours = measure(run).errors
        if len(ours) == len(run.true):
            rows.append(np.linalg.norm([ours, ways(run)[0] - run.true], axis=2))
    return 100.0 * np.concatenate(rows, axis=1)


def compare(runs: int, first: int) -> dict[str, dict[str, dict[str, float]]]:
    """Print and return the errors in the cases of on_host.py, on its seeds."""
    print(f"{'errors, cm: median, p95':24}{'ours':>14}{'the thesis method':>22}")
    found = {}
    for number, case in enumerate(on_host.CASES):
        if case.name not in COMPARED:
            continue
        errors = both(case, [1000 * number + first + 2 * run for run in range(runs)])
        low, high = np.quantile(errors, (0.5, 0.95), axis=1).tolist()
        print(
            f"{case.name:24}{low[0]:8.2f}{high[0]:6.2f}{low[1]:16.2f}{high[1]:6.2f}",
            flush=True,
        )
        found[case.name] = {
            name: {"median_cm": median, "p95_cm": p95}
            for name, median, p95 in zip(("ours", "thesis"), low, high, strict=True)
        }
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=30, help="of 8 strokes, a case")
    args = parser.parse_args(arguments)
    first = SETS["judging"]
    cases = compare(args.runs, first)
    lengths = {"printed": spread(TABLE_II_CM)}
    errors = {}
    figures: list[Figure] = []
    for number, seconds in enumerate(TABLE_II_S):
        ours, error, travelled = table_ii(seconds, 100 * number + first)
        name = f"{seconds:g} s"
        lengths[f"thesis, {name}"], lengths[f"ours, {name}"] = map(
            spread, (travelled, ours)
        )
        worst, rms = float(error.max()), float(np.sqrt(np.mean(error**2)))
        errors[name] = {"worst": worst, "rms": rms, "over 1 cm": int(sum(error > 1.0))}
        must, goal = LIMITS.get(seconds, (np.inf, np.inf))
        figures += [
            Figure(f"Table II, {name}: worst, cm", worst, (0, must), (0, must)),
            Figure(f"Table II, {name}: rms, cm", rms, (0, must), (0, goal)),
        ]
    print(
        f"\n{'Table II, lengths, cm':24}{'least':>8}{'mean':>8}{'most':>8}  within 1 cm"
    )
    for name, row in lengths.items():
        print(f"{name:24}" + "".join(f"{each:8.4g}" for each in row.values()))
    print(*figures, sep="\n")
    report = {
        "runs": args.runs,
        "cases": cases,
        "lengths_cm": lengths,
        "errors_cm": errors,
        "figures": [asdict(each) for each in figures],
    }
    write_results(OUTPUT, report)
    return 1 if any(each.verdict == "MISSED" for each in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
