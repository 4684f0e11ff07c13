# SPDX-License-Identifier: MIT
"""The cost of probes, daemons, routers and consumers: messages and bytes a second by
hop, processor time and memory by process, latency by hop, loss.

Probes are frames that a process writes to ptys. Each daemon is a client of a router;
the routers form a chain, and consumers connect to the last one. The first consumer
hears all probes and its figures are printed; each other hears sixteen. Everything runs
on this machine over loopback, so a load beside it is part of the figures: the share of
the processors that stayed idle is printed with each row.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks import harness
from benchmarks.common.load import PATIENCE_S, answer_of, cpu_s, idle_s, rss_mib
from benchmarks.harness import Cell, Figure, Report, Table
from benchmarks.host.fleet import Fleet, Size
from imud.progress import Progress

# Probes, their rate, daemons, routers, consumers.
ROWS = (
    Size(8, 20, 1, 1, 1),
    Size(64, 20, 1, 1, 1),
    Size(256, 20, 1, 1, 1),
    Size(64, 200, 1, 1, 1),
    Size(16, 100, 2, 1, 11),
    Size(256, 20, 2, 1, 10),
    Size(1000, 2, 4, 2, 10),
)
# After the last message it looks so often whether more has arrived, until nothing has
# for some times, at most so many times.
DRAIN_S, DRAIN_QUIET, DRAIN_MAX = 3.0, 3, 30
LONG_S = 4 * PATIENCE_S  # a consumer takes its time to count what it has heard


def cpu_of(fleet: Fleet) -> dict[str, float]:
    """Seconds of processor time by group of processes."""
    return {name: sum(map(cpu_s, pids)) for name, pids in fleet.groups.items()}


def run(fleet: Fleet, seconds: float, warm_up_s: float) -> dict[str, Any]:
    """Lets a fleet work, and measures after the warm-up."""
    fleet.feeder.send("go")
    time.sleep(warm_up_s)
    begin_ns, begin = time.time_ns(), time.monotonic()
    before, idle = cpu_of(fleet), idle_s()
    time.sleep(seconds)
    passed_s = time.monotonic() - begin
    after, idle = cpu_of(fleet), idle_s() - idle
    memory = {name: sum(map(rss_mib, pids)) for name, pids in fleet.groups.items()}
    fleet.feeder.send("stop")
    drain(fleet)
    sent = answer_of(fleet.feeder, LONG_S)
    for each in (fleet.follower, *fleet.others):
        each.send("stop")
    heard = answer_of(fleet.follower, LONG_S)
    others = [answer_of(each, LONG_S) for each in fleet.others]
    cores = {name: (after[name] - before[name]) / passed_s for name in after}
    counts = counted(fleet)
    out_bytes = heard["bytes"] / max(1, counts["got"])
    got = counts["got"] + sum(each["got"] for each in others)
    rate_hz = fleet.size.probes * fleet.size.rate_hz
    return {
        "size": msgspec.to_builtins(fleet.size),
        "in_mb_s": sent["bytes_s"] / 1e6,
        "out_mb_s": out_bytes * got / sent["fed_s"] / 1e6,
        **delays(fleet, begin_ns, begin_ns + int(seconds * 1e9)),
        **counts,
        "others_missed": sum(each["missed"] for each in others),
        "cpu_us": {name: 1e6 * share / rate_hz for name, share in cores.items()},
        "rss_mib": memory,
        "idle_share": idle / passed_s / (os.cpu_count() or 1),
    }


def drain(fleet: Fleet) -> None:
    """Waits until all that is on its way has arrived."""
    counts: list[int] = []
    while len(counts) < DRAIN_QUIET or (
        len(counts) < DRAIN_MAX and len(set(counts[-DRAIN_QUIET:])) > 1
    ):
        time.sleep(DRAIN_S)
        fleet.follower.send("how many")
        counts.append(answer_of(fleet.follower, LONG_S))


def counted(fleet: Fleet) -> dict[str, int]:
    """What the consumer of all poses got and lost since its first one of each probe. A
    loss is explained by a pty without room, or by a gap in `number`, of which the last
    is in a probe's status. `unheard`: probes of which nothing came.
    """
    sent, heard = np.load(fleet.sent_path), np.load(fleet.heard_path)
    told = dict(np.load(fleet.told_path).tolist())
    lost = explained = unheard = 0
    for probe in np.unique(sent[:, 0]):
        of, mine = heard[heard[:, 0] == probe], sent[sent[:, 0] == probe]
        if len(of) == 0:
            unheard += 1
            continue
        mine = mine[mine[:, 1] >= of[0, 1]]
        lost += len(mine) - len(of)
        explained += int(mine[:, 3].sum())
        last = max(int(of[-1, 2]), told.get(probe, 0))
        explained += last - int(of[0, 2]) + 1 - len(of)
    return {
        "got": len(heard),
        "lost": lost,
        "unexplained": lost - explained,
        "unheard": unheard,
    }


def delays(fleet: Fleet, begin_ns: int, end_ns: int) -> dict[str, Any]:
    """From the byte on the pty to the daemon's read, and from there to the consumer's
    callback, of poses that were written between two times.
    """
    sent, heard = np.load(fleet.sent_path), np.load(fleet.heard_path)
    chosen = sent[(sent[:, 2] >= begin_ns) & (sent[:, 2] < end_ns)]
    came = {(p, s): (read, t) for p, s, _, _, read, t in heard.tolist()}
    pairs = [
        (came[p, s][0] - t_ns, came[p, s][1] - came[p, s][0])
        for p, s, t_ns, _ in chosen.tolist()
        if (p, s) in came and came[p, s][0] >= 0
    ]
    both = np.array(pairs if pairs else [(np.nan, np.nan)]) / 1e6

    def of(column: int) -> dict[str, float]:
        values = both[:, column]
        return {f"p{q}": float(np.percentile(values, q)) for q in (50, 99)}

    return {
        "sent_hz": len(chosen) / (end_ns - begin_ns) * 1e9,
        "to_daemon_ms": of(0),
        "to_consumer_ms": of(1),
    }


def table_of(rows: Sequence[dict[str, Any]]) -> Table:
    columns = dict.fromkeys(("probes", "Hz"), "d")
    columns |= {"daemons, routers, consumers": "", "bytes in, out, MB/s": ""}
    columns |= dict.fromkeys(("port to daemon: median, p99, ms", "to consumer"), "")
    columns |= {"lost": "d", "daemons, routers: us a message": ""}
    columns |= {"daemons' memory, MiB": ".0f", "processors idle": ".0%"}
    return Table("rows", columns, [cells(row) for row in rows])


def cells(row: dict[str, Any]) -> tuple[Cell, ...]:
    size, cpu = row["size"], row["cpu_us"]
    return (
        *(size["probes"], size["rate_hz"]),
        ", ".join(str(size[name]) for name in ("daemons", "routers", "consumers")),
        f"{row['in_mb_s']:.2f}, {row['out_mb_s']:.2f}",
        *(
            f"{row[name]['p50']:.1f}, {row[name]['p99']:.1f}"
            for name in ("to_daemon_ms", "to_consumer_ms")
        ),
        row["lost"],
        f"{cpu['daemons']:.0f}, {cpu['routers']:.0f}",
        *(row["rss_mib"]["daemons"], row["idle_share"]),
    )


def figures_of(rows: Sequence[dict[str, Any]]) -> list[Figure]:
    """A message may be lost on a busy machine, but not without an explanation."""
    wrong = {
        name: sum(row[name] for row in rows) for name in ("unexplained", "unheard")
    }
    found = [Figure(name, count, (0, 0), (0, 0)) for name, count in wrong.items()]
    lost = sum(row["lost"] for row in rows)
    return [*found, Figure("lost", lost, (0, math.inf), (0, 0))]


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--row",
        nargs=5,
        type=int,
        action="append",
        metavar=("PROBES", "HZ", "DAEMONS", "ROUTERS", "CONSUMERS"),
        help="a row in place of the usual ones; may be repeated",
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="of each row")
    parser.add_argument("--warm-up", type=float, default=5.0, help="before that, s")
    parser.add_argument(
        "--no-log", action="store_true", help="the daemons keep no logs"
    )


def measured(args: argparse.Namespace) -> Report:
    sizes = [Size(*row) for row in args.row] if args.row else ROWS
    progress = Progress("hosts", len(sizes))
    rows = []
    for number, size in enumerate(sizes, 1):
        with tempfile.TemporaryDirectory() as folder:
            fleet = Fleet(size, Path(folder), has_log=not args.no_log)
            try:
                rows.append(run(fleet, args.seconds, args.warm_up))
            finally:
                fleet.close()
        progress.update(number)
    return Report([table_of(rows)], figures_of(rows), {"rows": rows})


main = partial(harness.run, "hosts", __doc__, measured, options)
