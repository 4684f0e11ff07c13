# SPDX-License-Identifier: MIT
"""The slowest sample at a command: what is sent, and what is told of its profile."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from benchmarks.common.boards import NANO
from benchmarks.firmware import commanded
from benchmarks.firmware.budget import LIMITS

PERIOD_US = 5000


def tally(own: int, inclusive: int) -> dict[str, Any]:
    return {"self": {"in_worst": own}, "inclusive": {"in_worst": inclusive}}


PROFILE = {
    "total": {"worst": 100},
    "parts": {"a": {"in_worst": 30}, "b": {"in_worst": 70}},
    "functions": {
        "main": tally(5, 100),
        "restart": tally(35, 95),
        "multiply": tally(60, 60),
        "elsewhere": tally(0, 0),
    },
}


def test_restarts_come_at_every_phase_of_a_sample_and_of_a_second() -> None:
    times = [at_us for at_us, *_ in commanded.restarts(PERIOD_US)]
    assert len(times) == 60
    phases = sorted(at_us % PERIOD_US for at_us in times)
    steps = [b - a for a, b in itertools.pairwise([*phases, phases[0] + PERIOD_US])]
    assert max(steps) <= PERIOD_US / 50
    tenths = {at_us % 1_000_000 // 100_000 for at_us in times}
    assert tenths == set(range(10))


def test_all_commands_are_as_many_as_the_emulator_takes() -> None:
    for commands, _ in commanded.KINDS.values():
        assert len(list(commands(PERIOD_US))) + 3 <= 64


def test_params_change_each_time_and_at_several_phases() -> None:
    orders = list(commanded.changes(PERIOD_US))
    applied = [order for order in orders if order[1] == "params_apply"]
    digests = [digest for *_, (_, digest) in applied]
    assert len(digests) == 8
    assert all(a != b for a, b in itertools.pairwise(digests))
    assert len({at_us % PERIOD_US for at_us, *_ in applied}) == 8


def test_functions_of_the_slowest_sample_come_by_their_own_cycles() -> None:
    found = commanded.slowest(PROFILE, "restarts", 60)
    names = [(function.name, function.own) for function in found.functions]
    assert names == [("multiply", 60), ("restart", 35), ("main", 5)]
    assert list(found.parts.items()) == [("b", 70), ("a", 30)]
    assert sum(found.parts.values()) == found.cycles


@pytest.mark.parametrize(("more", "is_kept"), [(0, True), (1, False)])
def test_a_command_has_the_limit_of_every_sample(more: int, is_kept: bool) -> None:
    cycles = LIMITS["nano"].cycles + more
    found = commanded.Commanded("restarts", 60, cycles, {}, [])
    assert found.line(NANO).is_kept is is_kept


def test_a_function_that_calls_the_slow_one_is_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    commanded.show([commanded.slowest(PROFILE, "restarts", 60)])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["main", "5", "100"] in lines
    assert ["multiply", "60", "60"] in lines
