# SPDX-License-Identifier: MIT
"""A fleet of processes on this machine: one that writes frames to ptys, daemons,
routers in a chain, and consumers.
"""

from __future__ import annotations

import gc
import json
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zenoh

from benchmarks.common.load import (
    PATIENCE_S,
    answer_of,
    feed,
    free_endpoint,
    wait_for_line,
)

# Consumers of one process, each with a session and a link of its own. The first one of
# a fleet has a process to itself.
TOGETHER = 10
# How many probes each consumer but the first one hears.
SCREEN = 16


class Size(msgspec.Struct, frozen=True):
    """The data of one row of the table."""

    probes: int
    rate_hz: int
    daemons: int
    routers: int
    consumers: int


def _session(endpoint: str, mode: str, listen: str = "") -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([endpoint] if endpoint else []))
    if listen:
        config.insert_json5("listen/endpoints", json.dumps([listen]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    wait = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"
    config.insert_json5(wait, "50000")
    return zenoh.open(config)


def route(listen: str, connect: str, to: Connection) -> None:
    """A router, until it is told to stop."""
    with _session(connect, "router", listen):
        to.send("up")
        to.recv()


def consume(endpoint: str, hears: list[list[str]], to: Connection) -> None:
    """Consumers, each of some probes: counts messages and sequence gaps."""
    counts: list[dict[str, list[int]]] = [{} for _ in hears]

    def counting(heard: dict[str, list[int]]) -> Callable[[zenoh.Sample], None]:
        def on_pose(sample: zenoh.Sample) -> None:
            number, probe = _number(bytes(sample.payload)), str(sample.key_expr)
            of = heard.setdefault(probe, [number, number, 0])
            of[1] = number
            of[2] += 1

        return on_pose

    sessions = [_session(endpoint, "client") for _ in hears]
    for session, heard, probes in zip(sessions, counts, hears, strict=True):
        for probe in probes:
            session.declare_subscriber(f"imud/{probe}/pose", counting(heard))
    to.send("up")
    to.recv()
    got = [of for heard in counts for of in heard.values()]
    missed = sum(last - first + 1 - count for first, last, count in got)
    to.send({"got": sum(count for _, _, count in got), "missed": missed})
    for session in sessions:
        session.close()


def _number(payload: bytes) -> int:
    begin = payload.index(b'"number":') + 9
    return int(payload[begin : payload.index(b",", begin)])


def follow(endpoint: str, to: Connection, heard_path: Path, told_path: Path) -> None:
    """The consumer of all poses, of which everything is noted, and of statuses: the
    number of the last pose by probe.
    """
    heard: list[tuple[int, bytes]] = []
    told: dict[str, bytes] = {}
    gc.disable()
    with _session(endpoint, "client") as session:
        session.declare_subscriber(
            "imud/*/status",
            lambda sample: told.update({str(sample.key_expr): bytes(sample.payload)}),
        )
        session.declare_subscriber(
            "imud/*/pose",
            lambda sample: heard.append((time.time_ns(), bytes(sample.payload))),
        )
        to.send("up")
        while to.recv() == "how many":
            to.send(len(heard))
    rows = np.zeros((len(heard), 6), dtype=np.int64)
    for row, (t_ns, payload) in enumerate(heard):
        pose = json.loads(payload)
        read_ns = -1
        if pose["t_ns"] is not None and pose["age_us"] is not None:
            read_ns = pose["t_ns"] + 1000 * pose["age_us"]
        counts = pose["seq"], pose["number"], pose["missing"]
        rows[row] = _probe(pose), *counts, read_ns, t_ns
    np.save(heard_path, rows)
    statuses = [json.loads(payload) for payload in told.values()]
    last = [(_probe(each), each["quality"]["number"] or 0) for each in statuses]
    np.save(told_path, np.array(last, dtype=np.int64).reshape(-1, 2))
    to.send({"bytes": sum(len(payload) for _, payload in heard)})


def _probe(record: dict[str, Any]) -> int:
    return int(record["probe"][-4:], 16)


class Fleet:
    """Processes of a size, started; `groups` has their ids by what they are."""

    def __init__(self, size: Size, folder: Path, *, has_log: bool) -> None:
        self.size = size
        self.sent_path, self.heard_path = folder / "sent.npy", folder / "heard.npy"
        self.told_path = folder / "told.npy"
        self._spawn = multiprocessing.get_context("spawn")
        self._processes: list[BaseProcess] = []
        self._daemons: list[subprocess.Popen[bytes]] = []
        self.groups: dict[str, list[int]] = {}
        self.feeder = self._start(
            "feeder", feed, size.probes, size.rate_hz, last=(self.sent_path,)
        )
        self._ports: list[str] = answer_of(self.feeder, PATIENCE_S)
        self._endpoints = [free_endpoint() for _ in range(size.routers)]
        self._routers = [
            self._start("routers", route, own, before)
            for own, before in zip(
                self._endpoints, ("", *self._endpoints[:-1]), strict=True
            )
        ]
        for router in self._routers:
            answer_of(router, PATIENCE_S)
        self._start_daemons(folder, has_log=has_log)
        end = self._endpoints[-1]
        notes = (self.heard_path, self.told_path)
        self.follower = self._start("consumer", follow, end, last=notes)
        answer_of(self.follower, PATIENCE_S)
        self.others = [
            self._start("others", consume, end, [self._screen(n) for n in group])
            for group in self._groups_of_others()
        ]
        for other in self.others:
            answer_of(other, PATIENCE_S)

    def _groups_of_others(self) -> list[range]:
        count = self.size.consumers
        return [
            range(first, min(first + TOGETHER, count))
            for first in range(1, count, TOGETHER)
        ]

    def _screen(self, consumer: int) -> list[str]:
        """Ids of the probes that a consumer hears."""
        probes = self.size.probes
        chosen = {(consumer * SCREEN + n) % probes for n in range(SCREEN)}
        return [f"f0{number:014x}" for number in sorted(chosen)]

    def _start(
        self,
        group: str,
        target: Callable[..., None],
        *arguments: Any,
        last: tuple[Any, ...] = (),
    ) -> Connection:
        ours, theirs = self._spawn.Pipe()
        # Daemonic: they end with the benchmark, though a later one cannot start.
        words = (*arguments, theirs, *last)
        process = self._spawn.Process(target=target, args=words, daemon=True)
        process.start()
        theirs.close()
        self._processes.append(process)
        self.groups.setdefault(group, []).append(process.pid or 0)
        return ours

    def _start_daemons(self, folder: Path, *, has_log: bool) -> None:
        for number in range(self.size.daemons):
            path = folder / f"imud-{number}.toml"
            # The daemons are spread over the routers.
            where = self._endpoints[number % len(self._endpoints)]
            path.write_text(
                f'[zenoh]\nmode = "client"\nconnect = ["{where}"]\n'
                '[params]\nhistory = ""\n'
            )
            ports = self._ports[number :: self.size.daemons]
            log = ["--log", str(folder / "logs")] if has_log else ["--no-log"]
            words = [sys.executable, "-m", "imud", "run", "--config", str(path)]
            words += [*log, "--no-page", *ports]
            lines = folder / f"imud-{number}.txt"
            with lines.open("w") as file:
                daemon = subprocess.Popen(words, stderr=file)
            self._daemons.append(daemon)
            self.groups.setdefault("daemons", []).append(daemon.pid)
            wait_for_line(lines, "connects to")

    def close(self) -> None:
        for daemon in self._daemons:
            daemon.terminate()
        for daemon in self._daemons:
            daemon.wait()
        for process in self._processes:
            process.kill()
            process.join()
