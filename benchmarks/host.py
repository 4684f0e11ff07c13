# SPDX-License-Identifier: MIT
"""What the host side takes: decoding by one core, from a byte on the pty to a
subscriber's callback, the daemon's CPU and memory against the number of probes.

Probes are a process that writes frames to ptys at their times; the subscriber is
another, and both note CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import binascii
import json
import multiprocessing
import os
import re
import resource
import selectors
import socket
import struct
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import scoring
import soak
import zenoh

from imud.wire import messages, schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message

OUTPUT = scoring.PROJECT / "build" / "benchmarks" / "host.json"

RATE_HZ = 200
READ_BYTES = 4096
WARM_UP_S = 2.0  # imports, first hello, first of everything
PATIENCE_S = 30.0

# What the table is held against: frames/s, us, share of a core.
DECODE_TARGET = 2e6
LATENCY_TARGET_US = {8: (300.0, 2000.0)}
CORE_TARGET = {64: 1.0}

_HEAD = struct.Struct(schema.HEADER)
_REPLY = {"replied_command": "time", "result": "ok", "value": (0, 0)}


# Decoding


class PlainDecoder:
    """The same frames with the standard library alone, to compare with."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        *frames, self._rest = (self._rest + data).split(b"\0")
        return [content for frame in frames if (content := self._content(frame))]

    def _content(self, frame: bytes) -> bytes | None:
        out = bytearray()
        at = 0
        while at < len(frame):
            code = frame[at]
            out += frame[at + 1 : at + code]
            at += code
            if at < len(frame):
                out.append(0)
        if at != len(frame) or len(out) < 3:
            return None
        content, crc = bytes(out[:-2]), int.from_bytes(out[-2:], "little")
        is_hello = content[0] == HELLO_ID
        seed = schema.HELLO_SEED if is_hello else schema.SEED
        return content if binascii.crc_hqx(content, seed) == crc else None


HELLO_ID = next(message.id for message in schema.MESSAGES if message.name == "hello")


def rate_of(feed: Callable[[bytes], int], data: bytes, seconds: float) -> float:
    """Frames a second of CPU time; the best of what fits, as others use the machine."""
    reads = [data[i : i + READ_BYTES] for i in range(0, len(data), READ_BYTES)]
    best, until = 0.0, time.monotonic() + seconds
    while time.monotonic() < until or best == 0.0:
        begin = time.process_time()
        count = sum(map(feed, reads))
        best = max(best, count / (time.process_time() - begin))
    return best


