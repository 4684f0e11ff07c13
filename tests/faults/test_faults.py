# SPDX-License-Identifier: MIT
"""Faults drawn by a seed, on a virtual clock: after each of them every account adds up,
each age is right within its bound, and the newest logs are there.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from faults.faults import draw
from faults.world import FAST_HZ, SLOW_HZ, Console, World
from imud.log.retention import DAY_S, KeptLogs, Retention
from imud.machine import system
from imud.probes import clock
from imud.probes.clock import Moment, ProbeClock
from imud.sinks import zenoh
from length import IS_LONG, choose

SEED = os.environ.get("IMU_FAULTS")
SEEDS = [int(SEED)] if SEED else range(choose(everyday=2, long=64))
FAULTS = choose(everyday=4, long=8)
OLD = choose(everyday=1, long=10)  # seeds in which each old fault is found
TRIED = 60  # seeds

Plant = Callable[[pytest.MonkeyPatch], None]


def went_wrong(
    seed: int, folder: Path, patch: pytest.MonkeyPatch, plant: Plant | None = None
) -> list[str]:
    """In the world of that seed: the faults that were drawn, and what they did."""
    world = World(seed, folder, FAST_HZ if IS_LONG or SEED else SLOW_HZ)
    world.at(3 * 10**9, lambda: draw(world, FAULTS))
    with patch.context() as patched:
        if plant is not None:
            plant(patched)
        world.run(patched)
    return [*world.drawn, *world.failures] if world.failures else []


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_all_is_well_after_each_fault(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = went_wrong(seed, tmp_path, monkeypatch)
    again = f"IMU_LONG={int(IS_LONG)} IMU_FAULTS={seed} python -m pytest tests/faults"
    assert not wrong, "\n".join((again, *wrong))


def a_clock_that_sleeps(patch: pytest.MonkeyPatch) -> None:
    """It stands still in suspend, and what is late comes right by 0.1 s a second."""

    def standing(_: object) -> int:
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)

    def follow(self: Any, estimate: Any) -> None:
        self._estimate = estimate
        self._rising.turn(estimate.at_ns, estimate.middle_ns, estimate.rate)

    def date(self: ProbeClock, device_us: int, host_ns: int) -> Moment:
        self.arrived(device_us, host_ns)
        return self.moment(device_us)

    patch.setattr(type(system.host_clock_ns), "__call__", standing)
    patch.setattr(clock, "JUMP_NS", 1 << 62)
    patch.setattr(ProbeClock, "_follow", follow)
    patch.setattr(ProbeClock, "date", date)


def a_journal_that_waits(patch: pytest.MonkeyPatch) -> None:
    def write(console: Console, text: str) -> int:
        if not console.is_read.is_set():
            console.world.now_ns += 10**9  # and so on
        return len(text)

    patch.setattr(Console, "write", write)


def a_retention_by_the_clock(patch: pytest.MonkeyPatch) -> None:
    def sweep(self: Retention, folder: Path, **_: object) -> KeptLogs:
        found = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime)
        total = sum(path.stat().st_size for path in found)
        for path in found[:-1]:
            is_old = time.time() - path.stat().st_mtime > self.days * DAY_S
            if not is_old and total <= self.bytes:
                break
            total -= path.stat().st_size
            path.unlink()
        return KeptLogs()

    patch.setattr(Retention, "sweep", sweep)


def keys_of_names_alone(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(zenoh, "addresses", lambda name, _: [name])


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("plant", "sign"),
    [
        (a_clock_that_sleeps, "age"),
        (a_journal_that_waits, "the loop was kept"),
        (a_retention_by_the_clock, "was removed"),
        (keys_of_names_alone, "subscribed to its id"),
    ],
)
def test_each_old_fault_is_found(
    plant: Plant, sign: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = 0
    for seed in range(TRIED):
        if found < OLD:
            wrong = went_wrong(seed, tmp_path / str(seed), monkeypatch, plant)
            found += any(sign in line for line in wrong)
    assert found >= OLD
