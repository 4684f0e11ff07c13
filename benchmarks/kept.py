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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.common.paths import PROJECT, RESULTS, write_results
from benchmarks.common.whole import (
    NotWholeError,
    Results,
    demand,
    without_colons,
)
from benchmarks.host import parts as host

FOLDER = PROJECT / "benchmarks" / "results"
DIGITS = 6  # significant ones of a float; documents show fewer


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
    "micropython": Kept("micropython", "micropython.json", micropython),
    "pico": Kept("pico", "pico.json", pico),
    "faults": Kept("faults", "faults.json", faults),
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
