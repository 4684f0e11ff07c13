# SPDX-License-Identifier: MIT
"""The results of recordings.py: tables, JSON and the required figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import scoring
from benchmarks.common.boards import IMAGES
from benchmarks.common.engines import HOST, OFFLINE, VQF
from benchmarks.common.figure import Figure, degrees, ratio
from benchmarks.common.paths import write_results
from benchmarks.common.scoring import Coverage, Score, Trial


@dataclass(frozen=True, slots=True)
class Result:
    """Scores of one trial by engine, and the course of its run."""

    trial: Trial  # its motion cut down to nothing
    scores: Mapping[str, Score]
    coverage: Mapping[str, Coverage]
    biased: Mapping[str, Score]  # with a magnet on the probe
    trace: Mapping[str, Any] | None
    poses: int  # of the image that were recomputed on this machine
    unequal: int  # of those, with different bits
    lost: int
    summary: Mapping[str, Any]


def figures(results: Sequence[Result]) -> Iterator[Figure]:
    """The required figures that can be computed from these engines and trials."""
    means = summaries(results, ("all", *scoring.GROUPS))
    every = means["all"]
    ours = next((name for name in IMAGES if name in every), HOST)
    if ours not in every:
        return
    disturbed = means.get("disturbed", {})
    bias = average([result.biased for result in results])
    if VQF in every:
        mine, other = every[ours], every[VQF]
        yield ratio("total / VQF", mine.total, other.total, 0.64, 0.58)
        yield ratio(
            "inclination / VQF", mine.inclination, other.inclination, 0.92, 0.80
        )
    if VQF in disturbed:
        mine, other = disturbed[ours], disturbed[VQF]
        yield ratio(
            "heading / VQF, disturbed group", mine.heading, other.heading, 0.75, 0.50
        )
        yield degrees("heading, disturbed group, deg", mine.heading, 1.40, 1.25)
    if "attached magnet" in means:
        mine = means["attached magnet"][ours]
        yield degrees("total, attached magnet, deg", mine.total, 1.40, 1.15)
    if bias:
        mine, other = bias[HOST], bias[VQF]
        name = "total / VQF, a magnet on the probe"
        yield ratio(name, mine.total, other.total, 0.75, 0.55)
    if OFFLINE in every:
        mine, other = every[ours], every[OFFLINE]
        name = "total / offline VQF"
        yield ratio(name, mine.total, other.total, math.inf, 1.0)
        name = "inclination / offline VQF"
        yield ratio(name, mine.inclination, other.inclination, math.inf, 1.0)
    for group in (*scoring.GROUPS, "all"):
        shares = [each.coverage for each in results if each.trial.is_in(group)]
        if not shares:
            continue
        mean = Coverage.mean([share[ours] for share in shares])
        for kind in ("tilt", "heading"):
            value = 100.0 * getattr(mean, kind)
            name = f"{kind} inside {scoring.SIGMAS:g} sigma, %, {group}"
            yield Figure(name, value, (88.0, 100.0), (93.0, 98.0))
    yield from stated(results, ours)


def stated(results: Sequence[Result], ours: str) -> Iterator[Figure]:
    """Whether the stated errors inform: their medians divided by the true errors."""
    mean = Coverage.mean([each.coverage[ours] for each in results])
    true = Score.mean([each.scores[ours] for each in results])
    for kind, sigma, error in (
        ("tilt", mean.tilt_sigma_deg, true.inclination),
        ("heading", mean.heading_sigma_deg, true.heading),
    ):
        yield ratio(f"{kind}, median stated / true rms", sigma, error, 2.0, 1.3)
    value = 100.0 * mean.heading_null
    yield Figure("heading withheld, %", value, (0.0, 1.0), (0.0, 0.5))


def average(rows: Sequence[Mapping[str, Score]]) -> dict[str, Score]:
    """The mean over trials, engine by engine."""
    return {name: Score.mean([row[name] for row in rows]) for name in rows[0]}


def members(results: Sequence[Result], names: Sequence[str]) -> dict[str, int]:
    """The groups or folds that occur, with their numbers of trials."""
    counts = {
        name: sum(result.trial.is_in(name) for result in results) for name in names
    }
    return {name: count for name, count in counts.items() if count}


def summaries(
    results: Sequence[Result], names: Sequence[str]
) -> dict[str, dict[str, Score]]:
    """The mean of each group or fold of trials that occurs."""
    return {
        name: average([each.scores for each in results if each.trial.is_in(name)])
        for name in members(results, names)
    }


def coverages(
    results: Sequence[Result], names: Sequence[str]
) -> dict[str, dict[str, Coverage]]:
    """The same for the shares of errors inside their sigmas."""
    return {
        name: {
            engine: Coverage.mean(
                [each.coverage[engine] for each in results if each.trial.is_in(name)]
            )
            for engine in results[0].coverage
        }
        for name in members(results, names)
    }


def print_table(
    title: str, heads: Sequence[str], rows: Mapping[str, list[str]]
) -> None:
    """Print a table with columns as wide as their cells."""
    print(f"\n{title}")
    widths = [
        max(len(head), *(len(cells[column]) for cells in rows.values()))
        for column, head in enumerate(heads)
    ]
    longest = max(18, *map(len, rows))
    for name, cells in {"": heads, **rows}.items():
        line = "".join(
            f"  {cell:>{width}}" for cell, width in zip(cells, widths, strict=True)
        )
        print(f"{name:{longest}}{line}".rstrip())


def print_tables(results: Sequence[Result], names: Sequence[str]) -> None:
    """Print scores by trial, group and fold, and the coverage of our sigmas."""
    if len(results) > 1:
        for kind in ("total", "heading", "inclination"):
            print_table(
                f"{kind} error of each trial, degrees rms",
                [result.trial.name.split("_")[0][:8] for result in results],
                {
                    name: [f"{getattr(r.scores[name], kind):.2f}" for r in results]
                    for name in names
                },
            )
    for groups in ((*scoring.GROUPS, "all"), tuple(scoring.FOLDS)):
        counts = members(results, groups)
        if not counts:
            continue
        heads = [f"{name} ({count})" for name, count in counts.items()]
        means = summaries(results, groups)
        print_table(
            "total, heading, inclination error, degrees rms, mean over trials",
            heads,
            {name: [str(mean[name]) for mean in means.values()] for name in names},
        )
        shares = coverages(results, groups)
        rows = {
            name: [str(each[name]) for each in shares.values()]
            for name in results[0].coverage
        }
        if rows:
            print_table(
                f"errors inside {scoring.SIGMAS:g} sigma, %: tilt, heading (poses "
                "without stated errors)",
                heads,
                rows,
            )


def print_figures(found: Sequence[Figure], *, is_judged: bool) -> None:
    """Print the required figures with their limits."""
    note = "" if is_judged else " (not judged: these are not the public trials)"
    print(f"\n{'what it must show' + note:64}{'must':>12}{'goal':>12}")
    for figure in found:
        print(figure)


def write(results: Sequence[Result], asked: Mapping[str, Any], path: Path) -> None:
    """Write everything in the tables as JSON."""
    groups, folds = (*scoring.GROUPS, "all"), tuple(scoring.FOLDS)
    document = {
        **asked,
        "means_deg": summaries(results, groups),
        "folds_deg": summaries(results, folds),
        "coverage": coverages(results, groups),
        "coverage_folds": coverages(results, folds),
        "figures": [
            asdict(figure) | {"verdict": figure.verdict} for figure in figures(results)
        ],
        "bit_equal": {
            "poses": sum(result.poses for result in results),
            "unequal": sum(result.unequal for result in results),
        },
        "trials": [
            {
                "trial": result.trial.name,
                "groups": result.trial.groups,
                "lost": result.lost,
                "summary": result.summary,
                "scores_deg": result.scores,
                "coverage": result.coverage,
                "body_bias_deg": result.biased,
            }
            for result in results
        ],
        "trace": next((each.trace for each in results if each.trace), None),
    }
    write_results(path, plain(document))


def plain(value: Any) -> Any:
    """A value for JSON, with None for NaN and infinity."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, Score | Coverage):
        return plain(asdict(value))
    return value
