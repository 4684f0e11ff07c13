# SPDX-License-Identifier: MIT
"""The host's benchmarks measure what they say: a short soak adds up, and would tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.common.source import Source
from benchmarks.host import daemon, faulty_line, soak
from benchmarks.host.decoding import PlainDecoder
from benchmarks.host.live import latency
from imud.wire.frame import FrameDecoder
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
    assert all(result["sinks"].values()), result["sinks"]
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
    assert not result["ok"]
    assert not result["probes"][0]["adds_up"]["heard"]


def test_the_decoder_in_python_does_what_the_c_does() -> None:
    source = Source(3)
    data = b"".join(source.say(i * 5000) for i in range(300))
    data = data[:1000] + b"\x07" + data[1000:4000] + data[4050:]
    assert PlainDecoder().feed(data) == FrameDecoder().feed(data)


def test_latency_is_of_the_same_pose_at_both_ends() -> None:
    second = 10**9
    sent = np.array([[p, n, n * second] for n in range(1, 6) for p in (0, 1)])
    heard = sent + np.array([0, 0, 250_000])
    found = latency(sent, heard[:-1])
    assert (found["median_us"], found["worst_us"]) == (250.0, 250.0)
    assert (found["poses_sent"], found["poses_heard"]) == (10, 9)


def test_a_straight_cost_is_told_from_a_bent_one() -> None:
    straight = [{"probes": n, "cpu_core": 0.02 + 0.01 * n} for n in (1, 8, 64)]
    bent = [{"probes": n, "cpu_core": 0.0002 * n * n} for n in (1, 8, 64)]
    assert daemon.straightness(straight)["worst_miss_core"] < 1e-9
    assert daemon.straightness(bent)["worst_miss_core"] > 0.02
