# SPDX-License-Identifier: MIT
"""A daemon under load: probes that write to ptys, and a subscriber, as processes.

Both note CLOCK_MONOTONIC, so that the way of each pose can be timed.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import selectors
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from benchmarks.common.source import RATE_HZ, Source
from benchmarks.host.soak import rss_mib
from imud.wire import messages
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message

WARM_UP_S = 2.0  # not measured: imports, the first hello
PATIENCE_S = 30.0
_REPLY = {"replied_command": "time", "result": "ok", "value": (0, 0)}


class FedPort:
    """A pty with a probe at its other end."""

    def __init__(self, number: int, rate_hz: int = RATE_HZ) -> None:
        self.source = Source(number, hello_every=rate_hz)
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        self._slave = slave  # kept open: the pty must not hang up
        os.set_blocking(self.master, False)
        self._decoder = FrameDecoder()
        self.overrun = 0  # frames that the pty had no room for

    def write(self, frame: bytes) -> None:
        try:
            os.write(self.master, frame)
        except BlockingIOError:
            self.overrun += 1

    def answer(self, now_us: int) -> None:
        """Reply to the daemon's requests for the time, if any have come."""
        try:
            heard = os.read(self.master, 4096)
        except BlockingIOError:
            return
        for content in self._decoder.feed(heard):
            said = messages.decode(content)
            if isinstance(said, Message) and said.name == "command":
                fields = _REPLY | {
                    "replied_command": said.fields["command"],
                    "replied_token": said.fields["token"],
                }
                reply = messages.encode(
                    "reply", fields, self.source.sequence, now_us & 0xFFFFFFFF
                )
                self.source.sequence += 1
                self.source.sent += 1
                self.write(encode_frame(reply))


def feed(probes: int, seconds: float, to: Connection, path: Path) -> None:
    """Write frames to ptys, the probes' phases spread evenly over the period."""
    ports = [FedPort(number) for number in range(probes)]
    waker = selectors.DefaultSelector()
    for port in ports:
        waker.register(port.master, selectors.EVENT_READ, port)
    to.send([port.name for port in ports])
    to.recv()
    turns = round(seconds * RATE_HZ)
    notes = np.zeros((turns * probes, 3), dtype=np.int64)
    step_ns = 1_000_000_000 // (RATE_HZ * probes)
    begin_ns = time.monotonic_ns() + 50_000_000
    row = 0
    for turn in range(turns):
        for number, port in enumerate(ports):
            due_ns = begin_ns + (turn * probes + number) * step_ns
            while (left_ns := due_ns - time.monotonic_ns()) > 0:
                for key, _ in waker.select(left_ns * 1e-9):
                    key.data.answer((time.monotonic_ns() - begin_ns) // 1000)
            now_ns = time.monotonic_ns()
            sequence = port.source.sequence
            frame = port.source.say((now_ns - begin_ns) // 1000)
            notes[row] = number, sequence, time.monotonic_ns()
            port.write(frame)
            row += 1
    np.save(path, notes)
    to.send(
        {
            "sent": sum(port.source.sent for port in ports),
            "overrun": sum(port.overrun for port in ports),
        }
    )
    to.recv()  # ptys stay open until the daemon has published its last status


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
        said = json.loads(payload)
        notes[row] = int(said["probe"][-2:], 16), said["seq"], t_ns
    np.save(path, notes)
    to.send([json.loads(payload) for payload in statuses.values()])


def free_endpoint() -> str:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{taken.getsockname()[1]}"


def cpu_s(pid: int) -> float:
    """Seconds of user and system time of a process."""
    stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def idle_s() -> float:
    """Idle seconds of all cores: without any, other programs distort the figures."""
    words = Path("/proc/stat").read_text().split("\n", 1)[0].split()
    return int(words[4]) / os.sysconf("SC_CLK_TCK")


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


def answer_of(connection: Connection, patience_s: float) -> Any:
    if not connection.poll(patience_s):
        raise TimeoutError("a process of this benchmark says nothing")
    return connection.recv()


def wait_for_line(path: Path, pattern: str) -> None:
    until = time.monotonic() + PATIENCE_S
    while not re.search(pattern, path.read_text()):
        if time.monotonic() > until:
            raise TimeoutError(f"the daemon did not start: {path.read_text()}")
        time.sleep(0.02)


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
