# SPDX-License-Identifier: MIT
"""Strokes that `imud refine` measures afterwards, beside those of the firmware's C: of
the same simulated hands.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import feed
from benchmarks.harness import Figure, Report, Table
from benchmarks.strokes import on_host
from benchmarks.strokes.on_host import row_of
from benchmarks.strokes.runs import (
    Case,
    Found,
    Run,
    ends_of,
    found_of,
    heading_of,
    params_of,
    run_of,
    turned_back,
)
from imud.params.value import Params
from imud.published import Stroke
from imud.recordings.raw_samples import Stretch
from imud.recordings.refined_strokes import of_part
from imud.refine.known import priors_of
from imud.refine.model import Recording
from imud.refine.whole import parts_of

NAMES = (
    *("supported, 1 s", "supported, 2 s", "between rests, 2 s"),
    *("on paper, 2 s", "free air, 1 s", "free air, 2 s", "raw module, 2 s"),
    *("hand, 1 s", "hand, 2 s"),
)
CASES = [case for case in on_host.CASES if case.name in NAMES]
FREE = "free air, 2 s"
Task = tuple[Case, int]


def measure(task: Task) -> tuple[Found, Found]:
    """Of a run: as the probe measures it, and afterwards."""
    case, seed = task
    run = run_of(case, seed, feed.LSM9DS0)
    ends = [*ends_of(run)]
    turned = np.array([angle for _, _, angle in ends])
    probes = found_of([message for message, _, _ in ends], turned, run.true)
    return probes, refound(run, [(message, time_s) for message, time_s, _ in ends])


def refound(run: Run, ends: Sequence[tuple[Any, float]]) -> Found:
    """None where there were more or fewer strokes."""
    samples = run.sampled.samples
    recording = Recording(samples.rate_hz, samples.gyr, samples.acc, samples.mag)
    params = Params.decode(params_of(run.case))
    stretch = Stretch("pen", "imud", {}, params)
    stretch.t_us.extend((1e6 * run.sampled.times_s).tolist())
    for number, (message, time_s) in enumerate(ends):
        fields = message.fields
        if fields["displacement"] is None:
            continue
        told = Stroke(
            probe="pen",
            seq=0,
            number=number,
            missing=0,
            t_device_us=round(1e6 * time_s),
            stroke=number,
            end=fields["end"],
            windows=fields["windows"],
            displacement_m=fields["displacement"],
            displacement_sigma_m=None,
            path_m=None,
            path_sigma_m=None,
            flags=(),
        )
        stretch.strokes.append((told, 0))
    ((part, window),) = parts_of(recording, priors_of(params))
    index = np.arange(len(samples.gyr))
    if len(ends) != len(run.true):
        return Found(*np.zeros((3, 0, 3)))
    ways, sigmas, turned, true = [], [], [], []
    for each in of_part(stretch, index, part, window, 0):
        stroke = each.stroke
        if stroke.displacement_m is None or stroke.displacement_sigma_m is None:
            continue
        at_s = stroke.t_device_us * 1e-6
        at = min(int(np.searchsorted(run.sampled.times_s, at_s)), len(part.quats) - 1)
        ways.append(stroke.displacement_m)
        sigmas.append(stroke.displacement_sigma_m)
        turned.append(heading_of(part.quats[at], run.exact, at_s))
        true.append(run.true[stroke.stroke])
    errors = turned_back(np.array(ways), np.array(turned)) - np.array(true)
    return Found(errors, errors, np.array(sigmas))


COLUMNS = {
    **{
        "case": "",
        "strokes": "d",
        "median, cm": "",
        "p95, cm": "",
        "under 1 cm, %": "",
    },
    **{"inside 95 %, %": "", "sigma, cm": ""},
}


def cells(case: Case, pairs: Sequence[tuple[Found, Found]]) -> list[Any]:
    """The probe's own figures / those afterwards."""
    rows = [row_of(case, [pair[which] for pair in pairs]) for which in (0, 1)]
    kinds = {"median": ".2f", "p95": ".2f", "under 1 cm": ".0f", "inside": ".0f"}
    return [
        *(case.name, rows[0]["strokes"]),
        *(
            " / ".join(format(row[name], form) for row in rows)
            for name, form in (kinds | {"sigma": ".2f"}).items()
        ),
    ]


def measured(args: argparse.Namespace) -> Report:
    cases = [case for case in CASES if args.only in case.name]
    rows, figures = [], []
    for case in cases:
        seeds = harness.seeds_of(args, 1000 * on_host.CASES.index(case))
        tasks: list[Task] = [(case, seed) for seed in seeds]
        pairs = [*harness.each(measure, tasks, args.jobs, case.name)]
        rows.append(cells(case, pairs))
        found = row_of(case, [after for _, after in pairs])
        if case.name == FREE:
            share = found["under 1 cm"]
            name = f"{FREE}: under 1 cm, %"
            figures.append(Figure(name, share, (78, 100), (88, 100)))
        name = f"{case.name}: inside 95 %, %"
        figures.append(Figure(name, found["inside"], (90, 100), (93, 98)))
    return Report([Table("cases", COLUMNS, rows)], figures)


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", default="", help="cases whose name contains this")


main = partial(
    harness.run,
    *("strokes-afterwards", __doc__, measured),
    harness.options(seeds=6, jobs=2, more=more),
)
