# SPDX-License-Identifier: MIT
"""A loss ends the twin, and is never taken for a difference."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.desk import lib
from core.probe_bench import Memory
from imud import _core
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import TwinDiffers, TwinLost, TwinStarted, TwinState
from twin_bench import (
    BOTH,
    POSE,
    Life,
    changed,
    followed,
    message_of,
    named,
    run_twin,
    without,
)


def test_a_lost_sample_ends_it_until_the_next_restart():
    life = followed().live(100)
    gone = named(life.contents, "raw")[50]
    number = message_of(life.contents[gone]).sequence
    twin, outcomes = run_twin(without(life.contents, gone))
    assert outcomes[1:] == [TwinLost(number, "a message is missing")] or (
        outcomes[1:] == [TwinLost(number + 1, "its sample is missing")]
    )
    assert twin.state is TwinState.LOST
    twin, outcomes = run_twin(
        without(life.order(lib.COMMAND_RESTART).live(20).contents, gone)
    )
    assert [type(outcome) for outcome in outcomes] == [
        TwinStarted,
        TwinLost,
        TwinStarted,
    ]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)


def test_a_lost_pose_is_all_that_is_missed():
    life = followed().live(100)
    poses = named(life.contents, "pose")
    twin, outcomes = run_twin(without(life.contents, poses[20], poses[30]))
    assert len(outcomes) == 1
    assert (twin.state, twin.compared) == (TwinState.FOLLOWING, 48)


@pytest.mark.parametrize("name", ["hello", "status", "calibration_done"])
def test_what_no_pose_depends_on_may_be_lost(name: str) -> None:
    life = followed().live(700)
    gone = named(life.contents, name)[-1]
    twin, outcomes = run_twin(without(life.contents, gone))
    assert len(outcomes) == 1
    assert (twin.state, twin.compared) == (TwinState.FOLLOWING, 350)


@pytest.mark.parametrize("flag", ["acc_clipped", "has_gap"])
def test_a_lost_pose_takes_its_latched_flags_along(flag: str) -> None:
    life = followed().live(99).live(1, **{flag: True}).live(10)
    at = max(
        pose
        for pose in named(life.contents, "pose")
        if {"clipped", "gap"} & set(str(message_of(life.contents[pose])).split("'"))
    )
    twin, outcomes = run_twin(without(life.contents, at))
    assert len(outcomes) == 1
    assert (twin.state, twin.compared) == (TwinState.FOLLOWING, 54)


class LongerReplay:
    """The replay of a schema in which a field follows the flags of a pose."""

    LATER = bytes((36, 0x00, 0x00))  # its tag and its value

    def __init__(self, hello: bytes, params: bytes) -> None:
        self._replay = _core.Replay(hello, params)

    def params(self, records: bytes) -> bool:
        return self._replay.params(records)

    def restart(self, number: int) -> None:
        self._replay.restart(number)

    def step(self, raw: bytes) -> None:
        self._replay.step(raw)

    def is_by_button(self) -> bool:
        return self._replay.is_by_button()

    def pose(self, sequence: int, time_us: int) -> bytes:
        return self._replay.pose(sequence, time_us) + self.LATER


@pytest.mark.parametrize(
    ("later", "differed"), [(LongerReplay.LATER, 0), (bytes((36, 0x20, 0x00)), 1)]
)
def test_latched_flags_are_found_where_a_field_follows_them(
    later: bytes, differed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    core = SimpleNamespace(Replay=LongerReplay)
    monkeypatch.setattr("imud.stages.twin._core", core)
    life = followed().live(99).live(1, acc_clipped=True).live(10)
    poses = named(life.contents, "pose")
    gone = next(
        at for at in poses if "clipped" in str(message_of(life.contents[at]).fields)
    )
    after = poses[poses.index(gone) + 1]
    twin = Twin()
    for at, content in enumerate(life.contents):
        end = b""
        if at in poses:
            end = later if at == after else LongerReplay.LATER
        if at != gone:
            twin.on_message(message_of(content), content + end, b"")
    assert (twin.compared, twin.differed) == (54, differed)


@pytest.mark.parametrize("command", [lib.COMMAND_TARE, lib.COMMAND_RESTART])
@pytest.mark.parametrize("gone", [(0,), (0, 1)])
def test_a_change_that_is_lost_ends_it(command: int, gone: tuple[int, ...]) -> None:
    life = followed().live(650)
    at = len(life.contents)
    life.order(command).live(100)
    twin, outcomes = run_twin(without(life.contents, *(at + n for n in gone)))
    assert outcomes[1:] == [
        TwinLost(message_of(life.contents[at]).sequence, "a message is missing")
    ]
    assert twin.state is TwinState.LOST


@pytest.mark.parametrize(
    ("command", "arguments"),
    [(lib.COMMAND_RATE, (1, 199)), (lib.COMMAND_FIELDS, (POSE, 0))],
)
def test_it_ends_where_not_every_sample_is_told_any_more(
    command: int, arguments: tuple[int, int]
) -> None:
    life = followed().live(50).order(command, *arguments)
    _, outcomes = run_twin(life.contents)
    number = message_of(life.contents[-1]).sequence
    assert outcomes[1:] == [TwinLost(number, "it no longer sends every sample")]


def test_a_gap_is_not_believed_where_a_message_is_missing():
    life = followed().live(50)
    gone = named(life.contents, "pose")[-1]
    life.live(10).miss(1)
    _, outcomes = run_twin(without(life.contents, gone))
    assert isinstance(outcomes[-1], TwinLost)


def test_what_this_imud_cannot_compute_ends_it() -> None:
    life = followed().live(50).order(lib.COMMAND_TARE).order(lib.COMMAND_RESTART)
    contents = life.live(5).contents
    sensor = named(contents, "hello")[-1]
    other = changed(contents[sensor], sensor="none")
    twin, outcomes = run_twin([*contents[:sensor], other, *contents[sensor + 1 : -30]])
    assert [type(outcome) for outcome in outcomes] == [TwinLost]
    for name, detail in (("tared", 3), ("restarted", 99)):
        at = named(contents, name)[0]
        wrong = changed(contents[at], detail=detail)
        twin, outcomes = run_twin([*contents[:at], wrong])
        assert isinstance(outcomes[-1], TwinLost)
        assert "can't compute" in outcomes[-1].reason
        assert twin.state is TwinState.LOST


@pytest.mark.parametrize("kind", [-1, 3, 2**40])
def test_an_origin_of_no_kind_is_refused(kind: int) -> None:
    replay = _core.Replay(followed().contents[-1])
    with pytest.raises(ValueError, match=f"origin {kind} is not one of 0 to 2"):
        replay.origin(kind)


def a_life(seed: int) -> list[bytes]:
    """A few seconds with all that can happen, and a boot in the middle."""
    random = np.random.default_rng(seed)
    memory = Memory()
    contents: list[bytes] = []
    for boot in range(2):
        life = Life(memory)
        if boot or seed % 2:
            life.order(lib.COMMAND_START)
        life.order(lib.COMMAND_FIELDS, BOTH).wake()
        actions = [
            lambda life=life: life.order(lib.COMMAND_TARE, int(random.integers(3))),
            lambda life=life: life.order(lib.COMMAND_RESTART),
            lambda life=life: life.miss(int(random.integers(1, 60))),
            lambda life=life: life.faint(int(random.integers(40, 60))),
            lambda life=life: life.live(1, gyr_clipped=True),
            lambda life=life: life.order(
                lib.COMMAND_FIELDS, int(random.choice([POSE, BOTH, BOTH]))
            ),
            lambda life=life: life.order(
                lib.COMMAND_RATE, 1, int(random.choice([100, 150, 200, 200]))
            ),
            lambda life=life: life.order(lib.COMMAND_STOP),
            lambda life=life: life.order(lib.COMMAND_START),
            lambda life=life: life.order(lib.COMMAND_HELLO),
        ]
        for _ in range(40):
            for action in random.choice(len(actions), random.integers(0, 4)):
                actions[action]()
            life.live(int(random.choice([0, 1, 2, 3, 20])))
        contents += life.contents
    return contents


@functools.cache
def a_known_life(seed: int) -> list[bytes]:
    return a_life(seed)


def assert_no_difference(contents: list[bytes]) -> int:
    twin, outcomes = run_twin(contents)
    assert not any(isinstance(outcome, TwinDiffers) for outcome in outcomes)
    assert twin.differed == 0
    return twin.compared


@given(st.data())
def test_no_loss_is_a_difference(data: st.DataObject) -> None:
    contents = a_known_life(data.draw(st.integers(0, 19)))
    share = data.draw(st.sampled_from([0.002, 0.01, 0.05, 0.3]))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    kept = random.random(len(contents)) >= share
    begun = data.draw(st.integers(0, len(contents)))
    kept[begun : begun + data.draw(st.integers(0, 8))] = False
    assert_no_difference([c for c, k in zip(contents, kept, strict=True) if k])
