# SPDX-License-Identifier: MIT
"""Writes the results that documents cite to benchmarks/results/NAME.json.

`make bench WHAT=...` does so after its programs. `python -m benchmarks.kept NAME` takes
the file that a program wrote to build/benchmarks. Partial results, as of --trials or
--quick, are refused.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.calibration import parts as calibration
from benchmarks.common import scoring
from benchmarks.common.figure import SETS
from benchmarks.common.paths import PROJECT, RESULTS, write_results
from benchmarks.common.whole import (
    NotWholeError,
    Results,
    demand,
    named,
    without_colons,
)
from benchmarks.host import parts as host
from benchmarks.limb import parts as limb
from benchmarks.strokes import parts as strokes
from benchmarks.tip import parts as tip

FOLDER = PROJECT / "benchmarks" / "results"
DIGITS = 6  # significant ones of a float; documents show fewer


def recordings(found: Results) -> Results:
    """Of accuracy/recordings.py: means by group and engine, shares inside."""
    trials = found["trials"]
    demand(len(trials) == scoring.TRIALS, f"{len(trials)} recordings")
    demand(not found["body_bias_ut"], "--body-bias")
    biased: dict[str, list[float]] = {}
    for trial in trials:
        for engine, score in trial["body_bias_deg"].items():
            biased.setdefault(engine, []).append(score["total"])
    return {
        "engines": found["engines"],  # with an image or without
        "means_deg": found["means_deg"],
        "coverage": found["coverage"],
        "figures": named(found["figures"]),
        "magnet_on_the_probe_deg": {
            engine: sum(each) / len(each) for engine, each in biased.items()
        },
    }


def motions(found: Results) -> Results:
    """Of accuracy/groups.py: each set and board, group by group."""
    demand(found["sets"].keys() == SETS.keys(), f"sets {', '.join(found['sets'])}")
    boards = {board for each in found["sets"].values() for board in each}
    demand(len(boards) > 1, f"board {', '.join(boards)}")
    groups = found["sets"]["judging"]["nano"]["groups"]
    demand(len(groups) > 10, f"{len(groups)} groups")
    return {
        which: {
            board: {
                "groups": one["groups"],
                "figures": named(one["figures"]),
                "heading_half_outside": Counter(
                    recording["room"]
                    for recording in found["recordings"]
                    if recording["board"] == board
                    and recording["recipe"]["seed"] % 2 == SETS[which]
                    and recording["coverage"]["heading"] < 0.5
                ),
            }
            for board, one in each.items()
        }
        for which, each in found["sets"].items()
    }


def motions_further(found: Results) -> Results:
    """Of accuracy/groups.py --further: the figures of each set of seeds."""
    ones = [one for each in found.values() for one in each.values()]
    demand(len(ones) == 2 * len(found), "one board")
    fewest = min(one["recordings"] for one in ones)
    demand(fewest >= 140, f"{fewest} recordings a set")
    return found


def since_origin(found: Results) -> Results:
    """Of honesty/since_origin.py: lines by motion and seconds, and the least share."""
    lines = found["lines"]
    names = {line["motion"] for line in lines}
    demand(found["set"] == "judging" and found["every"] == 1, "--set or --every")
    whole = 21 if names == {"broad"} else 16 * 2
    demand(found["runs"] >= whole and len(names) < 3, f"{found['runs']} runs")
    kept: Results = {name: {} for name in sorted(names)}
    for line in lines:
        kept[line["motion"]][f"{line['after_s']:g}"] = line
    shares = [line[kind]["inside"] for line in lines for kind in ("heading", "tilt")]
    return kept | {"least_inside": min(shares)}


def aims(found: Results) -> Results:
    """Of honesty/aims.py: both sets, by room, hand and age of the origin."""
    demand(found["seeds"] >= 16, f"{found['seeds']} seeds")
    demand(found["sets"].keys() == SETS.keys(), f"sets {', '.join(found['sets'])}")
    return {"sets": found["sets"]}


def grounds(found: Results) -> Results:
    """Of honesty/grounds.py: each set, group by group."""
    sets = found["sets"]
    demand(sets.keys() == SETS.keys(), f"sets {', '.join(sets)}")
    groups = sets["judging"]["groups"]
    demand(len(groups) > 20, f"{len(groups)} groups")
    fewest = min(each["count"] for each in groups.values())
    demand(fewest >= 16, f"{fewest} seeds")
    return {
        "groups": groups,
        "figures": {
            which: without_colons(named(each["figures"]))
            for which, each in sets.items()
        },
    }


def desk(found: Results) -> Results:
    """Of honesty/desk.py: each case of the seeds for judging; those for tuning."""
    demand(found.keys() == SETS.keys(), f"sets {', '.join(found)}")
    demand(len(found["judging"]["lines"]) > 40, "some groups")
    return {
        "cases": {
            line["case"].replace(", ", " "): {
                name: value for name, value in line.items() if name != "case"
            }
            for line in found["judging"]["lines"]
        },
        "figures": named(found["judging"]["figures"]),
        "tuning": named(found["tuning"]["figures"]),
        "heading_missed": sum(
            line["heading"]["honest"] < 0.9 for line in found["judging"]["lines"]
        ),
    }


def cycles(found: Results) -> Results:
    """Of firmware/cycles.py: the image, and each filter alone if it was measured."""
    demand(found["seconds"] == 120.0, f"{found['seconds']:g} s")
    kept: Results = {"figures": without_colons(found["figures"])}
    for name in ("engines", "filters"):
        if name in found:
            kept[name] = found[name]
    if "rates" in found:
        kept["rates"] = {str(each["sample_hz"]): each for each in found["rates"]}
    if "parts" in found:
        means = {name: part["mean"] for name, part in found["parts"].items()}
        own = (mean for name, mean in means.items() if name.startswith("fuse."))
        kept["parts"] = means | {"filter": sum(own, means.get("filter", 0.0))}
    return kept


def micropython(found: Results) -> Results:
    """Of firmware/micropython.py: each run without what its program said."""
    demand(found["seconds"] >= 20.0, f"{found['seconds']:g} s")
    kept = without_colons(found)
    for each in kept.values():
        if isinstance(each, dict):
            each.pop("told", None)
    return kept


def pico(found: Results) -> Results:
    """Of firmware/pico.py: each run."""
    demand(found["seconds"] >= 60.0, f"{found['seconds']:g} s")
    return found


def faults(found: Results) -> Results:
    """Of host/faults.py: what the tests recorded; those of bit errors together."""
    demand(found["failed"] == 0, "a test failed")
    tests = found["tests"]
    errors = [
        tests.pop(name) for name in [*tests] if name.startswith("a_minute_of_bit")
    ]
    demand(len(errors) >= 4, f"{len(errors)} minutes of bit errors")
    through = [each["passed on"] for each in errors]
    wrong = [each["passed the CRC and wrong"] for each in errors]
    expected = [each["expected of these"] for each in errors]
    return {
        "tests": tests,
        "bit_errors": {
            "passed_least": min(through),
            "passed_most": max(through),
            "wrong": sum(wrong),
            "expected": sum(expected),
        },
    }


def positions(found: Results) -> Results:
    """Of tip/positions.py: each way to find the tip."""
    demand(found["runs"] >= 300, f"{found['runs']} runs")
    return {"rows": without_colons(found["rows"])}


@dataclass(frozen=True, slots=True)
class Kept:
    """A file in benchmarks/results: its benchmark, its source, the part to keep."""

    what: str  # of `make bench WHAT=...`
    source: str  # in build/benchmarks
    part: Callable[[Any], Results]


KEPT = {
    "attacks": Kept("attacks", "attacks.json", host.attacks),
    "card": Kept("card", "card.json", host.card_log),
    "host": Kept("host", "host.json", host.daemon_load),
    "host-clocks": Kept("host", "clocks.json", host.dating),
    "host-soak": Kept("host", "soak.json", host.soak),
    "host-soak-limited": Kept("host", "soak-limited.json", host.soak_limited),
    "host-stages": Kept("host", "hot-path.json", host.stages),
    "host-dated": Kept("host", "tested-clock.json", host.dated),
    "host-sites": Kept("host", "tested-sites.json", host.sites),
    "hosts": Kept("hosts", "hosts.json", host.fleet),
    "page": Kept("page", "page.json", host.page),
    "recordings": Kept("accuracy", "accuracy.json", recordings),
    "recordings-f405": Kept("accuracy", "accuracy-f405.json", recordings),
    "motions": Kept("accuracy", "groups.json", motions),
    "motions-further": Kept("accuracy", "groups-further.json", motions_further),
    "honesty-grounds": Kept("honesty", "honesty-grounds.json", grounds),
    "honesty-desk": Kept("honesty", "honesty-desk.json", desk),
    "since-origin": Kept("honesty", "honesty-since-origin.json", since_origin),
    "since-origin-f405": Kept(
        "honesty", "honesty-since-origin-f405.json", since_origin
    ),
    "since-origin-recordings": Kept(
        "honesty", "honesty-since-origin-recordings.json", since_origin
    ),
    "aims": Kept("honesty", "honesty-aims.json", aims),
    "nano": Kept("nano", "cycles.json", cycles),
    "mega": Kept("mega", "cycles-mega.json", cycles),
    "f405": Kept("f405", "cycles-f405.json", cycles),
    "micropython": Kept("micropython", "micropython.json", micropython),
    "pico": Kept("pico", "pico.json", pico),
    "faults": Kept("faults", "faults.json", faults),
    "strokes": Kept("strokes", "strokes.json", strokes.strokes),
    "strokes-nano": Kept("strokes", "strokes-nano.json", strokes.strokes),
    "strokes-image-f405": Kept("strokes", "strokes-image-f405.json", strokes.image),
    "strokes-image-mega": Kept("mega", "strokes-image-mega.json", strokes.image),
    "strokes-thesis": Kept("strokes", "strokes-thesis.json", strokes.compared),
    "tip": Kept("tip", "tip.json", tip.wobbles),
    "limb-legs": Kept("limb", "limb.json", limb.legs),
    "limb-chains": Kept("limb", "limb_chain.json", limb.chains),
    "limb-feet": Kept("limb", "limb_feet.json", limb.feet),
    "tip-positions": Kept("tip", "tip-positions.json", positions),
    "calibration": Kept("calibration", "calibration-cases.json", calibration.cases),
    "calibration-crowd": Kept(
        "calibration", "calibration-crowd.json", calibration.crowd
    ),
    "calibration-shops": Kept(
        "calibration", "calibration-shops.json", calibration.shops
    ),
    "calibration-rough": Kept(
        "calibration", "calibration-rough.json", calibration.rough
    ),
    "calibration-warm": Kept("calibration", "warm.json", calibration.warm),
    "calibration-turns": Kept("calibration", "turns.json", calibration.turns),
}


def rounded(value: Any) -> Any:
    """Floats with DIGITS significant digits, so that files are short."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, Mapping):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return value


