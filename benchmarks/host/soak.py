# SPDX-License-Identifier: MIT
"""Hours of frames in minutes, with random faults from a seed. The ledger must agree to
the frame with what was truly sent and truly arrived.

Frames go through decoder, ledger, clock, hub and two sinks: a counter, and the log,
whose complete files are read back and deleted. With --keep-mb the log itself removes
them, as told, and how large its folder is stands beside the memory.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from benchmarks.common.load import rss_mib
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.common.source import PERIOD_US, RATE_HZ
from benchmarks.host.faulty_line import CHUNK, Line
from imud.daemon.hub import Hub
from imud.daemon.lane import QUEUE_MAX, Item, Lane
from imud.log.file import Settings
from imud.log.retention import Retention
from imud.probes.record import Record
from imud.progress import Progress
from imud.sinks.log import LogSink

OUTPUT = RESULTS / "soak.json"
LIMITED = RESULTS / "soak-limited.json"  # with --keep-mb
HOURS = 3.0
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
    """Run this many hours of probes; `ok` in the result: whether everything adds up."""
    lines = [Line(number, seed) for number in range(probes)]
    counting = Counting()
    retention = Retention(bytes=keep_mb * 10**6)
    log = LogSink(folder, Settings(rotate_bytes=LOG_BYTES, retention=retention))
    hub, pruned = Hub(), Pruned(folder)
    lanes = [hub.add(counting), hub.add(log)]
    turns = max(1, round(hours * 3600 * RATE_HZ / CHUNK))
    points: list[dict[str, float]] = []
    progress = Progress("soak", turns)
    begin_s = time.monotonic()
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
    seconds = time.monotonic() - begin_s
    return {
        "hours": hours,
        "seed": seed,
        "seconds": seconds,
        "frames_a_second": sum(result["sent"] for result in results) / seconds,
        "probes": results,
        "sinks": adds_up,
        "log": {"files": pruned.files, "bytes": pruned.bytes, "frames": pruned.frames},
        "memory": points,
        "ok": all(adds_up.values())
        and all(all(result["adds_up"].values()) for result in results),
    }


def tell(result: dict[str, Any]) -> None:
    """Print a table, and whatever does not add up."""
    heads = ("sent", "accounted", "received", "lost", "duplicated", "corrupt", "wrong")
    print(f"{'probe':18}" + "".join(f"{head:>12}" for head in heads))
    for each in result["probes"]:
        row = {**each, **{k: v for k, v in each["ledger"].items() if k != "sent"}}
        print(f"{each['probe']:18}" + "".join(f"{row[head]:12,}" for head in heads))
    faults: Counter[str] = Counter()
    for each in result["probes"]:
        faults.update(each["faults"])
    dated, outside = (
        sum(each[key] for each in result["probes"])
        for key in ("dated", "outside_bound")
    )
    print(f"dated: {dated:,}, {outside:,} of them outside of their bound")
    print("faults: " + ", ".join(f"{n:,} {name}" for name, n in sorted(faults.items())))
    log = result["log"]
    print(
        f"log: {log['files']} files, {log['bytes']:,} bytes, {log['frames']:,} frames"
    )
    rss = ", ".join(f"{point['rss_mib']:.0f}" for point in result["memory"])
    print(f"resident MiB along the way: {rss}")
    folder = ", ".join(f"{point['folder_mb']:.0f}" for point in result["memory"])
    print(f"MB in the folder of the log: {folder}")
    print(f"{result['frames_a_second']:,.0f} frames/s, {result['seconds']:.0f} s")
    for each in result["probes"]:
        for name, is_so in each["adds_up"].items():
            if not is_so:
                print(f"{each['probe']}: {name} does not add up: {each}")
    for name, is_so in result["sinks"].items():
        if not is_so:
            print(f"sinks: {name} does not add up")
    print("all adds up" if result["ok"] else "it does NOT add up")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=HOURS)
    parser.add_argument("--probes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep-mb", type=int, default=0, help="of the log; 0: all")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    output = options.json or (LIMITED if options.keep_mb else OUTPUT)
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        hours, probes = options.hours, options.probes
        result = soak(hours, probes, options.seed, where, options.keep_mb)
    result["keep_mb"] = options.keep_mb
    tell(result)
    write_results(output, result)
    return 0 if result["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
