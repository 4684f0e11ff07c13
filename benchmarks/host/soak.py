# SPDX-License-Identifier: MIT
"""Hours of frames in minutes, with random faults from a seed. The ledger must agree to
the frame with what was truly sent and truly arrived.

Frames go through decoder, ledger, clock, hub and two sinks: a counter, and the log,
whose complete files are read back and deleted. With --limited the log itself removes
them, as told, and how large its folder is stands beside the memory.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from benchmarks import harness
from benchmarks.common.load import rss_mib
from benchmarks.common.source import PERIOD_US, RATE_HZ
from benchmarks.harness import Figure, Report, Table
from benchmarks.host.faulty_line import CHUNK, Line
from imud.daemon.hub import Hub
from imud.daemon.lane import QUEUE_MAX, Item, Lane
from imud.log.file import Settings
from imud.log.retention import Retention
from imud.probes.record import Record
from imud.progress import Progress
from imud.sinks.log import LogSink

HOURS = 3.0
KEEP_MB = 100  # of a log that is limited
LOG_BYTES = 32 << 20  # bytes of a file
RSS_POINTS = 10


class Counting:
    """A sink that counts records by probe and topic."""

    name = "count"
    period_s = 0.05
    patience_s = 60.0

    def __init__(self) -> None:
        self.taken: Counter[tuple[str, str]] = Counter()

    def open(self) -> None:
        """Nothing to open."""

    def write(self, record: Item) -> None:
        if isinstance(record, Record):
            self.taken[record.probe, record.topic] += 1

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing to close."""


@dataclass(slots=True)
class Pruned:
    """Counts of complete log files, which are read back and deleted."""

    folder: Path
    files: int = 0
    bytes: int = 0
    frames: int = 0

    def prune(self, *, is_end: bool = False) -> None:
        files = sorted(self.folder.glob("*.mcap"), key=lambda path: path.stat().st_ino)
        files.sort(key=lambda path: path.stat().st_mtime_ns)
        # The next file is there before the last bytes of the one before it are.
        files = [path for path in files if path.stat().st_size > 0]
        for path in files if is_end else files[:-1]:
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            if summary is None or summary.statistics is None:
                continue  # not complete yet
            counts = summary.statistics.channel_message_counts
            self.frames += sum(
                counts.get(channel.id, 0)
                for channel in summary.channels.values()
                if channel.topic.endswith("/frame")
            )
            self.files += 1
            self.bytes += path.stat().st_size
            path.unlink()


def wait_for(lanes: Sequence[Lane]) -> None:
    """Wait for the sinks, because frames come faster than in real time."""
    while any(lane.waiting > QUEUE_MAX // 4 for lane in lanes):
        time.sleep(0.002)


def log_taken(hub: Hub, probe: str) -> int:
    """Records of a probe that the log has taken."""
    return sum(hub.taken(probe, "log").values())


def soak(
    hours: float, probes: int, seed: int, folder: Path, keep_mb: int = 0
) -> dict[str, Any]:
    """Run this many hours of probes."""
    lines = [Line(number, seed) for number in range(probes)]
    counting = Counting()
    retention = Retention(bytes=keep_mb * 10**6)
    log = LogSink(folder, Settings(rotate_bytes=LOG_BYTES, retention=retention))
    hub, pruned = Hub(), Pruned(folder)
    lanes = [hub.add(counting), hub.add(log)]
    turns = max(1, round(hours * 3600 * RATE_HZ / CHUNK))
    points: list[dict[str, float]] = []
    progress = Progress("soak", turns)
    try:
        for turn in range(turns):
            now_us = (turn + 1) * CHUNK * PERIOD_US
            for line in lines:
                for record in line.turn(now_us):
                    hub.put(record)
            wait_for(lanes)
            if turn % 500 == 499 and not keep_mb:
                pruned.prune()
            if (turn + 1) * RSS_POINTS // turns > len(points):
                size = sum(path.stat().st_size for path in folder.iterdir())
                at = {"hours": now_us / 3.6e9, "rss_mib": rss_mib()}
                points.append(at | {"folder_mb": size / 1e6})
            progress.update(turn + 1)
    finally:
        progress.end()
        hub.close()
    if not keep_mb:
        pruned.prune(is_end=True)
    results = [line.end() for line in lines]
    passed_on = sum(result["passed_on"] for result in results)
    adds_up = {
        "counted": counting.taken.total() == passed_on,
        "logged": passed_on
        == (
            sum(log_taken(hub, line.source.name) for line in lines)
            if keep_mb
            else pruned.frames
        ),
        "dropped": not any(
            sum(hub.dropped(line.source.name).values()) for line in lines
        ),
    }
    return {
        "hours": hours,
        "seed": seed,
        "probes": results,
        "sinks": adds_up,
        "log": {"files": pruned.files, "bytes": pruned.bytes, "frames": pruned.frames},
        "memory": points,
    }


def tables_of(result: dict[str, Any]) -> Iterator[Table]:
    """Each probe's counts beside the true ones; faults, dates, log and memory."""
    names = ("sent", "accounted", "received", "lost", "duplicated", "corrupt", "wrong")
    rows = [
        (each["probe"], *((each | ledger)[name] for name in names))
        for each in result["probes"]
        for ledger in [{k: v for k, v in each["ledger"].items() if k != "sent"}]
    ]
    yield Table("probes", {"probe": "", **dict.fromkeys(names, ",d")}, rows)
    faults: Counter[str] = Counter()
    for each in result["probes"]:
        faults.update(each["faults"])
    sums = {
        "hours of frames": result["hours"],
        **{f"faults: {name}": count for name, count in sorted(faults.items())},
        "messages with a date": sum(each["dated"] for each in result["probes"]),
        "dates outside of their bound": sum(
            each["outside_bound"] for each in result["probes"]
        ),
    }
    if result["log"]["files"]:  # read back, and deleted; a limited log does so itself
        sums["messages in complete log files"] = result["log"]["frames"]
    for key, name in (("rss_mib", "memory, MiB"), ("folder_mb", "folder, MB")):
        values = [point[key] for point in result["memory"]]
        sums |= {f"{name}: least": min(values), f"{name}: most": max(values)}
    yield Table("sums", {"": "", "of all probes": ",.0f"}, [*sums.items()])


def figures_of(result: dict[str, Any]) -> list[Figure]:
    """Every count has to add up."""
    claims = {
        f"{each['probe']}: {name}": is_so
        for each in result["probes"]
        for name, is_so in each["adds_up"].items()
    } | {f"sinks: {name}": is_so for name, is_so in result["sinks"].items()}
    wrong = [name for name, is_so in claims.items() if not is_so]
    detail = ", ".join(wrong)
    return [Figure("counts that do not add up", len(wrong), (0, 0), (0, 0), detail)]


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--hours", type=float, help=f"of frames: {HOURS:g}, limited 1")
    parser.add_argument("--probes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--limited", action="store_true", help=f"the log keeps {KEEP_MB} MB"
    )


def measured(args: argparse.Namespace) -> Report:
    hours = args.hours or (1.0 if args.limited else HOURS)
    keep_mb = KEEP_MB if args.limited else 0
    with tempfile.TemporaryDirectory() as folder:
        result = soak(hours, args.probes, args.seed, Path(folder), keep_mb)
    return Report([*tables_of(result)], figures_of(result), result)


def main(arguments: Sequence[str] | None = None) -> int:
    return harness.run(
        "soak", __doc__, measured, options, variants=["limited"], arguments=arguments
    )


if __name__ == "__main__":
    sys.exit(main())
