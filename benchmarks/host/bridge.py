# SPDX-License-Identifier: MIT
"""What imud bridge costs and delivers: each output alone, of a virtual Nano that a hand
moves, to a program of its field: rate, loss, largest difference from the published
poses, time from the daemon's receipt of a pose to the other end.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import multiprocessing
import os
import queue
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common.images import RunFailed, simulated
from benchmarks.common.load import (
    PATIENCE_S,
    answer_of,
    cpu_s,
    free_endpoint,
    wait_for_line,
)
from benchmarks.harness import Figure, Report, Table
from imud.bridge.mavlink import ned_of
from imud.bridge.output import library
from imud.bridge.vmc import tracker_rotation
from imud.client import Pose, subscribe
from imud.config.settings import Config
from imud.rotation import matrix_rows

Arrivals = list[tuple[int, tuple[float, ...]]]  # UTC in ns, what came
WARM_UP_S = 3.0
MQTT_HZ = 20


def lines_of(*command: str) -> Iterator[str]:
    """What a program prints, which ends with this process."""
    command = ("setpriv", "--pdeathsig", "KILL", *command)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        yield from program.stdout or ()


def from_oscdump(port: int, address: str) -> Iterator[Any]:
    """What liblo's program prints; a quaternion comes last."""
    for line in lines_of("stdbuf", "-oL", program("oscdump"), str(port)):
        words = line.split()
        if words[1].endswith(address):
            yield time.time_ns(), tuple(map(float, words[-4:]))


def from_lsl(_: int) -> Iterator[Any]:
    pylsl = library("pylsl", "lsl")
    found: list[Any] = []
    while not found:
        found = pylsl.resolve_byprop("type", "MoCap", timeout=1.0)
    inlet = pylsl.StreamInlet(found[0])
    while True:
        values, _stamp = inlet.pull_sample()
        yield time.time_ns(), tuple(values[:4])


def from_mosquitto(port: int) -> Iterator[Any]:
    mqtt = library("paho.mqtt.client", "mqtt")
    heard: queue.Queue[tuple[int, bytes]] = queue.Queue()
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.on_message = lambda _, __, told: heard.put((time.time_ns(), told.payload))
    client.connect("127.0.0.1", port)
    client.subscribe("imud/+/state")
    client.loop_start()
    while True:
        t_ns, payload = heard.get()
        state = json.loads(payload)
        if state["tilt_deg"] is not None:
            yield t_ns, (state["tilt_deg"], state["tilt_sigma_deg"])


