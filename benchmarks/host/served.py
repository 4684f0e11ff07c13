# SPDX-License-Identifier: MIT
"""Foxglove served by the daemon itself, or by a process on the subscribe API that gives
the same records to the same server: latency, and processor time of both processes.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import multiprocessing
import struct
import tempfile
import threading
import time
from collections.abc import Sequence
from functools import partial
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from benchmarks import harness
from benchmarks.common.load import cpu_s, free_endpoint
from benchmarks.harness import Report, Table
from benchmarks.host.live import latency, live
from imud.client import Client, Delivery
from imud.errors import DaemonNotFound
from imud.probes.record import Record
from imud.sinks.foxglove import FoxgloveSink

WAYS = {"none": "nobody", "daemon": "the daemon", "bridge": "another process"}
TOPICS = ("pose", "raw", "event", "stroke", "status")
START_S = 4.0  # in which processes import what they need
NONE = ((0.0, 0.0), (1.0, 0.0))
_MESSAGE = struct.Struct("<BIQ")  # operation, subscription, time


def pass_on(endpoint: str, port: int) -> None:
    """The other process."""
    sink, lock = FoxgloveSink(("127.0.0.1", port), "imud"), threading.Lock()
    client = None
    while client is None:
        with contextlib.suppress(DaemonNotFound):
            client = Client(endpoint)

    def put(topic: str, delivery: Delivery) -> None:
        values, now_ns = msgspec.json.decode(delivery.payload), time.time_ns()
        t_ns = values["t_ns"] or now_ns
        record = Record(
            *(delivery.probe, topic, delivery.payload, b"", 0, t_ns, now_ns),
            values=values,
        )
        with lock:
            sink.write(record)

    for topic in TOPICS:
        client.listen(topic, None, partial(put, topic))
    sink.open()
    threading.Event().wait()


def watch(way: str, endpoint: str, port: int, stop: Event, folder: Path) -> None:
    """Foxglove's side, from before the first pose on: notes when each came, and what
    the other process takes between the first and the last of them.
    """
    spawn = multiprocessing.get_context("spawn")
    other = spawn.Process(target=pass_on, args=(endpoint, port), daemon=True)
    if way == "bridge":
        other.start()
    notes: list[tuple[int, int, int]] = []
    taken: list[tuple[float, float]] = []
    viewer, own = None, [Subprotocol("foxglove.sdk.v1")]
    while viewer is None:
        with contextlib.suppress(OSError):
            viewer = connect(f"ws://127.0.0.1:{port}", subprotocols=own)
    with contextlib.suppress(ConnectionClosed):
        while not stop.is_set():
            try:
                data, t_ns = viewer.recv(0.2), time.time_ns()
            except TimeoutError:
                continue
            if isinstance(data, str):
                wanted = [
                    {"id": each["id"], "channelId": each["id"]}
                    for each in json.loads(data).get("channels", ())
                    if each["topic"].endswith("/pose")
                ]
                subscribed = {"op": "subscribe", "subscriptions": wanted}
                viewer.send(json.dumps(subscribed))
            elif data[0] == 1:
                pose = json.loads(data[_MESSAGE.size :])
                notes.append((int(pose["probe"][-2:], 16), pose["seq"], t_ns))
                if other.pid and len(notes) % 100 == 0:
                    taken.append((time.monotonic(), cpu_s(other.pid)))
    np.save(folder / "viewed.npy", np.array(notes, dtype=np.int64))
    (then_s, then), (now_s, now) = (
        (taken[len(taken) // 4], taken[-1]) if taken else NONE
    )
    (folder / "taken.json").write_text(json.dumps((now - then) / (now_s - then_s)))
    if other.pid:
        other.kill()


def run(way: str, probes: int, seconds: float, folder: Path) -> dict[str, Any]:
    host, _, port = free_endpoint().removeprefix("tcp/").partition(":")
    endpoint, file = free_endpoint(), folder / "imud.toml"
    enabled = str(way == "daemon").lower()
    file.write_text(f"[foxglove]\nenabled = {enabled}\nlisten = '{host}:{port}'\n")

    def command(names: list[str]) -> list[str]:
        words = ["--config", str(file), "--listen", endpoint, "--no-page"]
        return ["-m", "imud", "run", *names, *words, "--log", str(folder / "logs")]

    spawn = multiprocessing.get_context("spawn")
    stop = spawn.Event()
    words = (way, endpoint, int(port), stop, folder)
    viewer = spawn.Process(target=watch, args=words)
    if way != "none":
        viewer.start()
        time.sleep(START_S)
    found = live(probes, seconds, folder, endpoint, command)
    result = {"way": way, "probes": probes, "daemon": found["cpu_core"], "other": 0.0}
    if way == "none":
        return result
    stop.set()
    viewer.join()
    sent, viewed = np.load(folder / "sent.npy"), np.load(folder / "viewed.npy")
    result["other"] = json.loads((folder / "taken.json").read_text())
    return result | latency(sent, viewed)


def table_of(runs: Sequence[dict[str, Any]]) -> Table:
    columns = {"probes at 200 Hz": "", "served by": "", "median, us": ",.0f"}
    columns |= {"p99, us": ",.0f", "daemon, of a core": ".1%"}
    columns |= {"other process": ".1%", "both": ".1%"}
    rows = [
        (
            *(f"{each['probes']:.0f}", WAYS[each["way"]]),
            *(each.get("median_us"), each.get("p99_us")),
            *(each["daemon"], each["other"], each["daemon"] + each["other"]),
        )
        for each in runs
    ]
    return Table("ways", columns, rows)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--probes", type=int, nargs="*", default=[1, 8])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run")
    parser.add_argument("--rounds", type=int, default=3)


def measured(args: argparse.Namespace) -> Report:
    runs: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for _ in range(args.rounds):  # side by side, as the machine's load changes
        for probes, way in itertools.product(args.probes, WAYS):
            with tempfile.TemporaryDirectory() as folder:
                found = run(way, probes, args.seconds, Path(folder))
                runs.setdefault((probes, way), []).append(found)
    rows = [middle(each) for each in runs.values()]
    return Report([table_of(rows)], [], {"runs": [*runs.values()]})


def middle(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The median of each figure."""
    return {
        key: value
        if isinstance(value, str)
        else float(np.median([r[key] for r in runs]))
        for key, value in runs[0].items()
    }


main = partial(harness.run, "served", __doc__, measured, options)
