# SPDX-License-Identifier: MIT
"""Data-ready without a wire, against a sensor whose edges are known: what is asked, and
how the times that are told differ from the true ones."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import numpy as np
import pytest

import native

ffi, lib = native.load()

RATE_HZ = 200
QUESTION_US = (100.0, 112.0)  # on a bus of 400 kHz, with what the driver adds
READ_US = 600.0
START_US = 2**32 - 3_000_000  # the device time wraps within the run


@dataclass
class Sensor:
    """Raises data-ready evenly; a reading takes it down again."""

    period_us: float
    next_us: float = START_US + 1234.5
    newest_us: float = 0.0
    is_ready: bool = False

    def come_to(self, time_us: float) -> None:
        while self.next_us <= time_us:
            self.newest_us = self.next_us
            self.is_ready = True
            self.next_us += self.period_us


@dataclass
class Found:
    errors_us: list[float] = field(default_factory=list)
    bounds_us: list[int] = field(default_factory=list)
    missed: int = 0
    unknown: int = 0
    edges: int = 0
    true_edges: int = 0


def followed(
    seconds: float,
    ppm: float = 0.0,
    pause_us: float = 0.0,
    pauses: float = 0.0,
    seed: int = 1,
) -> Found:
    """A main loop that asks when it is told to, with other work between. `pauses`: the
    share of its turns that take up to `pause_us` more.
    """
    draw = random.Random(seed)  # noqa: S311, a simulation
    sensor = Sensor(1e6 / RATE_HZ / (1.0 + ppm * 1e-6))
    polled = ffi.new("struct polled *")
    lib.polled_begin(polled, RATE_HZ)
    edge, missed = ffi.new("uint32_t *"), ffi.new("uint16_t *")
    found = Found()
    now_us = float(START_US)
    first_us = sensor.next_us
    while now_us < START_US + seconds * 1e6:
        wait_us = lib.polled_wait_us(polled, wire(now_us))
        if wait_us > 0:
            now_us += min(wait_us, draw.uniform(20.0, 1000.0))
            continue
        begun_us = now_us
        now_us += draw.uniform(*QUESTION_US)
        answered_us = begun_us + 0.75 * (now_us - begun_us)
        sensor.come_to(answered_us)
        if not sensor.is_ready:
            lib.polled_no(polled, wire(answered_us))
        else:
            sensor.is_ready = False
            is_timed = lib.polled_yes(polled, wire(answered_us), edge, missed)
            sensor.come_to(now_us)  # the burst begins, and takes what is there
            newest_us, sensor.is_ready = sensor.newest_us, False
            now_us += READ_US
            if is_timed:
                error = (edge[0] - wire(newest_us) + 2**31) % 2**32 - 2**31
                found.errors_us.append(error)
                found.bounds_us.append(lib.polled_bound_us(polled))
                found.missed += missed[0]
            else:
                found.unknown += 1
            now_us += draw.uniform(200.0, 450.0)
        if draw.random() < pauses:
            now_us += draw.uniform(0.0, pause_us)
    found.edges = polled.edges
    found.true_edges = int((now_us - first_us) / sensor.period_us) + 1
    return found


def wire(time_us: float) -> int:
    return round(time_us) % 2**32


# A sensor's own oscillator: 1 % of an MPU-9250, ten of others.
@pytest.mark.parametrize("ppm", [0, 300, -300, 10_000, -10_000, 100_000, -100_000])
def test_times_are_within_their_bound_whatever_the_sensors_clock(ppm: float) -> None:
    found = followed(40.0, ppm)
    errors = np.abs(found.errors_us[40:])
    assert found.missed == 0
    assert found.edges == pytest.approx(found.true_edges, abs=2)
    assert np.percentile(errors, 99) < 30
    assert np.mean(errors > np.array(found.bounds_us[40:]) + 1) < 0.005
    assert np.median(found.bounds_us[40:]) < 40


def test_the_first_times_are_within_a_question_of_the_truth() -> None:
    found = followed(0.3)
    assert np.max(np.abs(found.errors_us)) < 130


@pytest.mark.parametrize("seed", range(5))
def test_what_is_missed_while_the_loop_is_busy_is_counted(seed: int) -> None:
    found = followed(30.0, 500, pause_us=40_000, pauses=0.001, seed=seed)
    told = len(found.errors_us)
    assert found.missed > 20
    # Each edge was told, counted as missed, or came at the very end.
    assert told + found.missed == pytest.approx(found.true_edges, abs=12)
    assert found.edges == pytest.approx(found.true_edges, abs=12)
    assert np.percentile(np.abs(found.errors_us[40:]), 99) < 60


def test_it_asks_little_once_it_knows_the_period() -> None:
    polled = ffi.new("struct polled *")
    lib.polled_begin(polled, RATE_HZ)
    assert lib.polled_wait_us(polled, 5) == 0
    edge, missed = ffi.new("uint32_t *"), ffi.new("uint16_t *")
    for n in range(40):
        lib.polled_no(polled, 5000 * n + 4950)
        assert lib.polled_yes(polled, 5000 * n + 5050, edge, missed)
    wait_us = lib.polled_wait_us(polled, 5000 * 40 + 100)
    assert 4500 < wait_us < 4900


def test_without_a_no_before_it_the_first_edge_has_no_time() -> None:
    polled = ffi.new("struct polled *")
    lib.polled_begin(polled, RATE_HZ)
    edge, missed = ffi.new("uint32_t *"), ffi.new("uint16_t *")
    assert not lib.polled_yes(polled, 1000, edge, missed)
    lib.polled_no(polled, 5900)
    assert lib.polled_yes(polled, 6000, edge, missed)
    assert (edge[0], missed[0]) == (5950, 1)
    assert polled.edges == 2
