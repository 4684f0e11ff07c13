# SPDX-License-Identifier: MIT
"""A daemon under load: probes that write to ptys, and a subscriber, as processes.

Both note CLOCK_MONOTONIC, so that the way of each pose can be timed.
"""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from benchmarks.common.load import (
    PATIENCE_S,
    answer_of,
    cpu_s,
    feed,
    free_endpoint,
    idle_s,
    rss_mib,
    wait_for_line,
)
from benchmarks.common.source import RATE_HZ

WARM_UP_S = 2.0  # not measured: imports, the first hello


def follow(endpoint: str, to: Connection, path: Path) -> None:
    """Subscribe; note when each pose came, and the last status of each probe."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    heard: list[tuple[int, bytes]] = []
    statuses: dict[str, bytes] = {}

    def on_pose(sample: zenoh.Sample) -> None:
        heard.append((time.monotonic_ns(), bytes(sample.payload)))

    def on_status(sample: zenoh.Sample) -> None:
        statuses[str(sample.key_expr)] = bytes(sample.payload)

    with zenoh.open(config) as session:
        session.declare_subscriber("imud/*/pose", on_pose)
        session.declare_subscriber("imud/*/status", on_status)
        to.send("ready")
        to.recv()
    notes = np.zeros((len(heard), 3), dtype=np.int64)
    for row, (t_ns, payload) in enumerate(heard):
        pose = json.loads(payload)
        notes[row] = int(pose["probe"][-2:], 16), pose["seq"], t_ns
    np.save(path, notes)
    to.send([json.loads(payload) for payload in statuses.values()])


def live(
    probes: int, seconds: float, folder: Path, *, is_relay: bool = False
) -> dict[str, Any]:
    """Run the daemon, or the bare relay, with probes, a subscriber and a log."""
    spawn = multiprocessing.get_context("spawn")
    to_feeder, feeder_end = spawn.Pipe()
    to_follower, follower_end = spawn.Pipe()
    sent_path, heard_path = folder / "sent.npy", folder / "heard.npy"
    endpoint = free_endpoint()
    total_s = seconds + WARM_UP_S
    feeder = spawn.Process(target=feed, args=(probes, total_s, feeder_end, sent_path))
    follower = spawn.Process(target=follow, args=(endpoint, follower_end, heard_path))
    feeder.start()
    feeder_end.close()  # so that recv() ends if the process does
    names = answer_of(to_feeder, PATIENCE_S)
    logs = str(folder / "logs")
    command = ["-m", "imud", "run", *names, "--listen", endpoint, "--log", logs]
    if is_relay:
        command = [str(Path(__file__).with_name("relay.py")), endpoint, *names]
    with (folder / "daemon.txt").open("w") as lines:
        daemon = subprocess.Popen([sys.executable, *command], stderr=lines, cwd=folder)
    try:
        wait_for_line(folder / "daemon.txt", "listens on")
        follower.start()
        follower_end.close()
        answer_of(to_follower, PATIENCE_S)
        to_feeder.send("go")
        time.sleep(WARM_UP_S)
        begin_s, begin_cpu, idle = time.monotonic(), cpu_s(daemon.pid), idle_s()
        time.sleep(seconds - 0.5)
        passed_s = time.monotonic() - begin_s
        cpu = (cpu_s(daemon.pid) - begin_cpu) / passed_s
        idle = (idle_s() - idle) / passed_s
        memory = rss_mib(daemon.pid)
        sent = answer_of(to_feeder, PATIENCE_S)
        time.sleep(2.5)  # until two more statuses have come
        to_follower.send("stop")
        statuses = answer_of(to_follower, PATIENCE_S)
        to_feeder.send("stop")
        feeder.join()
        follower.join()
    finally:
        daemon.terminate()
        daemon.wait()
        for process in (feeder, follower):
            if process.is_alive():
                process.kill()
    return {
        "probes": probes,
        "is_relay": is_relay,
        "seconds": seconds,
        "cpu_core": cpu,
        "idle_cores": idle,
        "rss_mib": memory,
        **latency(np.load(sent_path), np.load(heard_path)),
        **sent,
        **ledger(statuses),
    }


def latency(sent: Any, heard: Any) -> dict[str, Any]:
    """Microseconds from the byte written to the callback, after the warm-up."""
    sent = sent[sent[:, 1] % RATE_HZ != 0]  # hellos are no poses
    begin_ns = sent[:, 2].min() + int(WARM_UP_S * 1e9)
    at = {(probe, sequence): t_ns for probe, sequence, t_ns in heard.tolist()}
    waited = [
        (at[probe, sequence] - t_ns) / 1000
        for probe, sequence, t_ns in sent.tolist()
        if t_ns >= begin_ns and (probe, sequence) in at
    ]
    late = np.array(waited if waited else [np.nan])
    return {
        "poses_sent": len(sent),
        "poses_heard": len(at),
        "median_us": float(np.median(late)),
        "p99_us": float(np.percentile(late, 99)),
        "worst_us": float(late.max()),
    }


def ledger(statuses: Sequence[Any]) -> dict[str, Any]:
    """The daemon's own counts, summed over all probes."""
    ledgers = [status["ledger"] for status in statuses]
    return {
        "received": sum(each["received"] for each in ledgers),
        "lost": sum(each["lost"] for each in ledgers),
        "corrupt": sum(each["corrupt"] for each in ledgers),
        "dropped": sum(sum(each["dropped"].values()) for each in ledgers),
        "logged": sum(sum(each["logged"].values()) for each in ledgers),
    }
