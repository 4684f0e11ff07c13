# SPDX-License-Identifier: MIT
"""The host's benchmarks measure what they say: a short soak adds up, and would tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.host import attacks, daemon, faulty_line, soak
from benchmarks.host.live import latency
from length import choose


@pytest.fixture
def harsh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hours of faults in minutes of frames."""
    often = {"flip": 8, "cut": 15, "double": 15, "reset": 100, "unplug": 80}
    monkeypatch.setattr(faulty_line, "FAULTS", often)


@pytest.mark.nightly
@pytest.mark.long
@pytest.mark.usefixtures("harsh")
@pytest.mark.parametrize("seed", range(choose(everyday=1, long=3)))
def test_minutes_of_faults_add_up_to_the_frame(seed: int, tmp_path: Path) -> None:
    result = soak.soak(0.03, 2, seed, tmp_path)
    for each in result["probes"]:
        assert all(each["adds_up"].values()), each
        assert each["faults"].keys() == faulty_line.FAULTS.keys()
        assert each["ledger"]["lost"] > 0
    (figure,) = soak.figures_of(result)
    assert figure.verdict == "goal", figure.detail
    assert all(table.text() for table in soak.tables_of(result))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("harsh")
def test_a_soak_tells_of_a_frame_that_is_not_accounted_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hurt = faulty_line.Line._hurt

    def swallow(line: Any, data: bytes, frames: Any, fault: str) -> bytes:
        hurt_data = hurt(line, data, frames, fault)
        line.truth.whole += 1
        return hurt_data

    monkeypatch.setattr(faulty_line.Line, "_hurt", swallow)
    result = soak.soak(0.001, 1, 1, tmp_path)
    (figure,) = soak.figures_of(result)
    assert figure.verdict == "MISSED"
    assert f"{result['probes'][0]['probe']}: heard" in figure.detail


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
