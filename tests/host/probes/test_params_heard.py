# SPDX-License-Identifier: MIT
"""Which params a probe has in force, as its messages tell it."""

from __future__ import annotations

import pytest

from fakes import FakeProbe
from fakes.records import calibrated_records, parts_of
from imud.probes.first_hello import first_hello, probe_in_file
from imud.probes.session import Probe, Received, Session
from imud.wire.messages import Message, decode
from imud.wire.params import SETS_MAX, WHOLE_MAX, ParamsParts, digest_of

ONE, OTHER = calibrated_records(1), calibrated_records(2)


class Desk:
    """A probe, a session that hears it, and the probe as the session knows it."""

    def __init__(self, records: bytes = b"") -> None:
        self.fake = FakeProbe(params_digest=digest_of(records))
        self.known = Probe(self.fake.name)
        self.session = Session(lambda _: self.known, 0)
        self.say(self.fake.say("hello"))

    def say(self, *frames: bytes) -> list[Received]:
        events = self.session.receive(b"".join(frames), 1)
        return [event for event in events if isinstance(event, Received)]

    def changed(self, records: bytes) -> bytes:
        detail = digest_of(records)
        detail -= (detail >> 31) << 32
        return self.fake.say("event", event="params_changed", detail=detail)


def test_without_records_nothing_has_to_be_told():
    assert Desk().known.params == b""


def test_parts_of_the_next_params_leave_those_in_force_until_the_event():
    desk = Desk(ONE)
    desk.say(*parts_of(desk.fake, ONE), *parts_of(desk.fake, OTHER))
    assert desk.known.params == ONE
    desk.say(desk.changed(OTHER))
    assert desk.known.params == OTHER
    desk.say(desk.changed(ONE))
    assert desk.known.params == ONE


def test_each_message_has_the_params_of_its_own_moment():
    desk = Desk(ONE)
    fake = desk.fake
    heard = desk.say(
        fake.say("raw"),
        *parts_of(fake, ONE),
        fake.say("raw"),
        *parts_of(fake, OTHER),
        fake.say("raw"),
        desk.changed(OTHER),
        fake.say("raw"),
    )
    raws = [event.params for event in heard if event.message.name == "raw"]
    assert raws == [None, ONE, ONE, OTHER]


def test_a_hello_says_what_a_lost_event_would_have():
    desk = Desk(ONE)
    desk.say(*parts_of(desk.fake, ONE), *parts_of(desk.fake, OTHER))
    desk.changed(OTHER)
    desk.fake.hello_fields = desk.fake.hello_fields | {
        "params_digest": digest_of(OTHER)
    }
    desk.say(desk.fake.say("hello"))
    assert desk.known.params == OTHER


def test_they_are_known_over_a_reboot():
    desk = Desk(ONE)
    desk.say(*parts_of(desk.fake, ONE))
    desk.fake.restart()
    desk.say(desk.fake.say("hello"))
    assert desk.known.params == ONE


@pytest.mark.parametrize("at", [1, 28 * 40, 65535])
def test_a_part_at_an_impossible_place_is_no_part(at: int):
    desk = Desk(ONE)
    *first, last = parts_of(desk.fake, ONE, lambda _, **fields: fields)
    for fields in (*first, last | {"part_offset": at}):
        desk.say(desk.fake.say("params", **fields))
    assert desk.known.params is None
    desk.say(desk.fake.say("params", **last))
    assert desk.known.params == ONE


def test_what_a_strange_probe_tells_does_not_fill_the_memory():
    fake, parts = FakeProbe(), ParamsParts()
    for number in range(200):
        records = calibrated_records(number)
        for content in parts_of(fake, records, fake.content):
            message = decode(content)
            assert isinstance(message, Message)
            parts.add_part(message)
        fields = {"set_digest": number + 1, "set_length": 300, "part_offset": 28}
        message = decode(fake.content("params", **fields))
        assert isinstance(message, Message)
        parts.add_part(message)
    assert len(parts._parts) <= SETS_MAX
    assert len(parts._whole) <= WHOLE_MAX
    assert parts.get(0) == b""
    assert parts.get(digest_of(calibrated_records(199))) is not None


def test_the_params_of_a_file_are_known_from_its_first_message_on():
    fake = FakeProbe(params_digest=digest_of(ONE))
    data = fake.say("raw") + fake.say("hello") + b"".join(parts_of(fake, ONE))
    data += fake.say("raw")
    known = first_hello(data[at : at + 7] for at in range(0, len(data), 7))
    assert probe_in_file(known, Probe).params == ONE


def test_a_file_whose_params_are_told_in_part_leaves_them_unknown():
    fake = FakeProbe(params_digest=digest_of(ONE))
    data = fake.say("hello") + b"".join(list(parts_of(fake, ONE))[1:])
    assert probe_in_file(first_hello([data]), Probe).params is None
    assert probe_in_file(first_hello([b""]), Probe).params is None
