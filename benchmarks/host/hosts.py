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
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.paths import RESULTS, write_results
from benchmarks.host.fleet import Fleet, Size
from benchmarks.host.hops import run

OUTPUT = RESULTS / "hosts.json"

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
HEADS = (
    *("probes", "Hz", "daemons", "routers", "consumers", "sent/s", "MB/s in"),
    *("MB/s out", "daemon ms", "p99", "consumer ms", "p99"),
    *("lost", "unexplained", "unheard", "us/msg", "router us", "MiB", "idle %"),
)


def cells(made: dict[str, Any]) -> list[str]:
    size, cpu = made["size"], made["cpu_us"]
    return [
        *(str(size[name]) for name in Size.__struct_fields__),
        f"{made['sent_hz']:.0f}",
        f"{made['in_mb_s']:.2f}",
        f"{made['out_mb_s']:.2f}",
        *(f"{made['to_daemon_ms'][name]:.1f}" for name in ("p50", "p99")),
        *(f"{made['to_consumer_ms'][name]:.1f}" for name in ("p50", "p99")),
        f"{made['lost']}",
        f"{made['unexplained']}",
        f"{made['unheard']}",
        f"{cpu['daemons']:.0f}",
        f"{cpu['routers']:.0f}",
        f"{made['rss_mib']['daemons']:.0f}",
        f"{100 * made['idle_share']:.0f}",
    ]


def straightness(rows: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """Fits the daemons' cores = base a daemon + cost a message, over all rows that
    lost nothing; and the worst deviation as a share.
    """
    rows = [row for row in rows if row["lost"] == 0]
    if len(rows) < 3:
        return None
    inputs = np.array([[row["size"]["daemons"], row["sent_hz"]] for row in rows])
    cores = np.array([row["cores"]["daemons"] for row in rows])
    found, *_ = np.linalg.lstsq(inputs, cores, rcond=None)
    off = np.abs(inputs @ found - cores) / cores
    return {
        "core_per_daemon": float(found[0]),
        "us_per_message": float(found[1] * 1e6),
        "worst_share": float(off.max()),
    }


def tell(rows: Sequence[dict[str, Any]]) -> None:
    table = [list(HEADS), *(cells(row) for row in rows)]
    widths = [max(len(line[n]) for line in table) for n in range(len(HEADS))]
    for line in table:
        print("  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)))
    fitted = straightness(rows)
    if fitted is not None:
        print(
            f"daemons: {100 * fitted['core_per_daemon']:.1f} % of a core each and "
            f"{fitted['us_per_message']:.0f} us a message; rows are off that line by "
            f"at most {100 * fitted['worst_share']:.0f} %"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
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
    parser.add_argument("--log", action="store_true", help="the daemons keep logs")
    parser.add_argument(
        "--stop-one",
        action="store_true",
        help="ten consumers but the first are stopped (SIGSTOP) while it measures",
    )
    parser.add_argument("--json", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    sizes = [Size(*row) for row in options.row] if options.row else ROWS
    rows: list[dict[str, Any]] = []
    for number, size in enumerate(sizes, 1):
        begin_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            fleet = Fleet(size, Path(folder), has_log=options.log)
            try:
                made = run(
                    fleet,
                    options.seconds,
                    options.warm_up,
                    is_one_stopped=options.stop_one,
                )
                rows.append(made)
            finally:
                fleet.close()
        took_s, load = time.monotonic() - begin_s, os.getloadavg()[0]
        text = f"row {number} of {len(sizes)}: {took_s:.0f} s, load {load:.1f}\n"
        sys.stderr.write(text)
    tell(rows)
    found = {"has_log": options.log, "rows": rows, "line": straightness(rows)}
    write_results(options.json, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
