# SPDX-License-Identifier: MIT
"""What a sensor's noise does to strokes, and whether the stated errors know it; and the
way there and back to a mark.

A cell of the first table: the median error in mm, the percentage of errors within 1.96
of the stated sigma, and the rms of what is stated over that of the true errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks import harness
from benchmarks.common.boards import F405
from benchmarks.common.modules import DENSITIES
from benchmarks.harness import Figure, Report, Table
from benchmarks.strokes.runs import SIGMAS, Case, Found, measure, run_of
from imud.gravity import GRAVITY_M_S2
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual.stroking import Plan

CASES = [
    *(Case(f"supported, {t:g} s", Plan(seconds=t)) for t in (0.75, 1.0, 2.0, 3.0)),
    *(Case(f"{cm} cm, 1 s", Plan(length_m=cm / 100)) for cm in (1, 5, 30)),
    Case("turned by 15 deg rms, 2 s", Plan(seconds=2.0, turn_deg=15.0)),
    *(Case(f"raw module, {t:g} s", Plan(seconds=t), module="raw") for t in (1.0, 2.0)),
    *(
        Case(f"between rests, {t:g} s", Plan(seconds=t), is_by_button=False)
        for t in (1.0, 2.0)
    ),
    *(Case(f"hand, {t:g} s", Plan(seconds=t, support="hand")) for t in (1.0, 2.0, 3.0)),
    Case("1 cm, hand, 1 s", Plan(length_m=0.01, support="hand")),
]
# A hand that hardly moves for what it turns, and a path that hardly accelerates: what
# is stated for others is too much for these.
QUIET = [
    Case("along a ruler, 2 s", Plan(seconds=2.0, turn_deg=0.0), is_by_button=False),
    *(Case(f"on paper, {t:g} s", Plan(seconds=t, support="paper")) for t in (1.0, 2.0)),
    *(Case(f"free air, {t:g} s", Plan(seconds=t, support="air")) for t in (1.0, 2.0)),
]
# There and back to a mark, to which a hand returns within so much, m, an axis.
RETURN_M = 0.001
LINE = ((0.0, 0.0), (0.1, 0.0))
BACK = [
    Case(f"{title}, 2 s", Plan(seconds=2.0, support=support, corners=LINE))
    for title, support in (
        ("supported", "supported"),
        ("free air", "air"),
        ("hand", "hand"),
    )
]
PAIRS = 8  # runs have two strokes only: so many times as many of them

# Of a chip: the most of the median of 2 s on a support, mm.
MEDIANS = {"MPU-9250": (3.5, 3.0), "LSM6DSOX": (1.3, 1.0), "LSM6DSV": (1.2, 0.9)}
# Of the way there and back in free air: the least share under 1 cm, %.
UNDER = {"BROAD": (88.0, 95.0), "LSM6DSV": (95.0, 99.0)}


def found_of(case: Case, seeds: Sequence[int]) -> Found:
    """The strokes of some runs, one after the other; of a path only whole runs."""
    chip = replace(F405.chip, board=F405.name)
    runs = [measure(run_of(case, seed, chip)) for seed in seeds]
    if case.plan.corners:
        runs = [run for run in runs if len(run.errors) == case.plan.strokes]
    return Found(
        *(
            np.concatenate([getattr(run, name) for run in runs])
            for name in ("errors", "path", "sigmas")
        )
    )


def judged(errors: FloatArray, sigmas: FloatArray) -> tuple[float, float, float]:
    """Median length, mm; percentage inside 1.96 sigma; stated over true."""
    return (
        1000.0 * float(np.median(np.linalg.norm(errors, axis=1))),
        100.0 * float(np.mean(np.abs(errors) < 1.96 * sigmas)),
        float(np.sqrt(np.mean(sigmas**2) / np.mean(errors**2))),
    )


def there_and_back(
    found: Found, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Errors of the far point by two strokes each, and their sigmas, m: half of the
    difference of both. The scale does not average, and the return is not exact.
    """
    there, back = found.errors[::2], found.errors[1::2]
    off = random.normal(0.0, RETURN_M, there.shape)
    scale = SIGMAS["acc"]["sigma_m_s2"] / GRAVITY_M_S2 * LINE[1][0]
    square = found.sigmas[::2] ** 2 + found.sigmas[1::2] ** 2 + RETURN_M**2
    return (there - back - off) / 2.0, np.sqrt(square / 4.0 + scale**2)


