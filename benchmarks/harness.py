# SPDX-License-Identifier: MIT
"""What all benchmarks share: options, tables, required figures, results.

A program measures and returns a Report; run() prints its tables and figures and writes
all of it to build/benchmarks/NAME.json. If the run was whole, without an option that
leaves a part out, the tables that documents show are kept and written (tables.py).
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from benchmarks import tables
from benchmarks.common.images import RunFailed
from benchmarks.common.paths import RESULTS
from benchmarks.tables import Cell, Table
from imud.errors import ImudError
from imud.progress import Progress

__all__ = [
    "SETS",
    "Cell",
    "Figure",
    "Options",
    "Report",
    "Table",
    "degrees",
    "each",
    "options",
    "ratio",
    "run",
    "seeds_of",
]

# Seeds: these, and every second one. Those for tuning were looked at while a method was
# made, those for judging were not.
SETS = {"tuning": 0, "judging": 1}

# Options that say where and how, not what is measured.
NEUTRAL = frozenset({"jobs", "output"})

Work = TypeVar("Work")
Done = TypeVar("Done")


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure that the project must reach: its limits, and those of the goal."""

    name: str
    value: float
    must: tuple[float, float]
    goal: tuple[float, float]
    detail: str = ""

    @property
    def verdict(self) -> str:
        if _is_within(self.value, self.goal):
            return "goal"
        return "must" if _is_within(self.value, self.must) else "MISSED"


@dataclass(frozen=True, slots=True)
class Report:
    """What a benchmark found; `data` is for pictures and for people who look closer."""

    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    data: Any = field(default_factory=dict)


Options = Callable[[argparse.ArgumentParser], None]


def options(
    *,
    seeds: int | None = None,
    groups: Collection[str] = (),
    boards: Collection[str] = (),
    jobs: int | None = None,
    more: Options = lambda _: None,
) -> Options:
    """Options that many programs have, those for which something is given.

    `seeds`: how many of a set; `boards`: the first one is the default; `more`: options
    of the program's own.
    """

    def add(parser: argparse.ArgumentParser) -> None:
        if seeds is not None:
            parser.add_argument("--set", choices=SETS, default="judging", help="seeds")
            parser.add_argument("--seeds", metavar="N", type=int, default=seeds)
        if groups:
            parser.add_argument(
                "--groups",
                metavar="NAME",
                nargs="+",
                choices=groups,
                default=[*groups],
                help=f"of {', '.join(groups)} (default: all)",
            )
        if boards:
            parser.add_argument("--board", choices=boards, default=next(iter(boards)))
        if jobs is not None:
            parser.add_argument("--jobs", metavar="N", type=int, default=jobs)
        more(parser)

    return add


def seeds_of(args: argparse.Namespace, first: int = 0) -> list[int]:
    """The seeds of --set and --seeds, from the first one on."""
    return [first + SETS[args.set] + 2 * number for number in range(args.seeds)]


def run(
    name: str,
    description: str | None,
    measure: Callable[[argparse.Namespace], Report],
    options: Options = lambda _: None,
    *,
    variants: Sequence[str] = (),
    arguments: Sequence[str] | None = None,
) -> int:
    """Measure, print, write; return 1 if a required figure is missed.

    `variants` are options whose values have results of their own: with --board f405
    those of strokes are strokes-f405.
    """
    parser = argparse.ArgumentParser(
        prog=f"benchmarks: {name}", description=description
    )
    options(parser)
    parser.add_argument("--output", metavar="FILE", type=Path, help="of all results")
    args = parser.parse_args(arguments)
    changed = {
        key: value
        for key, value in vars(args).items()
        if value != parser.get_default(key)
    }
    for key in variants:
        if key in changed:
            value = changed.pop(key)
            name += f"-{key if value is True else value}"
    try:
        report = measure(args)
    except (ImudError, RunFailed) as error:
        sys.exit(f"{name}: {error}")
    for table in report.tables:
        print(f"\n{table.as_text()}")
    if report.figures:
        print(f"\n{figures_of(report.figures).as_text()}")
    output = args.output or RESULTS / f"{name}.json"
    write_results(output, report)
    partial = sorted(changed.keys() - NEUTRAL)
    if partial:
        print(f"not kept for documents: only a part, by {', '.join(partial)}")
    elif args.output is None:
        tables.keep(name, [*report.tables, figures_of(report.figures)])
    return int(any(each.verdict == "MISSED" for each in report.figures))


def figures_of(figures: Sequence[Figure]) -> Table:
    """The required figures as a table."""
    return Table(
        "figures",
        {"figure": "", "value": ".2f", "must": "", "goal": "", "reached": "", "of": ""},
        [
            (
                *(each.name, each.value),
                *(_range(each.must), _range(each.goal), each.verdict, each.detail),
            )
            for each in figures
        ],
    )


def write_results(path: Path, report: Report) -> None:
    """All results as JSON."""
    found = {
        "tables": {each.name: asdict(each) for each in report.tables},
        "figures": [asdict(each) for each in report.figures],
        "data": report.data,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1, default=float) + "\n", "utf-8")


def ratio(name: str, ours: float, other: float, must: float, goal: float) -> Figure:
    """Our score divided by another engine's."""
    detail = f"{ours:.2f} / {other:.2f}"
    return Figure(name, ours / other, (0.0, must), (0.0, goal), detail)


def degrees(name: str, ours: float, must: float, goal: float) -> Figure:
    """Our error, degrees."""
    return Figure(name, ours, (0.0, must), (0.0, goal))


def each(
    task: Callable[[Work], Done], work: Sequence[Work], jobs: int, label: str
) -> Iterator[Done]:
    """The results in the order of the work, `jobs` processes at a time, with a bar."""
    if not work:
        return
    progress = Progress(f"{len(work)} {label}", len(work))
    # VQF is called from Python for each sample: threads would share one lock.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(work)), context) as pool:
        for done in pool.map(task, work):
            yield done
            progress.advance()
    progress.end()


def _is_within(value: float, limits: tuple[float, float]) -> bool:
    low, high = limits
    return low <= value <= high


def _range(limits: tuple[float, float]) -> str:
    low, high = limits
    if high == math.inf:
        return ""
    return f"{low:g} to {high:g}" if low else f"{high:g}"
