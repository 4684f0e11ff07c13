# SPDX-License-Identifier: MIT
"""The cost of the daemon: the time from a byte on the pty to a subscriber's callback,
its CPU and its memory, by the number of probes, beside the least that a relay takes.

One process writes frames to ptys at the right times, another one subscribes; both note
UTC of this machine.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.common.load import free_endpoint
from benchmarks.harness import Figure, Report, Table
from benchmarks.host.live import live

PROBES = (1, 8, 16, 32, 64)
# So many probes are also relayed by the smallest daemon that there can be (relay.py).
RELAYED = 8
# Aims on a quiet machine; a busy one misses them without a fault of ours.
MEDIAN_US, P99_US = 300.0, 2000.0
ONE_CORE = 64  # probes that a core carries


def run(probes: int, seconds: float, folder: Path, *, is_relay: bool) -> dict[str, Any]:
    """The daemon with a log, or the relay."""
    endpoint = free_endpoint()

    def command(names: list[str]) -> list[str]:
        if is_relay:
            return [str(Path(__file__).with_name("relay.py")), endpoint, *names]
        words = ["--listen", endpoint, "--log", str(folder / "logs")]
        return ["-m", "imud", "run", *names, *words]

    return {"is_relay": is_relay, **live(probes, seconds, folder, endpoint, command)}


def missed(run: dict[str, Any]) -> int:
    """Frames lost anywhere between the pty and the subscriber."""
    return int(run["lost"] + run["dropped"] + run["overrun"])


def table_of(runs: Sequence[dict[str, Any]]) -> Table:
    columns = {"probes at 200 Hz": "", "median, us": ",.0f", "p99, us": ",.0f"}
    columns |= {"share of one core": ".1%", "memory, MiB": ",.0f", "poses": ",d"}
    columns |= {"missed": ",d", "processors idle": ".0%"}
    rows = [
        (
            f"{run['probes']}{', the bare relay' if run['is_relay'] else ''}",
            *(run["median_us"], run["p99_us"], run["cpu_core"], run["rss_mib"]),
            *(run["poses_sent"], missed(run)),
            run["idle_cores"] / (os.cpu_count() or 1),
        )
        for run in runs
    ]
    return Table("live", columns, rows)


def figures_of(runs: Sequence[dict[str, Any]]) -> Iterator[Figure]:
    any_value = (0, math.inf)
    for run in runs:
        name = f"{run['probes']} probes"
        if run["is_relay"]:
            continue
        if run["probes"] == RELAYED:
            yield Figure(f"{name}: missed", missed(run), (0, 0), (0, 0))
            yield Figure(
                f"{name}: median, us", run["median_us"], any_value, (0, MEDIAN_US)
            )
            yield Figure(f"{name}: p99, us", run["p99_us"], any_value, (0, P99_US))
        if run["probes"] == ONE_CORE:
            yield Figure(f"{name}: missed", missed(run), any_value, (0, 0))
            yield Figure(f"{name}: cores", run["cpu_core"], any_value, (0, 1))


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--probes", type=int, nargs="*", default=[*PROBES])
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")


def measured(args: argparse.Namespace) -> Report:
    runs = []
    for probes in args.probes:
        for is_relay in [True, False] if probes == RELAYED else [False]:
            with tempfile.TemporaryDirectory() as folder:
                runs.append(run(probes, args.seconds, Path(folder), is_relay=is_relay))
    return Report([table_of(runs)], [*figures_of(runs)], {"runs": runs})


main = partial(harness.run, "host", __doc__, measured, options)
