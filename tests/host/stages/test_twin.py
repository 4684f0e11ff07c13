# SPDX-License-Identifier: MIT
"""The twin follows a probe made of the firmware's C, and tells what differs. A loss
ends it, and is never taken for a difference.
"""

from __future__ import annotations

import functools
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.desk import lib
from core.probe_bench import Memory
from fakes import FakeProbe
from imud import _core
from imud.stages.floats import is_in_floats
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import (
    AskRaw,
    AskRestart,
    TwinDiffers,
    TwinLost,
    TwinStarted,
    TwinState,
    TwinStopped,
)
from twin_bench import (
    BOTH,
    PERIOD_US,
    POSE,
    Life,
    assert_no_difference,
    changed,
    followed,
    losses,
    message_of,
    named,
    run_twin,
    without,
)


def test_it_follows_from_a_boot_that_streams_from_its_first_sample():
    life = followed().live(700)
    twin, outcomes = run_twin(life.contents)
    assert outcomes == [TwinStarted(named(life.contents, "raw")[0])]
    assert (twin.state, twin.compared, twin.differed) == (TwinState.FOLLOWING, 350, 0)


def test_it_follows_all_that_changes_a_pose():
    life = followed().live(620)
    for change in (
        lambda: life.order(lib.COMMAND_TARE, 0),
        lambda: life.order(lib.COMMAND_TARE, 1),
        lambda: life.miss(2),
        lambda: life.live(1, gyr_clipped=True),
        lambda: life.faint(30),
        lambda: life.faint(70),  # longer than the orientation is kept
        lambda: life.order(lib.COMMAND_TARE, 2),
        lambda: life.order(lib.COMMAND_RATE, 0, 200),
        lambda: life.order(lib.COMMAND_RATE, 0, 7),
    ):
        change()
        life.live(150)
    twin, outcomes = run_twin(life.contents)
    assert len(outcomes) == 1
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(named(life.contents, "pose"))
    assert len(named(life.contents, "bus_recovered")) == 2


def test_it_begins_anew_with_each_restart():
    life = followed().live(600).order(lib.COMMAND_TARE)
    life.live(50).order(lib.COMMAND_RESTART).live(50)
    life.order(lib.COMMAND_RESTART, lib.FILTER_FUSE).live(50)
    twin, outcomes = run_twin(life.contents)
    restarts = named(life.contents, "restarted")
    assert [o.sequence for o in outcomes[1:] if isinstance(o, TwinStarted)] == restarts
    assert (twin.state, twin.compared, twin.differed) == (TwinState.FOLLOWING, 375, 0)


def test_it_follows_from_a_restart_while_the_sensor_is_set_up_again():
    life = followed().live(600)
    life.fail()
    life.order(lib.COMMAND_RESTART)
    life.now_us += 60 * PERIOD_US
    life.find_sensor()
    life.live(1, has_gap=True).live(100)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted, TwinStarted]
    assert twin.compared == len(named(life.contents, "pose"))
    assert twin.differed == 0


def test_it_does_not_follow_from_a_restart_whose_samples_are_not_told():
    life = followed().live(600).order(lib.COMMAND_FIELDS, POSE).live(50)
    life.order(lib.COMMAND_RESTART).live(1).order(lib.COMMAND_FIELDS, BOTH)
    twin, _ = run_twin(life.miss(3).live(100).contents)
    assert twin.state is not TwinState.FOLLOWING
    assert twin.differed == 0


@pytest.mark.parametrize("name", ["complementary", "mahony", "madgwick", "dcm_pi"])
def test_it_follows_every_filter(name: str) -> None:
    life = followed().live(20)
    life.order(lib.COMMAND_RESTART, getattr(lib, f"FILTER_{name.upper()}")).live(600)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted, TwinStarted]
    assert (twin.compared, twin.differed) == (310, 0)


