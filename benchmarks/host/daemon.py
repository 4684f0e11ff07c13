# SPDX-License-Identifier: MIT
"""The cost of the host side: decoding on one core, the time from a byte on the pty to a
subscriber's callback, and the daemon's CPU and memory by the number of probes.

One process writes frames to ptys at the right times, another one subscribes; both note
CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.paths import RESULTS, write_results
from benchmarks.host import soak
from benchmarks.host.decoding import decoding, tell_decoding
from benchmarks.host.live import live
from benchmarks.host.parts import missed

OUTPUT = RESULTS / "host.json"
# By the number of probes: median and 99th percentile in us; share of a core.
LATENCY_TARGET_US = {8: (300.0, 2000.0)}
CORE_TARGET = {64: 1.0}


def straightness(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Fit CPU = base + slope * probes, in shares of a core; and the worst deviation."""
    probes = np.array([run["probes"] for run in runs], dtype=float)
    cost = np.array([run["cpu_core"] for run in runs])
    slope, base = np.polyfit(probes, cost, 1)
    return {
        "base_core": float(base),
        "probe_core": float(slope),
        "worst_miss_core": float(np.abs(base + slope * probes - cost).max()),
    }


def verdict(run: dict[str, Any]) -> str:
    """How a run compares with its targets, if it has any."""
    words = []
    if run["is_relay"]:
        return "the bare relay"
    if run["probes"] in LATENCY_TARGET_US:
        median, p99 = LATENCY_TARGET_US[run["probes"]]
        is_met = run["median_us"] < median and run["p99_us"] < p99
        words.append(f"{median:.0f}/{p99:.0f} us " + ("met" if is_met else "NOT met"))
    if run["probes"] in CORE_TARGET:
        is_met = run["cpu_core"] < CORE_TARGET[run["probes"]] and not missed(run)
        words.append("one core, none lost: " + ("met" if is_met else "NOT met"))
    return ", ".join(words)


def tell_live(runs: Sequence[dict[str, Any]]) -> None:
    print("\nfrom the byte on the pty to the subscriber's callback, with logging")
    heads = (
        *("median us", "p99 us", "CPU %", "idle %", "RSS MiB"),
        *("poses", "missed", "logged"),
    )
    print(f"{'probes':>6}" + "".join(f"{head:>11}" for head in heads))
    for run in runs:
        cells = (
            f"{run['median_us']:.0f}",
            f"{run['p99_us']:.0f}",
            f"{100 * run['cpu_core']:.1f}",
            f"{100 * run['idle_cores']:.0f}",
            f"{run['rss_mib']:.0f}",
            f"{run['poses_sent']}",
            f"{missed(run)}",
            f"{run['logged']}",
        )
        line = "".join(f"{cell:>11}" for cell in cells)
        print(f"{run['probes']:6}{line}  {verdict(run)}".rstrip())
    runs = [run for run in runs if not run["is_relay"]]
    if len(runs) > 2:
        fitted = straightness(runs)
        print(
            f"CPU: {100 * fitted['base_core']:.1f} % and "
            f"{100 * fitted['probe_core']:.2f} % a probe; no run is off that line by "
            f"more than {100 * fitted['worst_miss_core']:.1f} %"
        )


def tell_memory(points: Sequence[dict[str, float]]) -> None:
    print("\nmemory of one process with decoder, ledger, clock, hub and log")
    for point in points:
        print(f"  after {point['hours']:5.2f} h{point['rss_mib']:10.1f} MiB")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--probes", type=int, nargs="*", default=[1, 8, 16, 32, 64])
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    parser.add_argument("--hours", type=float, default=1.0, help="of frames, memory")
    parser.add_argument("--frames", type=int, default=200_000, help="to decode")
    parser.add_argument("--json", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    found: dict[str, Any] = {"decoding": decoding(options.frames, 1.0)}
    tell_decoding(found["decoding"])
    runs = []
    for probes in options.probes:
        # Compare with the bare relay where there is a target of latency.
        for is_relay in [True, False] if probes in LATENCY_TARGET_US else [False]:
            with tempfile.TemporaryDirectory() as folder:
                made = live(probes, options.seconds, Path(folder), is_relay=is_relay)
                runs.append(made)
    found["live"] = runs
    tell_live(runs)
    ours = [run for run in runs if not run["is_relay"]]
    if len(ours) > 2:
        found["line"] = straightness(ours)
    if options.hours > 0:
        with tempfile.TemporaryDirectory() as folder:
            soaked = soak.soak(options.hours, 1, 1, Path(folder))
        found["memory"] = soaked["memory"]
        tell_memory(soaked["memory"])
    write_results(options.json, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