def keep(name: str) -> None:
    """Write a file of benchmarks/results; raises NotWholeError for partial results."""
    one = KEPT[name]
    found = json.loads((RESULTS / one.source).read_text("utf-8"))
    kept = {"command": f"make bench WHAT={one.what}", **rounded(one.part(found))}
    write_results(FOLDER / f"{name}.json", kept)


def keep_all(what: str, since: float) -> None:
    """Keep the results of `make bench WHAT=...` that were written since that time."""
    for name, one in KEPT.items():
        source = RESULTS / one.source
        if one.what == what and source.exists() and source.stat().st_mtime >= since:
            try:
                keep(name)
            except NotWholeError as error:
                print(f"not kept: {one.source} is partial ({error})")
                continue
            print(f"kept: {(FOLDER / name).relative_to(PROJECT)}.json")


def main(arguments: Sequence[str] | None = None) -> int:
    """Keep the named results."""
    parser = argparse.ArgumentParser(prog="benchmarks.kept", description=__doc__)
    parser.add_argument("names", metavar="NAME", nargs="+", choices=KEPT)
    for name in parser.parse_args(arguments).names:
        try:
            keep(name)
        except FileNotFoundError as error:
            sys.exit(
                f"{error.filename} is not there: make bench WHAT={KEPT[name].what}"
            )
        except NotWholeError as error:
            sys.exit(
                f"{KEPT[name].source} is partial ({error}); run the whole benchmark"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