def test_it_asks_for_what_it_needs_once_a_stream():
    life = Life().wake().live(600).order(lib.COMMAND_RATE, 1, 50)
    life.order(lib.COMMAND_START).live(9)
    assert run_twin(life.contents)[1] == [AskRaw(200)]
    life.order(lib.COMMAND_RATE, 1, 200).live(9)
    assert run_twin(life.contents)[1] == [AskRaw(200)]
    life.order(lib.COMMAND_FIELDS, BOTH).live(9)
    assert run_twin(life.contents)[1] == [AskRaw(200), AskRestart()]
    life.order(lib.COMMAND_STOP).live(50).order(lib.COMMAND_START).live(9)
    assert run_twin(life.contents)[1] == [AskRaw(200), AskRestart(), AskRestart()]
    twin, outcomes = run_twin(life.order(lib.COMMAND_RESTART).live(40).contents)
    assert isinstance(outcomes[-1], TwinStarted)
    assert (twin.state, twin.compared) == (TwinState.FOLLOWING, 20)


def test_it_asks_for_raw_messages_alone_where_their_rate_is_right():
    life = Life().wake().live(5).order(lib.COMMAND_START).live(5)
    assert run_twin(life.contents)[1] == [AskRaw(None)]


def test_it_waits_while_nothing_streams():
    life = followed().live(100).order(lib.COMMAND_STOP).live(100)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted, TwinStopped]
    assert (twin.state, twin.compared) == (TwinState.WAITING, 50)
    # Also where it misses the event that says so.
    stopped = named(life.contents, "stream_stopped")[0]
    life.order(lib.COMMAND_START).live(120)  # to the next hello, which tells the rates
    twin, outcomes = run_twin(without(life.contents, stopped))
    assert [type(o) for o in outcomes] == [TwinStarted, TwinStopped, AskRestart]


def test_a_restart_that_no_sample_is_told_after_is_not_followed():
    life = followed().live(20).order(lib.COMMAND_STOP).live(20)
    life.order(lib.COMMAND_RESTART).live(20).order(lib.COMMAND_START).live(20)
    twin, outcomes = run_twin(life.contents)
    assert [type(o) for o in outcomes[2:]] == [TwinStarted, TwinStopped, AskRestart]
    assert (twin.state, twin.compared) == (TwinState.WAITING, 10)


def test_another_boot_is_followed_from_its_own_beginning():
    life = followed().live(700)  # so long that it has saved its settings
    again = Life(life.memory).order(lib.COMMAND_START).wake().live(300)
    twin, outcomes = run_twin(life.contents + again.contents)
    assert [type(outcome) for outcome in outcomes] == [
        TwinStarted,
        TwinStopped,
        TwinStarted,
    ]
    assert (twin.state, twin.compared) == (TwinState.FOLLOWING, 500)
    # Where its first hello is lost it isn't known whether a sample went by.
    twin, outcomes = run_twin(life.contents + again.contents[1:])
    assert twin.state is TwinState.WAITING
    assert isinstance(outcomes[-1], AskRestart)


def test_a_probe_that_is_there_again_is_met_anew():
    life = followed().live(300)
    twin, _ = run_twin(life.contents)
    twin.on_probe_found()
    assert twin.state is TwinState.WAITING
    begun = len(life.contents)
    later = life.live(300).contents[begun:]
    asked = [
        twin.on_message(message, b, b"") for b in later if (message := message_of(b))
    ]
    assert asked.count(AskRestart()) == 1


def test_numbers_go_on_past_their_end():
    life = followed()
    life.wire.sequence = 2**32 - 100
    life.live(20).order(lib.COMMAND_HELLO).order(lib.COMMAND_RESTART).live(600)
    twin, outcomes = run_twin(life.contents[1:])
    wrapped = [message_of(content).sequence for content in life.contents]
    assert 0 in wrapped
    assert isinstance(outcomes[-1], TwinStarted)
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared > 250


@pytest.mark.parametrize("which", [0, 1, 77, -1])
def test_a_flipped_bit_is_told_with_its_number(which: int) -> None:
    contents = followed().live(300).contents
    at = named(contents, "pose")[which]
    pose = bytearray(contents[at])
    pose[10] ^= 1  # the last bit of w
    twin, outcomes = run_twin([*contents[:at], bytes(pose), *contents[at + 1 :]])
    (differs,) = outcomes[1:]
    assert isinstance(differs, TwinDiffers)
    assert differs.sequence == message_of(contents[at]).sequence
    assert (differs.fields, differs.is_first) == (("q",), True)
    assert (differs.probe, differs.twin) == (bytes(pose), contents[at])
    assert (twin.state, twin.compared, twin.differed) == (TwinState.DIFFERS, 150, 1)


