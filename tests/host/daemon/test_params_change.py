# SPDX-License-Identifier: MIT
"""A change of params is one transaction, whatever happens on the way: all new ones are
in force, or all old ones with a reason."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from fakes import FakeProbe
from imud.daemon import commands, params_change
from imud.errors import (
    CommandRefused,
    DeviceError,
    NoReply,
    ParamsError,
    VersionMismatch,
)
from imud.params.value import Params, ParamsRecord
from imud.probes.session import OtherSchema
from imud.wire.messages import Message
from params_bench import GOOD, Wire, learned

TOO_LONG = Params((ParamsRecord(200, bytes(200)), ParamsRecord(201, bytes(200))))
OLD = Params().replaced("options", {"reference": "full"})


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    """A probe with params of before, and a daemon that does not wait long."""
    monkeypatch.setattr(commands, "REPLY_TIMEOUT_S", 0.01)
    monkeypatch.setattr(params_change, "POLL_S", 0.0)
    probe = FakeProbe()
    probe.params.records = OLD.encode()
    return Wire(probe)


def steps(wire: Wire) -> int:
    """How many frames an undisturbed change takes."""
    wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()
    return wire.frames


def test_all_new_ones_are_in_force_and_the_answer_says_so(wire: Wire) -> None:
    value = wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()
    assert value == {
        "digest": f"{GOOD.digest:08x}",
        "before": f"{OLD.digest:08x}",
        "is_changed": True,
    }
    entry = wire.intake.registry[wire.probe.name]
    assert entry.probe.params == GOOD.encode()
    assert [c["command"] for c in wire.probe.commands][-1] == "hello"


def test_the_filter_goes_on_with_what_was_learned_and_with_nothing_else(
    wire: Wire,
) -> None:
    first, second = learned("acc", 1), learned("acc", 2)
    guided = GOOD.without("options")
    changes = ((first, False), (second, True), (guided, False), (first, True))
    for params, goes_on in changes:  # of what was there before the first nobody knows
        wire.load(params)
        assert wire.probe.params.records == params.encode()
        assert wire.probe.params.goes_on == goes_on


def test_older_firmware_takes_what_was_learned_and_begins_anew(wire: Wire) -> None:
    wire.load(learned("acc", 1))
    wire.probe.params.knows_going_on = False
    wire.load(learned("acc", 2))
    assert wire.probe.params.records == learned("acc", 2).encode()
    assert not wire.probe.params.goes_on


def test_nothing_is_sent_where_they_are_in_force_already(wire: Wire) -> None:
    assert not wire.load(OLD)["is_changed"]
    assert wire.frames == 0


def test_none_are_params_too(wire: Wire) -> None:
    assert wire.load(Params())["digest"] == "00000000"
    assert wire.probe.params.records == b""


@pytest.mark.parametrize("is_answer", [False, True])
def test_any_frame_may_be_lost(wire: Wire, is_answer: bool) -> None:
    total = steps(wire)
    for lost in range(1, total + 1):
        wire.load(OLD)
        begin = wire.frames
        wire.lose = lambda number, answer, at=begin + lost: (
            number == at and answer == is_answer
        )
        wire.load(GOOD)
        assert wire.probe.params.records == GOOD.encode()


def test_answers_may_come_twice(wire: Wire) -> None:
    wire.copies = 2
    wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()


def test_a_probe_that_is_busy_for_long_is_asked_again(wire: Wire) -> None:
    wire.probe.params.busy = 7
    wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()


def test_a_probe_that_stays_busy_is_an_error(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(params_change, "WORD_S", 0.0)
    wire.probe.params.busy = 10**9
    with pytest.raises(DeviceError, match="was busy for 0 s"):
        wire.load(GOOD)
    assert wire.probe.params.records == OLD.encode()


def test_a_change_without_end_is_given_up(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(params_change, "CHANGE_S", 0.05)
    wire.probe.params.busy = 10**9
    with pytest.raises(DeviceError, match=r"did not accept the params within 0\.05 s"):
        wire.load(GOOD)
    wire.probe.params.restart()
    wire.probe.params.busy = 0
    assert wire.load(GOOD)["is_changed"]


def test_a_restart_at_any_step_leaves_the_old_ones_and_says_so(wire: Wire) -> None:
    total = steps(wire)
    held = []
    for step in range(1, total + 1):
        wire.load(OLD)
        begin = wire.frames

        def restart(number: int, at: int = begin + step) -> None:
            if number == at:
                wire.restart()

        wire.before = restart
        try:
            wire.load(GOOD)
        except DeviceError as error:
            assert "restarted while its params were changed" in str(error)
            assert wire.probe.params.records == OLD.encode()
            held.append(step)
        else:
            # It restarted after the switch.
            assert wire.probe.params.records == GOOD.encode()
        wire.before = lambda _: None
    assert held == list(range(1, len(held) + 1))
    assert 0 < len(held) < total


def test_a_wire_that_is_cut_at_any_step_is_an_error(wire: Wire) -> None:
    total = steps(wire)
    for step in range(1, total + 1):
        wire.load(OLD)
        begin = wire.frames
        wire.lose = lambda number, _, at=begin + step: number >= at
        with pytest.raises(NoReply, match=r"did not answer .*; the old or the new set"):
            wire.load(GOOD)
        assert wire.probe.params.records in (OLD.encode(), GOOD.encode())
        wire.lose = lambda *_: False


@pytest.mark.parametrize("lost", [1, 2])
def test_words_that_the_probe_did_not_keep_are_sent_again(
    wire: Wire, lost: int
) -> None:
    wire.probe.params.forgets = lost
    wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()


def test_what_stays_damaged_is_refused(wire: Wire) -> None:
    wire.probe.params.forgets = 10**9
    with pytest.raises(CommandRefused, match=r"arrived damaged .*, 3 times"):
        wire.load(GOOD)
    assert wire.probe.params.records == OLD.encode()


@pytest.mark.parametrize(
    ("refusal", "words"),
    [
        ((1, 2), "refused the params: acc is out of range"),
        ((200, 3), "refused the params: record 200 is given twice"),
        ((5, 1), "refused the params: options has the wrong length"),
    ],
)
def test_a_refusal_names_the_record_and_why(
    wire: Wire, refusal: tuple[int, int], words: str
) -> None:
    wire.probe.params.refusal = refusal
    with pytest.raises(CommandRefused, match=words):
        wire.load(GOOD)
    assert wire.probe.params.records == OLD.encode()
    wire.probe.params.refusal = None
    assert wire.load(GOOD)["is_changed"]


def test_a_worn_memory_is_told(wire: Wire) -> None:
    wire.probe.params.is_worn = True
    with pytest.raises(CommandRefused, match="its memory does not store what is"):
        wire.load(GOOD)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        ("unknown_command", "unknown command"),
        ("bad_argument", "no room for 46 bytes"),
        ("not_ready", "not ready"),
    ],
)
def test_another_result_is_told(wire: Wire, result: str, words: str) -> None:
    wire.probe.results["params_write"] = result
    with pytest.raises(CommandRefused, match=words):
        wire.load(GOOD)


def test_a_hello_that_tells_others_is_an_error(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(params_change, "VERIFY_S", 0.0)
    say = wire.probe.content

    def content(name: str, **fields: Any) -> bytes:
        more = {"params_digest": 7} if name == "hello" else {}
        return say(name, **fields | more)

    monkeypatch.setattr(wire.probe, "content", content)
    with pytest.raises(DeviceError, match="its hello reports different ones"):
        wire.load(GOOD)


def test_of_two_at_once_one_gets_a_clear_line(wire: Wire) -> None:
    other = GOOD.without("options")

    async def both() -> list[Any]:
        work = (wire.command(GOOD.encode()), wire.command(other.encode()))
        return await asyncio.gather(*work, return_exceptions=True)

    first, second = asyncio.run(both())
    assert first["is_changed"]
    assert isinstance(second, CommandRefused)
    assert "another client is changing the params" in str(second)
    assert wire.probe.params.records == GOOD.encode()
    assert wire.load(other)["is_changed"]


def test_another_host_on_the_wire_makes_no_mixture(wire: Wire) -> None:
    """It writes words of its own in between: digests tell, and words come again."""
    words = [(0, 0x11111111), (4, 0x22222222)]

    def interfere(_: int) -> None:
        if words and wire.frames > 3:
            at, word = words.pop()
            wire.probe.params.obey("params_write", at, word)

    wire.before = interfere
    wire.load(GOOD)
    assert wire.probe.params.records == GOOD.encode()


def test_those_of_another_probe_need_force(wire: Wire) -> None:
    with pytest.raises(CommandRefused, match=r"from probe 1{16}, but .*--force"):
        wire.load(GOOD, probe="1" * 16)
    assert wire.load(GOOD, probe="1" * 16, force="1")["is_changed"]
    assert not wire.load(GOOD, probe=wire.probe.name)["is_changed"]


@pytest.mark.parametrize(
    ("records", "words"),
    [
        (b"\x01", "end within a record, at byte 0"),
        (b"\x05\x02\0\0\x05\x02\0\0", "options is given twice"),
        (Params((ParamsRecord(1, bytes(5)),)).encode(), "acc: the record is too short"),
        (TOO_LONG.encode(), "take 404 bytes, and a probe has room for 248"),
    ],
)
def test_what_a_probe_would_refuse_is_not_sent(
    wire: Wire, records: bytes, words: str
) -> None:
    with pytest.raises((CommandRefused, ParamsError), match=words):
        asyncio.run(wire.command(records))
    assert wire.frames == 0


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({}, "needs records=hexadecimal digits"),
        ({"records": "0g"}, "needs records=hexadecimal digits"),
    ],
)
def test_a_query_that_makes_no_sense_is_refused(
    wire: Wire, parameters: dict[str, str], words: str
) -> None:
    with pytest.raises(CommandRefused, match=words):
        asyncio.run(wire.change.command(wire.probe.name, parameters))


def test_a_probe_that_is_not_there_is_named(wire: Wire) -> None:
    with pytest.raises(DeviceError, match="no probe stylus;"):
        asyncio.run(wire.change.command("stylus", {"records": ""}))


def test_a_probe_of_another_schema_is_sent_nothing(wire: Wire) -> None:
    entry = wire.intake.registry[wire.probe.name]
    hello = Message("hello", 0, 0, {})
    entry.other = OtherSchema(wire.probe.name, 5, "0.0.9", hello)
    with pytest.raises(VersionMismatch, match="has another schema"):
        wire.load(GOOD)
    assert wire.frames == 0


def test_a_probe_that_is_unplugged_in_the_midst_is_gone(wire: Wire) -> None:
    def unplug(number: int) -> None:
        if number == 5:
            wire.intake.registry[wire.probe.name].port = None

    wire.before = unplug
    with pytest.raises(DeviceError, match="is disconnected; plug it in"):
        wire.load(GOOD)
    assert wire.probe.params.records == OLD.encode()


@pytest.mark.parametrize("step", ["params_write", "params_apply"])
def test_a_step_alone_is_no_command(wire: Wire, step: str) -> None:
    with pytest.raises(CommandRefused, match=f"there is no command '{step}', only"):
        asyncio.run(wire.commander.command(wire.probe.name, step, {}))
