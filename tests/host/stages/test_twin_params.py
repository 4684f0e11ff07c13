# SPDX-License-Identifier: MIT
"""The twin of a calibrated probe, of one that kept its own magnetic field, and of one
that feels strokes: equal in every bit, through each change, whatever message is lost.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.desk import ffi, lib
from core.probe_bench import Memory
from core.stroke_desk import measured
from fakes.records import any_records, calibrated_records, record
from imud import _core
from imud.config.settings import Config
from imud.probes.session import Received
from imud.stages import SendCommands
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import (
    AskParams,
    AskRestart,
    TwinLost,
    TwinStarted,
    TwinState,
)
from imud.stages.twin_stage import TwinStage
from imud.virtual.stroking import Plan
from imud.wire.params import digest_of
from stroke_bench import TIP, feel, stroking
from twin_bench import (
    BOTH,
    Life,
    assert_no_difference,
    changed,
    followed,
    losses,
    message_of,
    named,
    received,
    run_twin,
    without,
)

ONE, OTHER = calibrated_records(1), calibrated_records(2)
SETUP_STEPS = 160  # of 5 ms: the self-test of an MPU-9250 takes longer


@functools.cache
def cells_with(records: bytes) -> bytes:
    """The memory of a probe that has these params."""
    memory = Memory()
    Life(memory).wake().load(records).live(20)
    return bytes(memory.cells)


def calibrated(records: bytes = ONE) -> Life:
    """A calibrated probe that streams both from its boot, and told its params while the
    sensor was set up.
    """
    memory = Memory()
    memory.cells[:] = cells_with(records)
    life = Life(memory).order(lib.COMMAND_FIELDS, BOTH)
    life.order(lib.COMMAND_RATE, 1, 200).order(lib.COMMAND_START)
    for _ in range(SETUP_STEPS):
        life.step()
    return life.wake()


def test_a_calibrated_probe_and_its_twin_are_equal_in_every_bit():
    life = calibrated().live(900)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted]
    assert (twin.state, twin.compared, twin.differed) == (TwinState.FOLLOWING, 450, 0)
    # With other params it is another's.
    samples, poses = named(life.contents, "raw"), named(life.contents, "pose")
    assert len(samples) == 900
    plain = followed().live(900)
    assert [life.contents[at] for at in poses] != [
        plain.contents[at] for at in named(plain.contents, "pose")
    ]


@given(seed=st.integers(0, 2**32))
def test_any_params_that_a_probe_takes_are_followed(seed: int) -> None:
    life = calibrated(any_records(seed)).live(60)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted]
    assert (twin.state, twin.compared, twin.differed) == (TwinState.FOLLOWING, 30, 0)


def test_it_follows_every_change_of_params():
    life = calibrated().live(600)
    for records in (OTHER, b"", OTHER + record(5, b"\0\0"), ONE):
        life.load(records).live(100)
    twin, outcomes = run_twin(life.contents)
    # One of the changes leaves the calibration: the filter continues.
    assert len(named(life.contents, "params_changed")) == 4
    restarts = named(life.contents, "restarted")
    assert len(restarts) == 4
    life.load(ONE + record(5, b"\x01\0")).live(100)
    assert len(named(life.contents, "restarted")) == 4
    twin, outcomes = run_twin(life.contents)
    numbers = [message_of(life.contents[at]).sequence for at in restarts]
    assert [type(outcome) for outcome in outcomes] == [TwinStarted] * 5
    assert [o.sequence for o in outcomes[1:] if isinstance(o, TwinStarted)] == numbers
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(named(life.contents, "pose"))


def test_it_asks_for_params_that_it_missed_and_then_for_a_restart():
    life = calibrated().live(50)
    # Heard from here on, when all parts were told already.
    begin = named(life.contents, "hello")[-1] + 1
    gone = [at for at in named(life.contents, "params") if at >= begin]
    life.order(lib.COMMAND_HELLO).live(20)
    contents = [
        c for at, c in enumerate(life.contents) if at >= begin and at not in gone
    ]
    twin, outcomes = run_twin(contents)
    assert outcomes == [AskParams()]
    assert twin.state is TwinState.WAITING
    before = len(life.contents)
    life.order(lib.COMMAND_PARAMS_TELL).live(30)
    contents += life.contents[before:]
    assert run_twin(contents)[1] == [AskParams(), AskRestart()]
    before = len(life.contents)
    life.order(lib.COMMAND_RESTART).live(100)
    contents += life.contents[before:]
    twin, outcomes = run_twin(contents)
    assert [type(each) for each in outcomes] == [AskParams, AskRestart, TwinStarted]
    assert (twin.state, twin.compared, twin.differed) == (TwinState.FOLLOWING, 50, 0)


def test_a_restart_with_params_that_it_does_not_know_is_asked_for_again():
    life = calibrated().live(50)
    begin = len(life.contents)
    life.load(OTHER).live(20)
    # Of the five parts that are told while they are staged, one that is not told again.
    missed = [at for at in named(life.contents, "params") if at >= begin][2]
    twin, outcomes = run_twin(without(life.contents, missed))
    asked = [type(each) for each in outcomes]
    assert asked == [TwinStarted, AskParams]
    assert twin.state is TwinState.WAITING
    life.order(lib.COMMAND_PARAMS_TELL).live(20).order(lib.COMMAND_RESTART).live(60)
    twin, outcomes = run_twin(without(life.contents, missed))
    assert [type(each) for each in outcomes] == [*asked, AskRestart, TwinStarted]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)


# Which of the three messages of a change are lost, and what the twin makes of it.
@pytest.mark.parametrize(
    ("gone", "outcomes"),
    [
        ((), [TwinStarted, TwinStarted]),
        ((0,), [TwinStarted, TwinStarted, TwinStarted]),
        ((1,), [TwinStarted, TwinLost]),
        ((2,), [TwinStarted, TwinStarted]),
        ((0, 1), [TwinStarted, TwinLost]),
        ((0, 2), [TwinStarted, TwinStarted, TwinLost]),
        ((1, 2), [TwinStarted, TwinLost]),
        ((0, 1, 2), [TwinStarted, TwinLost]),
    ],
)
def test_a_change_of_which_messages_are_lost(
    gone: tuple[int, ...], outcomes: list[type]
) -> None:
    life = calibrated().live(620)
    begin = len(life.contents)
    life.load(OTHER).live(300)
    at = named(life.contents, "params_changed")[-1]
    assert at >= begin
    change = [message_of(c) for c in life.contents[at : at + 3]]
    assert [m.fields.get("event", m.name) for m in change] == [
        *("params_changed", "restarted", "hello")
    ]
    twin, found = run_twin(without(life.contents, *(at + n for n in gone)))
    assert [type(each) for each in found] == outcomes
    assert twin.differed == 0


@pytest.mark.parametrize("kind", [lib.FILTER_FUSE, lib.FILTER_MAHONY])
def test_it_goes_on_where_the_probe_does(kind: int) -> None:
    life = calibrated().live(20).order(lib.COMMAND_RESTART, kind).live(600)
    for records in (OTHER, b"", ONE):
        life.load(records, goes_on=True).live(300)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted, TwinStarted]
    assert len(named(life.contents, "params_changed")) == 3
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(named(life.contents, "pose"))
    life.load(OTHER).live(50)
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted] * 3
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)


# The event of the change and the hello behind it, of which some are lost.
@pytest.mark.parametrize("gone", [(0,), (1,), (0, 1)])
def test_a_loss_where_the_probe_goes_on_ends_it(gone: tuple[int, ...]) -> None:
    life = calibrated().live(620).load(OTHER, goes_on=True).live(300)
    at = named(life.contents, "params_changed")[-1]
    assert message_of(life.contents[at + 1]).name == "hello"
    twin, found = run_twin(without(life.contents, *(at + n for n in gone)))
    assert [type(each) for each in found] == [TwinStarted, TwinLost]
    assert (twin.state, twin.differed) == (TwinState.LOST, 0)


def test_where_the_probe_goes_on_with_params_that_it_missed_it_waits():
    life = calibrated().live(620)
    begin = len(life.contents)
    life.load(OTHER, goes_on=True).live(20)
    # Of the five parts that are told while they are staged, one that is not told again.
    missed = [at for at in named(life.contents, "params") if at >= begin][2]
    twin, outcomes = run_twin(without(life.contents, missed))
    assert [type(each) for each in outcomes] == [TwinStarted, AskParams]
    assert (twin.state, twin.differed) == (TwinState.WAITING, 0)


def test_a_restart_after_a_change_that_was_lost_is_no_difference():
    life = calibrated().live(600)
    life.load(OTHER)
    at = named(life.contents, "params_changed")[-1]
    gone = range(at, len(life.contents))
    life.live(5).order(lib.COMMAND_RESTART).live(150)
    later = [each for each in named(life.contents, "hello") if each > at]
    assert later, "the params are named again"
    twin, outcomes = run_twin(without(life.contents, *gone))
    assert [type(each) for each in outcomes] == [
        TwinStarted,
        TwinLost,
        TwinStarted,
        TwinLost,
    ]
    assert twin.differed == 0


def test_params_that_this_firmware_would_refuse_end_it():
    life = calibrated().live(5)
    twin = Twin()
    outcomes = [
        twin.on_message(
            each.message, each.content, b"\x01" if each.params else each.params
        )
        for each in received(life.contents)
    ]
    (lost,) = [each for each in outcomes if each is not None]
    assert isinstance(lost, TwinLost)
    assert "record 1 of the params" in lost.reason


def test_the_stage_asks_the_probe_to_tell_its_params():
    life = calibrated().live(50)
    begin = named(life.contents, "hello")[-1] + 1
    life.order(lib.COMMAND_HELLO).live(20)
    contents = [
        content
        for at, content in enumerate(life.contents)
        if at >= begin and at not in named(life.contents, "params")
    ]
    stage = TwinStage(Config(twin=True))
    wants = [
        outcome
        for each in received(contents)
        if isinstance(each, Received)
        for outcome in stage.on_message(each)
    ]
    assert wants == [SendCommands((("params_tell", {}),), "its twin can't start")]


def a_life(seed: int) -> list[bytes]:
    """A probe whose params change again and again, among tares and restarts."""
    random = np.random.default_rng(seed)
    life = calibrated(any_records(seed)).order(lib.COMMAND_FIELDS, BOTH)
    # Few bytes: a byte takes many messages.
    first, second = ONE[41:82], OTHER[41:82]
    actions = [
        lambda: life.load(first),
        lambda: life.load(second),
        lambda: life.load(first, goes_on=True),
        lambda: life.load(second, goes_on=True),
        lambda: life.load(record(5, bytes((int(random.integers(2)), 0)))),
        lambda: life.load(b""),
        lambda: life.order(lib.COMMAND_TARE, int(random.integers(3))),
        lambda: life.order(lib.COMMAND_RESTART),
        lambda: life.order(lib.COMMAND_PARAMS_TELL),
        lambda: life.order(lib.COMMAND_HELLO),
        lambda: life.order(lib.COMMAND_STOP).order(lib.COMMAND_START),
    ]
    for _ in range(10):
        actions[random.choice(len(actions))]()
        life.live(int(random.choice([0, 1, 3, 20, 60])))
    return life.contents


known_life = functools.cache(a_life)


@given(st.data())
def test_no_loss_is_a_difference(data: st.DataObject) -> None:
    contents = known_life(data.draw(st.integers(0, 9)))
    kept = data.draw(losses(len(contents)))
    # The messages of a change above all.
    for at in named(contents, "params_changed"):
        kept[at : at + 3] &= data.draw(st.tuples(*[st.booleans()] * 3))
    assert_no_difference(itertools.compress(contents, kept))


# Its own field.


OWN = (80, -50, 25)  # quarters of 1 uT
SIGMA = 8


def keep(life: Life, axis: tuple[int, int, int] = OWN) -> Life:
    """As the probe does where its filter has found it."""
    settings = life.c.settings
    settings.own_field.axis = list(axis)
    settings.own_field.sigma = SIGMA
    settings.own_calibration = life.c.params.digest & 0xFFFF
    lib.settings_save(ffi.addressof(life.c.writer))
    lib.probe_say_hello(life.c, life.time_us)
    return life


@functools.cache
def cells() -> bytes:
    """The memory of a probe that kept it."""
    memory = Memory()
    keep(followed(memory).live(2)).live(800)
    return bytes(memory.cells)


def reborn() -> Life:
    """The next boot of that probe."""
    memory = Memory()
    memory.cells[:] = cells()
    return followed(memory)


def follows(life: Life, begun: int) -> None:
    twin, outcomes = run_twin(life.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted] * begun
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(named(life.contents, "pose"))


def poses(life: Life) -> list[bytes]:
    return [life.contents[at][9:] for at in named(life.contents, "pose")]


def test_a_probe_that_kept_it_and_its_twin_are_equal_in_every_bit():
    life = reborn().live(900)
    hello = message_of(life.contents[named(life.contents, "hello")[-1]])
    assert hello.fields["own_field"] == (20.0, -12.5, 6.25)
    assert hello.fields["own_sigma"] == 2.5
    follows(life, 1)
    assert poses(life) != poses(followed().live(900))


def test_a_restart_begins_with_what_was_kept_meanwhile():
    life = keep(followed().live(300)).live(20).order(lib.COMMAND_RESTART).live(900)
    follows(life, 2)


def test_a_restart_that_forgets_it_begins_without():
    life = reborn().live(300).order(lib.COMMAND_RESTART, 0, 1).live(900)
    follows(life, 2)


@pytest.mark.parametrize("records", [calibrated_records(1), b"\x05\x02\0\1"])
def test_a_change_of_params_is_followed(records):
    life = reborn().live(300).load(records).live(900)
    follows(life, 1 + len(named(life.contents, "restarted")))


def test_a_restart_after_a_hello_that_was_lost_is_no_difference():
    life = keep(followed().live(620), (-80, 50, 90))
    lost = len(life.contents) - 1
    assert message_of(life.contents[lost]).name == "hello"
    life.order(lib.COMMAND_RESTART).live(900)
    twin, outcomes = run_twin(without(life.contents, lost))
    assert [type(each) for each in outcomes] == [TwinStarted, TwinStarted, TwinLost]
    assert twin.differed == 0


def test_where_poses_do_not_tell_the_next_hello_does():
    life = keep(followed().live(620), (-80, 50, 90))
    lost = len(life.contents) - 1
    life.order(lib.COMMAND_RESTART).order(lib.COMMAND_HELLO).live(900)
    twin, outcomes = run_twin(without(life.contents, lost))
    assert [type(each) for each in outcomes] == [TwinStarted, TwinStarted, TwinLost]
    assert isinstance(outcomes[-1], TwinLost)
    assert outcomes[-1].reason == "its own field may have changed"
    assert (twin.state, twin.differed) == (TwinState.LOST, 0)


def test_an_own_field_of_other_params_is_not_used():
    life = reborn().live(900)
    hello = life.contents[named(life.contents, "hello")[-1]]
    records = calibrated_records(1)
    samples = [life.contents[at] for at in named(life.contents, "raw")]

    def last(content: bytes, given: bytes) -> bytes:
        replay = _core.Replay(content, given)
        for raw in samples:
            replay.step(raw)
        return replay.pose(0, 0)

    none = {"own_field": (0.0, 0.0, 0.0), "own_sigma": 0.0}
    assert last(hello, b"") != last(changed(hello, **none), b"")
    assert last(hello, records) == last(changed(hello, **none), records)
    theirs = changed(hello, params_digest=digest_of(b"\x05\x02\0\1"))
    assert last(theirs, b"\x05\x02\0\1") == last(hello, b"")


# Strokes.


def test_a_button_makes_strokes_that_the_twin_computes_again() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    strokes = [message_of(life.contents[at]) for at in named(life.contents, "stroke")]
    ends = [each.fields["end"] for each in strokes if each.fields["end"] != "running"]
    assert ends == ["button", "button"]
    assert len(named(life.contents, "stream_stopped")) == 0
    places = [message_of(life.contents[at]) for at in named(life.contents, "pose")]
    assert places[-1].fields["position"] is not None
    assert places[-1].fields["normal"] is not None
    twin, outcomes = run_twin(life.contents)
    assert [type(each) for each in outcomes] == [TwinStarted]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)


def test_a_click_still_ends_the_stream() -> None:
    life, scene = stroking()
    held = scene.held() & False
    held[600:630] = True
    feel(life, scene.samples[:800], held[:800])
    assert len(named(life.contents, "stream_stopped")) == 1


def test_a_stroke_that_differs_is_told() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    last = named(life.contents, "stroke")[-1]
    spoilt = bytearray(life.contents[last])
    spoilt[18] ^= 1  # the displacement's first byte
    life.contents[last] = bytes(spoilt)
    twin, _ = run_twin(life.contents)
    assert (twin.state, twin.differed) == (TwinState.DIFFERS, 1)


def test_a_lost_press_is_no_difference() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    press = named(life.contents, "button_pressed")[0]
    twin, outcomes = run_twin(without(life.contents, press))
    assert TwinLost in [type(each) for each in outcomes]
    assert twin.differed == 0


def test_rests_make_strokes_where_the_button_does_not() -> None:
    scene = measured(Plan(strokes=2), 7)
    life = feel(followed().load(TIP), scene.samples, scene.held() & False)
    strokes = [message_of(life.contents[at]) for at in named(life.contents, "stroke")]
    ends = [each.fields["end"] for each in strokes if each.fields["end"] != "running"]
    assert ends == ["rest", "rest"]
    twin, outcomes = run_twin(life.contents)
    assert [type(each) for each in outcomes] == [TwinStarted]
    assert twin.differed == 0
