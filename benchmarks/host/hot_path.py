# SPDX-License-Identifier: MIT
"""Processor time of a pose in the daemon, by stage, in one process: the least of some
runs, because a busy machine only adds to it.

Stages include those before them, up to the record; the sinks stand alone.
"""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.common.load import free_endpoint
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.common.source import PERIOD_US, Source
from imud.config.settings import Config, ZenohSettings
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.daemon.lane import Item
from imud.journal.speaker import Speaker
from imud.probes.session import Probe, Session
from imud.probes.timeline import host_ns
from imud.sinks.log import LogSink
from imud.sinks.ros2 import Ros2Sink
from imud.sinks.zenoh import ZenohSink
from imud.wire import messages
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import encode

OUTPUT = RESULTS / "hot-path.json"

Work = Callable[[], object]
PERIOD_NS = 1000 * PERIOD_US  # of the host, too: clocks that run alike
FLUSH_EVERY = 1280  # records: 64 probes at 200 Hz for the log's 0.1 s


class Kept(Hub):
    """Keeps records in place of handing them to sinks."""

    def __init__(self) -> None:
        super().__init__()
        self.items: list[Item] = []

    def put(self, item: Item) -> None:
        self.items.append(item)


class AnyPort:
    """The interface of a port for the intake."""

    name = "port"
    baud = 115_200

    def __init__(self, session: Session) -> None:
        self.session: Session | None = session

    def write(self, data: bytes) -> None:
        """Nobody listens."""

    def listen_again(self) -> None:
        """It has one rate."""


def frames_of(probes: int, turns: int, *, is_tared: bool) -> list[list[bytes]]:
    """With an origin, the first message after each hello says that it was set."""
    flags = ("tared",) if is_tared else ()
    sources = [Source(number, pose_flags=flags) for number in range(probes)]
    found = [[s.say(turn * PERIOD_US) for s in sources] for turn in range(turns)]
    if is_tared:
        tared = {"event": "tared", "cause": "command", "detail": 0}
        found[1] = probes * [encode_frame(encode("event", tared, 1, PERIOD_US))]
    return found


def decoding(turns: list[list[bytes]]) -> Work:
    decoders = [FrameDecoder() for _ in turns[0]]

    def work() -> None:
        for frames in turns:
            for decoder, frame in zip(decoders, frames, strict=True):
                for content in decoder.feed(frame):
                    messages.decode(content)

    return work


def hearing(turns: list[list[bytes]]) -> Work:
    begin_ns = host_ns()
    sessions = [Session(Probe, begin_ns) for _ in turns[0]]

    def work() -> None:
        for number, frames in enumerate(turns):
            t_ns = begin_ns + number * PERIOD_NS
            for session, frame in zip(sessions, frames, strict=True):
                session.receive(frame, t_ns)

    return work


def taking(turns: list[list[bytes]], hub: Hub) -> Work:
    intake = Intake(Config(), hub, Speaker(10.0, 3))
    timeline = intake.timeline
    begin_ns = host_ns()
    sessions = [Session(intake.probe, begin_ns, timeline=timeline) for _ in turns[0]]
    ports = [AnyPort(session) for session in sessions]

    def work() -> None:
        for number, frames in enumerate(turns):
            t_ns = begin_ns + number * PERIOD_NS
            for port, session, frame in zip(ports, sessions, frames, strict=True):
                intake.follow_host(t_ns)
                for event in session.receive(frame, t_ns):
                    intake.handle(event, port)

    return work


def logging_all(items: Sequence[Item], folder: str) -> Work:
    sink = LogSink(Path(folder))
    sink.open()

    def work() -> None:
        for number, item in enumerate(items):
            sink.write(item)
            if number % FLUSH_EVERY == 0:
                sink.flush()
        sink.close()

    return work


def publishing(items: Sequence[Item]) -> Work:
    sink = ZenohSink(ZenohSettings(listen=(free_endpoint(),)), lambda *_: None)
    sink.open()

    def work() -> None:
        for item in items:
            if not sink.try_write(item):
                sink.write(item)

    return work


def to_ros(items: Sequence[Item]) -> Work:
    sink = Ros2Sink([], 0, "imud", "world")
    sink.open()

    def work() -> None:
        for item in items:
            sink.write(item)

    return work


def least_us(make: Callable[[], Work], count: int, runs: int) -> float:
    """The time of this thread for one of `count` messages."""
    found = []
    for _ in range(runs):
        work = make()
        gc.collect()
        gc.disable()
        begin_s = time.thread_time()
        work()
        found.append(time.thread_time() - begin_s)
        gc.enable()
    return 1e6 * min(found) / count


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--probes", type=int, default=64)
    parser.add_argument("--turns", type=int, default=300, help="messages of each probe")
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument(
        "--tared", action="store_true", help="poses state errors since an origin"
    )
    options = parser.parse_args(arguments)
    logging.getLogger("imud").setLevel(logging.ERROR)
    turns = frames_of(options.probes, options.turns, is_tared=options.tared)
    count, runs = options.probes * options.turns, options.runs
    kept = Kept()
    taking(turns, kept)()
    with tempfile.TemporaryDirectory() as folder:
        rows: tuple[tuple[str, Callable[[], Work]], ...] = (
            ("bytes to message", lambda: decoding(turns)),
            ("... to account, clock and stamp", lambda: hearing(turns)),
            ("... to stages and record", lambda: taking(turns, Kept())),
            ("record to log", lambda: logging_all(kept.items, folder)),
            ("record to Zenoh, without subscribers", lambda: publishing(kept.items)),
            ("record to ROS 2, without subscribers", lambda: to_ros(kept.items)),
        )
        stages = {}
        for name, make in rows:
            stages[name] = least_us(make, count, runs)
            print(f"{name:38}{stages[name]:7.1f} us", flush=True)
    found = {"probes": options.probes, "turns": options.turns, "runs": runs}
    found |= {"tared": options.tared, "stages_us": stages}
    write_results(OUTPUT, found)
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # without waiting for Zenoh's threads
