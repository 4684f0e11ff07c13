# SPDX-License-Identifier: MIT
"""The twin follows a probe made of the firmware's C, and tells what differs."""

from __future__ import annotations

import pytest

from core.desk import lib
from fakes import FakeProbe
from imud.stages.floats import is_in_floats
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
    changed,
    followed,
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
