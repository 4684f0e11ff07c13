# SPDX-License-Identifier: MIT
"""The cost of dating a message: bytes of a probe's clock, and microseconds for each
message, along a million of them.
"""

from __future__ import annotations

import argparse
import gc
import random
import sys
import time
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.paths import RESULTS, write_results
from imud.probes.clock import ProbeClock
from imud.probes.timeline import Timeline

OUTPUT = RESULTS / "clocks.json"

POSE_US = 10_000
LATE_NS = 16_000_000  # the longest delay of a message or a command
PPM = 200
POINTS = 10  # rows of the table


class Desk:
    """A probe that sends poses and answers a request for its time once a second."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - lateness, no secret
        self._timeline = Timeline()
        self._clock = ProbeClock()
        self.outside = 0  # messages whose error was larger than the stated bound
        self._number = 0

    def go(self, count: int) -> float:
        """Date `count` messages; return the seconds of CPU for each."""
        cases = [self._case() for _ in range(count)]
        clock, timeline = self._clock, self._timeline
        begin = time.process_time()
        for device_us, true_ns, came_ns, asked_ns in cases:
            unrolled = clock.unroll(device_us & 0xFFFFFFFF, came_ns)
            clock.arrived(unrolled, came_ns)
            if asked_ns is not None:
                clock.heard(unrolled, asked_ns)
            timeline.follow(came_ns, came_ns, came_ns)
            moment = clock.moment(unrolled)
            t_ns, bound_ns = timeline.utc(moment.host_ns), moment.bound_ns
            if bound_ns is not None:
                bound_ns += timeline.doubt(moment.host_ns, bound_ns, t_ns)
                self.outside += abs(t_ns - true_ns) > bound_ns
        return (time.process_time() - begin) / count

    def _case(self) -> tuple[int, int, int, int | None]:
        self._number += 1
        device_us = self._number * POSE_US
        true_ns = 1000 * device_us - device_us * PPM // 1000
        came_ns = true_ns + self._random.randrange(LATE_NS)
        is_answer = self._number % (1_000_000 // POSE_US) == 0
        asked_ns = true_ns - self._random.randrange(LATE_NS) if is_answer else None
        return device_us, true_ns, came_ns, asked_ns


def measure(messages: int, seed: int) -> dict[str, Any]:
    """Measure time, then memory with another clock, because tracing memory is slow."""
    desk, step = Desk(seed), messages // POINTS
    micros = [1e6 * desk.go(step) for _ in range(POINTS)]
    tracemalloc.start()
    gc.collect()
    before, kept = tracemalloc.get_traced_memory()[0], []
    traced = Desk(seed)
    for _ in range(POINTS):
        traced.go(step)
        gc.collect()
        kept.append(tracemalloc.get_traced_memory()[0] - before)
    tracemalloc.stop()
    return {
        "messages": messages,
        "microseconds": micros,
        "bytes": kept,
        "outside": desk.outside,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, default=OUTPUT)
    options = parser.parse_args(arguments)
    result = measure(options.messages, options.seed)
    print(f"{'messages':>10}{'us each':>10}{'bytes':>10}")
    rows = zip(result["microseconds"], result["bytes"], strict=True)
    for row, (micros, kept) in enumerate(rows, 1):
        print(f"{row * options.messages // POINTS:10,}{micros:10.1f}{kept:10,}")
    print(f"{result['outside']} outside of their bound")
    write_results(options.json, result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
