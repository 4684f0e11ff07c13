# SPDX-License-Identifier: MIT
"""The benchmarks of the daemon: latency, and what they judge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.host import attacks, daemon
from benchmarks.host.live import latency


def test_latency_is_of_the_same_pose_at_both_ends() -> None:
    second = 10**9
    sent = np.array([[p, n, n * second] for n in range(1, 6) for p in (0, 1)])
    heard = sent + np.array([0, 0, 250_000])
    found = latency(sent, heard[:-1])
    assert (found["median_us"], found["worst_us"]) == (250.0, 250.0)
    assert (found["poses_sent"], found["lost"]) == (10, 1)


RUN = {
    "probes": 8,
    "is_relay": False,
    "lost": 0,
    "dropped": 0,
    "overrun": 0,
    "median_us": 301.0,
    "p99_us": 1000.0,
}


def test_a_lost_pose_of_eight_probes_is_missed_and_a_late_one_is_not() -> None:
    met = [each.verdict for each in daemon.figures_of([RUN])]
    assert met == ["goal", "must", "goal"]
    lost = RUN | {"lost": 2, "dropped": 3, "overrun": 1}
    missed, *_ = daemon.figures_of([lost])
    assert (missed.value, missed.verdict) == (6, "MISSED")


ALONE = {"lost": 0, "p99_us": 1000.0}


@pytest.mark.parametrize(
    ("attacked", "verdicts"),
    [
        ({"lost": 0, "p99_us": 2000.0}, ["goal", "goal"]),
        ({"lost": 1, "p99_us": 2001.0}, ["MISSED", "MISSED"]),
    ],
)
def test_an_attack_that_costs_others_is_judged(
    attacked: dict[str, Any], verdicts: list[str]
) -> None:
    runs = {attacks.ALONE: ALONE, "of three addresses": attacked}
    assert [each.verdict for each in attacks.figures_of(runs)] == verdicts