def from_mavlink(port: int) -> Iterator[Any]:
    parser = library("pymavlink.dialects.v20.common", "mavlink").MAVLink(None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", port))
        while True:
            data, t_ns = end.recv(65536), time.time_ns()
            for message in parser.parse_buffer(data) or ():
                if message.get_type() == "ATTITUDE_QUATERNION_COV":
                    yield t_ns, tuple(message.q)


def tilt_of(pose: Pose) -> tuple[float, ...]:
    tilt = math.degrees(math.acos(matrix_rows(pose.q)[2][2]))
    return tilt, pose.tilt_sigma_deg or math.nan


# By output: who receives, what that is of a pose, the last digit of what it prints.
ENDS: dict[str, tuple[Callable[[int], Iterator[Any]], Any, float]] = {
    "osc": (partial(from_oscdump, address="/q"), lambda p: p.q, 1e-6),
    "vmc": (
        partial(from_oscdump, address="/Tra/Pos"),
        lambda p: (*tracker_rotation(p.q)[1:], p.q[0]),
        1e-6,
    ),
    "lsl": (from_lsl, lambda p: p.q, 1e-12),
    "mqtt": (from_mosquitto, tilt_of, 1e-6),
    "mavlink": (from_mavlink, lambda p: ned_of(p.q), 1e-7),
}


def receive(name: str, port: int, to: Connection) -> None:
    """In a process of its own: tells what came when it is asked."""
    arrivals: Arrivals = []

    def note() -> None:
        arrivals.extend(ENDS[name][0](port))

    threading.Thread(target=note, daemon=True).start()
    to.recv()
    to.send(arrivals[:])
    to.recv()


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def is_open(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def program(name: str) -> str:
    """The path of a program, which may be an administrator's."""
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
    if found is None:
        raise RunFailed(f"{name} is not there: apt install liblo-tools mosquitto")
    return found


@contextlib.contextmanager
def ended(process: subprocess.Popen[Any]) -> Iterator[subprocess.Popen[Any]]:
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def settings(name: str, port: int) -> str:
    own = {"enabled": "true", "relative_heading": "true", "rate_hz": "0"}
    own |= {"to": f"'127.0.0.1:{port}'", "digits": "6"}
    if name == "mqtt":
        own["rate_hz"] = str(MQTT_HZ)
    fields = getattr(Config(), name).__struct_fields__
    kept = [f"{key} = {value}" for key, value in own.items() if key in fields]
    return "\n".join((f"[{name}]", *kept))


def measured_of(name: str, endpoint: str, seconds: float, folder: Path) -> Any:
    """One output, for so long."""
    port = free_port()
    (folder / "imud.toml").write_text(settings(name, port))
    (folder / "broker").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true")
    spawn = multiprocessing.get_context("spawn")
    to_receiver, end = spawn.Pipe()
    receiver = spawn.Process(target=receive, args=(name, port, end), daemon=True)
    with contextlib.ExitStack() as stack:
        if name == "mqtt":
            command = [program("mosquitto"), "-c", str(folder / "broker")]
            stack.enter_context(
                ended(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            )
            while not is_open(port):
                time.sleep(0.05)
        receiver.start()
        stack.callback(receiver.kill)
        words = ["bridge", name, "--config", str(folder / "imud.toml")]
        command = [sys.executable, "-m", "imud", *words, "--connect", endpoint]
        bridge = stack.enter_context(ended(subprocess.Popen(command)))
        told = stack.enter_context(subscribe(endpoint=endpoint, seconds=seconds))
        poses = [next(told)]
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + WARM_UP_S:
            poses.append(next(told))
        cpu, then_s = cpu_s(bridge.pid), time.monotonic()
        poses += told
        share = (cpu_s(bridge.pid) - cpu) / (time.monotonic() - then_s)
        to_receiver.send("tell")
        arrivals = answer_of(to_receiver, PATIENCE_S)
    return {"output": name, "cpu_core": share, **compared(name, poses, arrivals)}


def compared(name: str, poses: Sequence[Pose], arrivals: Arrivals) -> dict[str, Any]:
    """Both are in their order: an arrival is the next pose that it can be."""
    _, of, digit = ENDS[name]
    # Poses of the warm-up, in which the other end may not listen yet, are left out.
    first_ns = arrivals[0][0] + int(WARM_UP_S * 1e9) if arrivals else 0
    wanted = np.array([of(pose) for pose in poses])
    late, different, at, skipped, first = [], [0.0], 0, 0, None
    for t_ns, values in arrivals:
        apart = np.abs(wanted[at:] - values).max(axis=1)
        fitting = np.flatnonzero(apart <= digit)
        if not len(fitting):
            continue  # before the first pose here
        step = int(fitting[0])
        pose, at = poses[at + step], at + step + 1
        if t_ns < first_ns:
            continue
        first = at if first is None else first
        skipped += step if at != first else 0
        different.append(float(apart[step]))
        late.append((t_ns - (pose.t_ns or 0)) / 1000 - (pose.age_us or 0))
    span_s = (arrivals[-1][0] - first_ns) / 1e9 if late else math.nan
    return {
        "rate_hz": len(late) / span_s,
        "arrived": len(late),
        "skipped": skipped,
        "difference": max(different),
        "median_us": float(np.median(late)) if late else math.nan,
        "p99_us": float(np.percentile(late, 99)) if late else math.nan,
    }


def table_of(runs: Sequence[dict[str, Any]]) -> Table:
    columns = {"output, to": "", "poses a second": ",.1f", "arrived": ",d"}
    columns |= {"lost": ",d", "largest difference": ".1e", "median, us": ",.0f"}
    columns |= {"p99, us": ",.0f", "share of one core": ".1%"}
    ends = {"osc": "oscdump", "vmc": "oscdump", "lsl": "an inlet"}
    ends |= {"mqtt": "mosquitto", "mavlink": "pymavlink"}
    rows = [
        (
            f"`{run['output']}`, {ends[run['output']]}",
            *(run["rate_hz"], run["arrived"]),
            run["skipped"] if run["output"] != "mqtt" else None,  # told to send fewer
            *(run["difference"], run["median_us"], run["p99_us"], run["cpu_core"]),
        )
        for run in runs
    ]
    return Table("outputs", columns, rows)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--outputs", nargs="*", choices=ENDS, default=[*ENDS])
    parser.add_argument("--seconds", type=float, default=20.0, help="of each output")


def measured(args: argparse.Namespace) -> Report:
    runs = []
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        port, endpoint = folder / "nano", free_endpoint()
        imud = [sys.executable, "-m", "imud"]
        words = [*simulated("nano"), "--stream", "--link", str(port)]
        sim = stack.enter_context(
            ended(subprocess.Popen([*imud, *words], stdout=subprocess.DEVNULL))
        )
        while not port.exists():
            assert sim.poll() is None
            time.sleep(0.05)
        words = ["run", str(port), "--listen", endpoint, "--no-log", "--no-page"]
        lines = stack.enter_context((folder / "daemon.txt").open("w"))
        stack.enter_context(ended(subprocess.Popen([*imud, *words], stderr=lines)))
        wait_for_line(folder / "daemon.txt", "found on")
        for name in args.outputs:
            runs.append(measured_of(name, endpoint, args.seconds, folder))
    figures = [
        Figure(f"{run['output']}: lost", run["skipped"], (0, 0), (0, 0))
        for run in runs
        if run["output"] != "mqtt"
    ]
    return Report([table_of(runs)], figures, {"runs": runs})


main = partial(harness.run, "bridge", __doc__, measured, options)
