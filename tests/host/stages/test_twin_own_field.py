# SPDX-License-Identifier: MIT
"""The twin of a probe that kept its own magnetic field: the filter begins with it."""

from __future__ import annotations

import functools

import pytest

from core.desk import ffi, lib
from core.probe_bench import Memory
from fakes.records import calibrated_records
from imud import _core
from imud.stages.twin_outcomes import TwinLost, TwinStarted, TwinState
from imud.wire.params import digest_of
from twin_bench import Life, changed, followed, message_of, named, run_twin, without

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
