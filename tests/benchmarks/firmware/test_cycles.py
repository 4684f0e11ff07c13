# SPDX-License-Identifier: MIT
"""The cycles of an image: limits, and commands at every phase of a sample."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace as Made
from typing import Any

import numpy as np
import pytest

from benchmarks.common.boards import F405, NANO, Board
from benchmarks.common.images import RunFailed
from benchmarks.firmware import commanded, cycles

PERIOD_US = 5000


def profile() -> dict[str, Any]:
    return {
        "functions": {
            name: {"self": {"in_worst": own}, "inclusive": {"in_worst": inclusive}}
            for name, own, inclusive in (
                ("main", 5, 130),
                ("restart", 35, 125),
                ("multiply", 90, 90),
                ("elsewhere", 0, 0),
            )
        },
    }


def test_the_slowest_sample_is_shown_with_who_calls_the_slow_ones() -> None:
    rows = cycles.slowest_of("restarts", profile()).rows
    assert rows == [("main", 5, 130), ("restart", 35, 125), ("multiply", 90, 90)]


SUMMARY = {
    "cycles_worst": 72_000,
    "cycles_mean": 50_000.0,
    "idle": 0.3,
    "late": 0,
    "samples": 100,
    "bytes": 20_000,
    "flash": 30_720,
    "ram": 1_352,
    "stack_max": 440,
}


def too_much(summary: dict[str, Any], lost: int = 0, board: Board = NANO) -> list[str]:
    """The figures above their limits."""
    feed = Made(times_s=np.arange(100) / 200.0)
    run: Any = Made(
        summary=summary,
        lost=lost,
        log_dropped=0,
        pose_times_s=feed.times_s,
        feed=feed,
    )
    lines = cycles.lines_of(board, run, {"60 restarts": summary["cycles_worst"]})
    return [
        each.name
        for each in lines
        if each.limit is not None and each.value > each.limit
    ]


@pytest.mark.parametrize(
    ("name", "missed"),
    [
        ("cycles_worst", ["cycles a sample, worst", "the same, with 60 restarts"]),
        ("flash", ["flash, bytes"]),
        ("ram", ["RAM: both, bytes"]),
        ("stack_max", ["RAM: both, bytes"]),
        ("late", ["samples late"]),
    ],
)
def test_one_more_than_a_limit_is_too_much(name: str, missed: list[str]) -> None:
    assert too_much(SUMMARY) == []
    assert too_much(SUMMARY | {name: SUMMARY[name] + 1}) == missed


def test_a_lost_message_is_too_much() -> None:
    assert too_much(SUMMARY, lost=1) == ["samples or messages lost"]


def test_each_board_has_limits_of_its_own() -> None:
    more = SUMMARY | {"cycles_worst": 72_001, "flash": 40_000, "ram": 90_000}
    assert len(too_much(more)) == 5
    assert too_much(more, board=F405) == []
    stack = SUMMARY | {"stack_max": 8193}
    assert too_much(stack, board=F405) == ["RAM: deepest stack, bytes"]


@pytest.mark.nightly
@pytest.mark.usefixtures("nano")
def test_an_image_is_measured(image: Path, tmp_path: Path) -> None:
    output = tmp_path / "cycles.json"
    words = ["--seconds", "6", "--image", str(image), "--output", str(output)]
    assert cycles.main(arguments=words) == 0
    assert '"cycles a sample, mean"' in output.read_text("utf-8")


def test_restarts_come_at_every_phase_of_a_sample_and_of_a_second() -> None:
    times = [at_us for at_us, *_ in commanded.restarts(PERIOD_US)]
    assert len(times) == 60
    phases = sorted(at_us % PERIOD_US for at_us in times)
    steps = [b - a for a, b in itertools.pairwise([*phases, phases[0] + PERIOD_US])]
    assert max(steps) <= PERIOD_US / 50
    tenths = {at_us % 1_000_000 // 100_000 for at_us in times}
    assert tenths == set(range(10))


def test_all_commands_are_as_many_as_the_emulator_takes() -> None:
    for kind in commanded.KINDS.values():
        assert len(list(kind.commands(PERIOD_US))) + 3 <= 64


def test_params_change_each_time_and_at_several_phases() -> None:
    orders = list(commanded.changes(PERIOD_US))
    applied = [order for order in orders if order[1] == "params_apply"]
    digests = [digest for *_, (_, digest) in applied]
    assert len(digests) == 8
    assert all(a != b for a, b in itertools.pairwise(digests))
    assert len({at_us % PERIOD_US for at_us, *_ in applied}) == 8


def test_an_image_that_obeys_no_command_is_told() -> None:
    events = [
        Made(message=Made(name="event", fields={"event": "restarted"}))
        for _ in range(60)
    ]
    run: Any = Made(received=events)
    assert commanded.KINDS["restarts"].obeyed(run) == 60
    with pytest.raises(RunFailed, match="no params_changed"):
        commanded.KINDS["new params"].obeyed(run)