def test_the_first_difference_is_told_apart_from_those_that_follow():
    life = followed().live(100)
    contents = life.contents
    poses = named(contents, "pose")
    for at in poses[30:]:
        contents[at] = changed(contents[at], tilt_sigma=77.0)
    twin, outcomes = run_twin(contents)
    told = [outcome for outcome in outcomes if isinstance(outcome, TwinDiffers)]
    assert [outcome.is_first for outcome in told] == [True] + [False] * 19
    assert {outcome.fields for outcome in told} == {("tilt_sigma",)}
    assert (twin.compared, twin.differed) == (50, 20)
    # After a restart the next one is a first one again.
    sent = len(life.order(lib.COMMAND_RESTART).live(20).contents)
    last = named(contents, "pose")[-1]
    assert sent > last
    contents[last] = changed(contents[last], tilt_sigma=77.0)
    twin, outcomes = run_twin(contents)
    assert isinstance(outcomes[-1], TwinDiffers)
    assert outcomes[-1].is_first


def test_a_sample_that_was_not_the_one_fused_is_told():
    contents = followed().live(300).contents
    at = named(contents, "raw")[100]
    raw = message_of(contents[at])
    x, y, z = raw.fields["gyr"]  # type: ignore[misc] # three counts
    contents[at] = changed(contents[at], gyr=(x + 40, y, z))
    _, outcomes = run_twin(contents)
    told = [outcome for outcome in outcomes if isinstance(outcome, TwinDiffers)]
    after = next(pose for pose in named(contents, "pose") if pose > at)
    assert told[0].sequence == message_of(contents[after]).sequence
    assert len(told) > 50


@pytest.mark.parametrize("flag", ["clipped", "gap"])
def test_a_flag_too_many_or_too_few_is_told(flag: str) -> None:
    life = followed().live(101)
    if flag == "gap":
        life.miss(1)
    else:
        life.live(1, acc_clipped=True)
    contents = life.live(11).contents
    poses = named(contents, "pose")
    (at,) = (p for p in poses if flag in str(message_of(contents[p]).fields))
    for struck, flags in ((at, ()), (poses[-1], (flag,))):
        before = message_of(contents[struck]).fields["pose_flags"]
        assert isinstance(before, tuple)
        kept = tuple(each for each in before if each not in ("clipped", "gap"))
        wrong = changed(contents[struck], pose_flags=(*kept, *flags))
        _, outcomes = run_twin([*contents[:struck], wrong, *contents[struck + 1 :]])
        (differs,) = outcomes[1:]
        assert isinstance(differs, TwinDiffers)
        assert differs.fields == ("pose_flags",)


def test_it_does_not_follow_a_filter_in_floats() -> None:
    plain = {"board": "micropython", "sensor": "lsm9ds0", "filter": "madgwick"}
    plain |= {"who_am_i": (0xD4, 0x49), "self_test": (), "raw_rate": 200}
    fake = FakeProbe(**plain)
    names = ["hello", *["raw", "pose"] * 5, "hello", "pose"]
    twin, outcomes = run_twin([fake.content(name) for name in names])
    (outcome,) = outcomes
    assert isinstance(outcome, TwinLost)
    assert "floats" in outcome.reason
    assert (twin.state, twin.compared) == (TwinState.LOST, 0)
    for module in ({"self_test": ("acc_passed",)}, {"who_am_i": (0, 0)}):
        content = FakeProbe(**plain | module).content("hello")
        assert not is_in_floats(message_of(content))


# Losses.


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


known_life = functools.cache(a_life)


@given(st.data())
def test_no_loss_is_a_difference(data: st.DataObject) -> None:
    contents = known_life(data.draw(st.integers(0, 19)))
    kept = data.draw(losses(len(contents)))
    assert_no_difference(itertools.compress(contents, kept))
