# SPDX-License-Identifier: MIT
"""Runs a fleet and computes its figures, by hop and by process."""

from __future__ import annotations

import os
import signal
import sys
import time
from typing import Any

import msgspec
import numpy as np

from benchmarks.common.load import PATIENCE_S, answer_of, cpu_s, idle_s, rss_mib
from benchmarks.host.fleet import Fleet

# After the last message it looks so often whether more has arrived, until nothing has
# for some times, at most so many times.
DRAIN_S, DRAIN_QUIET, DRAIN_MAX = 3.0, 3, 30
LONG_S = 4 * PATIENCE_S  # a consumer takes its time to count what it has heard


def cpu_of(fleet: Fleet) -> dict[str, float]:
    """Seconds of processor time by group of processes."""
    return {name: sum(map(cpu_s, pids)) for name, pids in fleet.groups.items()}


def run(
    fleet: Fleet, seconds: float, warm_up_s: float, *, is_one_stopped: bool = False
) -> dict[str, Any]:
    """Lets a fleet work, and measures after the warm-up. `is_one_stopped`: the first
    process of other consumers is stopped meanwhile.
    """
    fleet.feeder.send("go")
    wait(warm_up_s, "warm-up")
    if is_one_stopped:
        os.kill(fleet.groups["others"][0], signal.SIGSTOP)
    begin_ns, begin, before, idle = (
        time.time_ns(),
        time.monotonic(),
        cpu_of(fleet),
        idle_s(),
    )
    wait(seconds, "measures")
    passed_s = time.monotonic() - begin
    after, idle = cpu_of(fleet), idle_s() - idle
    if is_one_stopped:
        os.kill(fleet.groups["others"][0], signal.SIGCONT)
    memory = {name: sum(map(rss_mib, pids)) for name, pids in fleet.groups.items()}
    fleet.feeder.send("stop")
    drain(fleet)
    fleet.feeder.send("how many")
    sent = answer_of(fleet.feeder, LONG_S)
    for each in (fleet.follower, *fleet.others):
        each.send("stop")
    heard = answer_of(fleet.follower, LONG_S)
    others = [answer_of(each, LONG_S) for each in fleet.others]
    cores = {name: (after[name] - before[name]) / passed_s for name in after}
    out_bytes = heard["bytes"] / max(1, counted(fleet)["got"])
    got = counted(fleet)["got"] + sum(each["got"] for each in others)
    rate_hz = fleet.size.probes * fleet.size.rate_hz
    figures = delays(fleet, begin_ns, begin_ns + int(seconds * 1e9))
    return {
        "size": msgspec.to_builtins(fleet.size),
        "seconds": seconds,
        "sent_hz": figures["sent_hz"],
        "in_mb_s": sent["bytes"] / sent["seconds"] / 1e6,
        "out_mb_s": out_bytes * got / sent["seconds"] / 1e6,
        "to_daemon_ms": figures["to_daemon_ms"],
        "to_consumer_ms": figures["to_consumer_ms"],
        **counted(fleet),
        "others_missed": sum(each["missed"] for each in others),
        "overrun": sent["overrun"],
        "cores": cores,
        "cpu_us": {name: 1e6 * share / rate_hz for name, share in cores.items()},
        "rss_mib": memory,
        "idle_share": idle / passed_s / (os.cpu_count() or 1),
        "load": os.getloadavg()[0],
    }


def wait(seconds: float, what: str) -> None:
    """Sleeps, with a line on a terminal that says for how long."""
    until_s = time.monotonic() + seconds
    while (left_s := until_s - time.monotonic()) > 0:
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\033[K{what}: {left_s:.0f} s left")
        time.sleep(min(1.0, left_s))
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")


def drain(fleet: Fleet) -> None:
    """Waits until all that is on its way has arrived."""
    counts: list[int] = []
    while len(counts) < DRAIN_QUIET or (
        len(counts) < DRAIN_MAX and len(set(counts[-DRAIN_QUIET:])) > 1
    ):
        wait(DRAIN_S, "drains")
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
