# SPDX-License-Identifier: MIT
"""A daemon under load: probes that write to ptys, and a subscriber, as processes.

Both note UTC of this machine, so that the way of each pose can be timed.
"""

from __future__ import annotations

import array
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.common.load import (
    PATIENCE_S,
    answer_of,
    cpu_s,
    feed,
    idle_s,
    rss_mib,
    wait_for_line,
)
from benchmarks.common.source import RATE_HZ
from imud.client import Client

WARM_UP_S = 2.0  # not measured: imports, the first hello
WATCH_S = 1.0
END_S = 0.5  # of a run, in which the process is not watched any more


class Arrived(msgspec.Struct):
    """The recorded part of a pose: whole ones of an hour would take gigabytes."""

    probe: str
    seq: int


def follow(endpoint: str, keys: Path | None, to: Connection, path: Path) -> None:
    """Subscribe; note when each pose came, and the last status of each probe."""
    notes = array.array("q")
    decoder = msgspec.json.Decoder(Arrived)

    def note(_: str, payload: bytes) -> None:
        t_ns = time.time_ns()
        pose = decoder.decode(payload)
        notes.extend((int(pose.probe[-2:], 16), pose.seq, t_ns))

    with Client(endpoint, keys=keys) as client:
        client.subscribe("pose", None, note)
        to.send("ready")
        to.recv()
        statuses = client.statuses()
    np.save(path, np.array(notes, dtype=np.int64).reshape(-1, 3))
    to.send(statuses)


def live(
    probes: int,
    seconds: float,
    folder: Path,
    endpoint: str,
    command: Callable[[list[str]], list[str]],
    *,
    keys: Path | None = None,
    beside: BaseProcess | None = None,
) -> dict[str, Any]:
    """Run a daemon with probes and a subscriber, which has a file of `keys`, and a
    process beside it. `command`: the words that start the daemon with these ports.
    """
    spawn = multiprocessing.get_context("spawn")
    to_feeder, feeder_end = spawn.Pipe()
    to_follower, follower_end = spawn.Pipe()
    sent_path, heard_path = folder / "sent.npy", folder / "heard.npy"
    feeder = spawn.Process(target=feed, args=(probes, RATE_HZ, feeder_end, sent_path))
    words = (endpoint, keys, follower_end, heard_path)
    follower = spawn.Process(target=follow, args=words)
    processes: list[BaseProcess] = [feeder, follower, *([beside] if beside else [])]
    feeder.start()
    feeder_end.close()  # so that recv() ends if the process does
    start = [sys.executable, *command(answer_of(to_feeder, PATIENCE_S))]
    with (folder / "daemon.txt").open("w") as lines:
        daemon = subprocess.Popen(start, stderr=lines, cwd=folder)
    try:
        wait_for_line(folder / "daemon.txt", "listens on")
        follower.start()
        follower_end.close()
        answer_of(to_follower, PATIENCE_S)
        to_feeder.send("go")
        time.sleep(WARM_UP_S)
        if beside is not None:
            beside.start()
        observed = observe(daemon.pid, seconds)
        time.sleep(END_S)
        to_feeder.send("stop")
        sent = answer_of(to_feeder, PATIENCE_S)
        time.sleep(2.5)  # until two more statuses have come
        to_follower.send("stop")
        statuses = answer_of(to_follower, PATIENCE_S)
        to_feeder.send("end")
        for process in processes:
            process.join()
    finally:
        daemon.terminate()
        daemon.wait()
        for process in processes:
            if process.is_alive():
                process.kill()
    return {
        "probes": probes,
        "seconds": seconds,
        **observed,
        **latency(np.load(sent_path), np.load(heard_path)),
        **sent,
        "dropped": dropped(statuses),
    }


def observe(pid: int, seconds: float) -> dict[str, Any]:
    """Shares of cores that a process takes and that are idle, its MiB of memory at the
    end, and watch() of it meanwhile.
    """
    begin_s, begin_cpu, begin_idle = time.monotonic(), cpu_s(pid), idle_s()
    watched = [watch(pid)]
    while (left_s := begin_s + seconds - END_S - time.monotonic()) > 0:
        time.sleep(min(WATCH_S, left_s))
        watched.append(watch(pid))
    passed_s = time.monotonic() - begin_s
    return {
        "cpu_core": (cpu_s(pid) - begin_cpu) / passed_s,
        "idle_cores": (idle_s() - begin_idle) / passed_s,
        "rss_mib": rss_mib(pid),
        "watched": watched,
    }


def watch(pid: int) -> tuple[float, int]:
    """MiB of memory, and open files."""
    return rss_mib(pid), len([*Path(f"/proc/{pid}/fd").iterdir()])


def latency(sent: Any, heard: Any) -> dict[str, Any]:
    """Microseconds from the byte written to the callback, after the warm-up."""
    begin_ns = sent[:, 2].min() + int(WARM_UP_S * 1e9)
    at = {(probe, sequence): t_ns for probe, sequence, t_ns in heard.tolist()}
    waited = [
        (at[probe, sequence] - t_ns) / 1000
        for probe, sequence, t_ns in sent[:, :3].tolist()
        if t_ns >= begin_ns and (probe, sequence) in at
    ]
    late = np.array(waited if waited else [np.nan])
    return {
        "poses_sent": len(sent),
        "lost": len(sent) - len(at),
        "median_us": float(np.median(late)),
        "p99_us": float(np.percentile(late, 99)),
        "worst_us": float(late.max()),
    }


def dropped(statuses: Sequence[Any]) -> int:
    """What the daemon's sinks did not take, by its own counts."""
    return sum(sum(each["ledger"]["dropped"].values()) for each in statuses)
