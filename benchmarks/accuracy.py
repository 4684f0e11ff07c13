# SPDX-License-Identifier: MIT
"""Orientation error of the image on recordings with optical truth, beside VQF.

Each recording moves a virtual Nano, which runs the image that is flashed, at 200
samples a second. Its poses are scored; so is what each filter of engines.py makes of
the very samples that the image read.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import scoring
from capture import RunFailed, run_nano
from engines import ENGINES
from scoring import Score, Trial

from imud.errors import ImudError
from imud.progress import Progress

OUTPUT = scoring.PROJECT / "build" / "benchmarks" / "accuracy.json"


@dataclass(frozen=True, slots=True)
class Result:
    """Scores of one trial by engine, and how its run went."""

    trial: Trial
    scores: Mapping[str, Score]
    lost: int
    summary: Mapping[str, Any]


def measure(trial: Trial, engines: Sequence[str]) -> Result:
    """Runs the image on one trial and scores it with the other engines beside."""
    capture = run_nano(trial.path)
    scores = {
        "nano": scoring.score_at(capture.pose_times_s, capture.poses, trial.motion)
    }
    for name in engines:
        estimate = ENGINES[name](capture.samples)
        scores[name] = scoring.score_at(capture.sample_times_s, estimate, trial.motion)
    return Result(trial, scores, capture.lost, capture.summary)


def line(name: str, scores: Mapping[str, Score], note: str = "") -> str:
    """One line of the table."""
    columns = "   ".join(str(score) for score in scores.values())
    ratio = ""
    if "vqf" in scores and scores["vqf"].total > 0.0:
        ratio = f"{scores['nano'].total / scores['vqf'].total:6.2f}"
    return f"{name:44.44}{columns} {ratio:>7} {note}".rstrip()


def average(results: Sequence[Result]) -> dict[str, Score]:
    """The mean over trials, engine by engine."""
    return {
        name: Score.mean([result.scores[name] for result in results])
        for name in results[0].scores
    }


def summaries(results: Sequence[Result]) -> dict[str, dict[str, Score]]:
    """The mean of each group of trials that occurs, then of all."""
    means = {}
    for title, group in scoring.GROUPS.items():
        members = [result for result in results if group in result.trial.groups]
        if members:
            means[f"{title} ({len(members)})"] = average(members)
    means[f"all ({len(results)})"] = average(results)
    return means


def note(result: Result) -> str:
    """How the run went."""
    summary = result.summary
    crash = ", CRASHED" if summary["crashed"] else ""
    return (
        f"lost {result.lost}, late {summary['late']}, "
        f"worst {summary['cycles_worst']} cycles{crash}"
    )


def write(results: Sequence[Result], path: Path) -> None:
    """Everything in the tables, for other programs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    trials = [
        {
            "trial": result.trial.name,
            "groups": result.trial.groups,
            "lost": result.lost,
            "summary": result.summary,
            "scores_deg": {name: asdict(each) for name, each in result.scores.items()},
        }
        for result in results
    ]
    means = {
        title: {name: asdict(each) for name, each in scores.items()}
        for title, scores in summaries(results).items()
    }
    path.write_text(json.dumps({"means_deg": means, "trials": trials}, indent=1) + "\n")


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/accuracy.py --trials 07 32"
    )
    parser.add_argument(
        "paths",
        metavar="PATH",
        nargs="*",
        type=Path,
        default=[scoring.RECORDINGS],
        help="recordings or folders of them (default: ../shared/data/broad)",
    )
    parser.add_argument(
        "--trials", metavar="NAME", nargs="+", default=[], help="how their names begin"
    )
    parser.add_argument(
        "--engines", nargs="*", choices=ENGINES, default=["vqf"], help="filters beside"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="at a time")
    parser.add_argument("--output", metavar="FILE", type=Path, default=OUTPUT)
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the table, writes the JSON; 1 where a run crashed or lost something."""
    args = parse(argv)
    absent = [path for path in args.paths if not path.exists()]
    if absent:
        print(f"skipped: no recordings at {absent[0]}; docs/motion-files.md says where")
        return 0
    trials = scoring.load_trials(args.paths, args.trials)
    if not trials:
        print("no recording has such a name", file=sys.stderr)
        return 2
    names = ["nano", *args.engines]
    print("RMSE in degrees: total, heading, inclination; ratio of the totals nano/vqf")
    print(" " * 44 + "   ".join(f"{name:>20}" for name in names) + "   ratio")
    progress = Progress(f"{len(trials)} recordings", len(trials))
    results = []
    with ThreadPoolExecutor(args.jobs) as pool:
        for result in pool.map(lambda each: measure(each, args.engines), trials):
            results.append(result)
            progress.wipe()
            print(line(result.trial.name, result.scores, note(result)), flush=True)
            progress.advance()
    progress.end()
    print()
    for title, scores in summaries(results).items():
        print(line(title, scores))
    write(results, args.output)
    lost = sum(result.lost for result in results)
    crashed = sum(bool(result.summary["crashed"]) for result in results)
    late = sum(result.summary["late"] for result in results)
    print(f"\n{crashed} crashes, {lost} samples or messages lost, {late} late")
    return 1 if crashed or lost else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"accuracy: {error}")