def under_1_cm(errors: FloatArray) -> float:
    return 100.0 * float(np.mean(np.linalg.norm(errors, axis=1) < 0.01))


def figures_of(
    cells: dict[tuple[str, str], tuple[float, float, float]],
) -> Iterator[Figure]:
    for chip, (must, goal) in MEDIANS.items():
        value = cells["supported, 2 s", chip][0]
        title = f"supported, 2 s, {chip}: median, mm"
        yield Figure(title, value, (0, must), (0, goal))
    value = cells["30 cm, 1 s", "LSM6DSV"][0]
    yield Figure("30 cm, 1 s, LSM6DSV: median, mm", value, (0, 0.65), (0, 0.5))
    loud = {
        key: cell for key, cell in cells.items() if key[0] in {c.name for c in CASES}
    }
    for title, pick in (("least", min), ("most", max)):
        key = pick(loud, key=lambda each: loud[each][1])
        name, value = f"inside 95 %, %, {title}", loud[key][1]
        yield Figure(name, value, (90, 99), (93, 98), ", ".join(key))
    key = max(loud, key=lambda each: loud[each][2])
    yield Figure(
        "stated / true, most", loud[key][2], (0, 1.6), (0, 1.3), ", ".join(key)
    )


def measured(args: argparse.Namespace) -> Report:
    cases = [*CASES, *QUIET, *BACK]
    progress = Progress("strokes by chip", len(cases))
    cells: dict[tuple[str, str], tuple[float, float, float]] = {}
    ways: list[list[object]] = []
    figures: list[Figure] = []
    for number, case in enumerate(cases):
        for chip in DENSITIES:
            one = replace(case, chip=chip)
            seeds = harness.seeds_of(args, 50_000 + 1000 * number)
            if case not in BACK:
                found = found_of(one, seeds)
                cells[case.name, chip] = judged(found.errors, found.sigmas)
                continue
            one = replace(one, plan=replace(case.plan, strokes=2 * PAIRS))
            found = found_of(one, seeds)
            errors, sigmas = there_and_back(found, np.random.default_rng(number))
            share = under_1_cm(errors)
            one_way = (under_1_cm(found.errors), *judged(found.errors, found.sigmas))
            ways.append([case.name, chip, *one_way, share, *judged(errors, sigmas)])
            if case.plan.support == "air" and chip in UNDER:
                must, goal = UNDER[chip]
                title = f"there and back in free air, {chip}: under 1 cm, %"
                figures.append(Figure(title, share, (must, 100), (goal, 100)))
        progress.update(number + 1)
    return Report(tables_of(cells, ways), [*figures_of(cells), *figures])


def tables_of(
    cells: dict[tuple[str, str], tuple[float, float, float]],
    ways: Sequence[Sequence[object]],
) -> list[Table]:
    rows = [
        [case.name, *(CELL.format(*cells[case.name, chip]) for chip in DENSITIES)]
        for case in (*CASES, *QUIET)
    ]
    forms = {
        f"{way}: {name}": form
        for way in ("one way", "and back")
        for name, form in WAY.items()
    }
    return [
        Table("chips", {"case": ""} | dict.fromkeys(DENSITIES, ""), rows),
        Table("back", {"case": "", "chip": ""} | forms, ways),
    ]


CELL = "{:.2f}, {:.0f} %, {:.2f}"
WAY = {"under 1 cm": ".1f", "median": ".2f", "inside": ".0f", "stated / true": ".2f"}

# Twenty runs of eight strokes, a case and a chip.
main = partial(
    harness.run,
    *("strokes-chips", __doc__, measured),
    harness.options(seeds=20),
)