def decoding(frames: int, seconds: float) -> dict[str, Any]:
    """Frames/s of each decoder, of poses and of a MAVLink message of their size."""
    source = soak.Source(0)
    source.sequence = 1
    poses = [source.say(i * 5000) for i in range(RATE_HZ - 1)]
    many = b"".join(poses) * (frames // len(poses) + 1)
    few = many[: len(many) // 20]
    ours, whole, plain = FrameDecoder(), FrameDecoder(), PlainDecoder()
    decode = messages.decode

    def to_messages(data: bytes) -> int:
        said = [decode(content) for content in whole.feed(data)]
        return sum(isinstance(each, Message) for each in said)

    size, mavlink = mavlink_rate(frames // 20, seconds)
    return {
        "frame_bytes": len(poses[0]),
        "mavlink_bytes": size,
        "read_bytes": READ_BYTES,
        "frames_a_second": {
            "frames, C": rate_of(lambda data: len(ours.feed(data)), many, seconds),
            "frames, Python": rate_of(lambda data: len(plain.feed(data)), few, seconds),
            "messages, C + Python": rate_of(to_messages, few, seconds),
            "messages, pymavlink": mavlink,
        },
    }


def mavlink_rate(frames: int, seconds: float) -> tuple[int, float]:
    """ATTITUDE_QUATERNION with its offset: 48 bytes, where a pose has 46."""
    from pymavlink.dialects.v20 import common

    parser = common.MAVLink(None)
    frame = common.MAVLink_attitude_quaternion_message(
        1, 0.5, 0.5, -0.5, 0.5, 0.1, 0.2, 0.3, (1.0, 0.1, 0.1, 0.1)
    ).pack(parser)

    def feed(data: bytes) -> int:
        return len(parser.parse_buffer(data) or ())

    return len(frame), rate_of(feed, bytes(frame) * frames, seconds)


# From the pty to a subscriber


class FedPort:
    """A pty, and the probe at its other end."""

    def __init__(self, number: int) -> None:
        self.source = soak.Source(number)
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
        """To the daemon's question for the time."""
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
    """Writes frames to ptys, the probes' phases spread over the period."""
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
    to.recv()  # ptys stay open until the daemon has told what it has


def follow(endpoint: str, to: Connection, path: Path) -> None:
    """A subscriber: notes when each pose came, and the last status of each probe."""
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
    """User and system time of a process."""
    stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def idle_s() -> float:
    """Of all cores: a machine that had none to spare measures its other users."""
    words = Path("/proc/stat").read_text().split("\n", 1)[0].split()
    return int(words[4]) / os.sysconf("SC_CLK_TCK")


def rss_mib(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def live(
    probes: int, seconds: float, folder: Path, *, is_relay: bool = False
) -> dict[str, Any]:
    """A daemon with so many probes, one subscriber, and its log; or the bare relay."""
    spawn = multiprocessing.get_context("spawn")
    to_feeder, feeder_end = spawn.Pipe()
    to_follower, follower_end = spawn.Pipe()
    sent_path, heard_path = folder / "sent.npy", folder / "heard.npy"
    endpoint = free_endpoint()
    total_s = seconds + WARM_UP_S
    feeder = spawn.Process(target=feed, args=(probes, total_s, feeder_end, sent_path))
    follower = spawn.Process(target=follow, args=(endpoint, follower_end, heard_path))
    feeder.start()
    feeder_end.close()  # who ends without a word ends the wait for it
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
        time.sleep(2.5)  # two statuses later it has told all
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
    """What the daemon itself says, over all probes."""
    ledgers = [status["ledger"] for status in statuses]
    return {
        "received": sum(each["received"] for each in ledgers),
        "lost": sum(each["lost"] for each in ledgers),
        "corrupt": sum(each["corrupt"] for each in ledgers),
        "dropped": sum(sum(each["dropped"].values()) for each in ledgers),
        "logged": sum(sum(each["logged"].values()) for each in ledgers),
    }


# Tables


def straightness(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """A line through CPU against probes: cost of none, of one, and the worst miss."""
    probes = np.array([run["probes"] for run in runs], dtype=float)
    cost = np.array([run["cpu_core"] for run in runs])
    slope, base = np.polyfit(probes, cost, 1)
    return {
        "base_core": float(base),
        "probe_core": float(slope),
        "worst_miss_core": float(np.abs(base + slope * probes - cost).max()),
    }


def verdict(run: dict[str, Any]) -> str:
    """Beside what was asked for, where something was."""
    words = []
    if run["is_relay"]:
        return "the bare relay"
    if run["probes"] in LATENCY_TARGET_US:
        median, p99 = LATENCY_TARGET_US[run["probes"]]
        is_met = run["median_us"] < median and run["p99_us"] < p99
        words.append(f"{median:.0f}/{p99:.0f} us " + ("met" if is_met else "NOT met"))
    if run["probes"] in CORE_TARGET:
        is_met = run["cpu_core"] < CORE_TARGET[run["probes"]] and not missed(run)
        words.append("one core, none lost: " + ("met" if is_met else "NOT met"))
    return ", ".join(words)


def missed(run: dict[str, Any]) -> int:
    """Frames that came to grief anywhere between the pty and the subscriber."""
    fell_out = run["poses_sent"] - run["poses_heard"]
    return int(fell_out + run["dropped"] + run["overrun"])


def tell_decoding(found: dict[str, Any]) -> None:
    print(
        f"one core, reads of {found['read_bytes']} bytes, frames of "
        f"{found['frame_bytes']} bytes (MAVLink: {found['mavlink_bytes']})"
    )
    for name, rate in found["frames_a_second"].items():
        note = ""
        if name == "frames, C":
            is_met = rate >= DECODE_TARGET
            note = f"  target {DECODE_TARGET:,.0f}: " + ("met" if is_met else "NOT met")
        print(f"  {name:22}{rate:14,.0f} frames/s{note}")


def tell_live(runs: Sequence[dict[str, Any]]) -> None:
    print("\nfrom the byte on the pty to the subscriber's callback, with logging")
    heads = (
        *("median us", "p99 us", "CPU %", "idle %", "RSS MiB"),
        *("poses", "missed", "logged"),
    )
    print(f"{'probes':>6}" + "".join(f"{head:>11}" for head in heads))
    for run in runs:
        cells = (
            f"{run['median_us']:.0f}",
            f"{run['p99_us']:.0f}",
            f"{100 * run['cpu_core']:.1f}",
            f"{100 * run['idle_cores']:.0f}",
            f"{run['rss_mib']:.0f}",
            f"{run['poses_sent']}",
            f"{missed(run)}",
            f"{run['logged']}",
        )
        line = "".join(f"{cell:>11}" for cell in cells)
        print(f"{run['probes']:6}{line}  {verdict(run)}".rstrip())
    runs = [run for run in runs if not run["is_relay"]]
    if len(runs) > 2:
        fitted = straightness(runs)
        print(
            f"CPU: {100 * fitted['base_core']:.1f} % and "
            f"{100 * fitted['probe_core']:.2f} % a probe; no run is off that line by "
            f"more than {100 * fitted['worst_miss_core']:.1f} %"
        )


def tell_memory(points: Sequence[dict[str, float]]) -> None:
    print("\nmemory of one process with decoder, ledger, clock, hub and log")
    for point in points:
        print(f"  after {point['hours']:5.2f} h{point['rss_mib']:10.1f} MiB")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--probes", type=int, nargs="*", default=[1, 8, 16, 32, 64])
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    parser.add_argument("--hours", type=float, default=1.0, help="of frames, memory")
    parser.add_argument("--frames", type=int, default=200_000, help="to decode")
    parser.add_argument("--json", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    found: dict[str, Any] = {"decoding": decoding(options.frames, 1.0)}
    tell_decoding(found["decoding"])
    runs = []
    for probes in options.probes:
        # The peer beside it, for as many as the target of latency is for.
        for is_relay in [True, False] if probes in LATENCY_TARGET_US else [False]:
            with tempfile.TemporaryDirectory() as folder:
                made = live(probes, options.seconds, Path(folder), is_relay=is_relay)
                runs.append(made)
    found["live"] = runs
    tell_live(runs)
    ours = [run for run in runs if not run["is_relay"]]
    if len(ours) > 2:
        found["line"] = straightness(ours)
    if options.hours > 0:
        with tempfile.TemporaryDirectory() as folder:
            soaked = soak.soak(options.hours, 1, 1, Path(folder))
        found["memory"] = soaked["memory"]
        tell_memory(soaked["memory"])
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
