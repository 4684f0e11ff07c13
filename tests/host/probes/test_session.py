# SPDX-License-Identifier: MIT
"""Bytes in, events out: who speaks, what is passed on, and what is not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from fakes import COMMAND, HELLO, FakeProbe
from imud import _core
from imud.probes.session import (
    NOISE_BYTES,
    SILENT_NS,
    WAITING_MAX,
    Event,
    OnlyNoise,
    OtherSchema,
    Probe,
    ProbeFound,
    Received,
    Rejected,
    Session,
    Silent,
)
from imud.wire import schema
from imud.wire.frame import encode_frame
from imud.wire.messages import Message, decode, encode

T = TypeVar("T")
SECOND = 1_000_000_000


def registry() -> Callable[[str], Probe]:
    probes: dict[str, Probe] = {}
    return lambda probe_id: probes.setdefault(probe_id, Probe(probe_id))


def of(kind: type[T], events: list[Event]) -> list[T]:
    return [event for event in events if isinstance(event, kind)]


def names(events: list[Event]) -> list[str]:
    return [event.message.name for event in of(Received, events)]


def other(data: bytes) -> bytes:
    """The same content under the CRC of another schema."""
    (content,) = reference.contents(data)
    return _core.encode_frame(schema.SEED ^ 0x1234, content)


def test_messages_wait_for_the_first_hello_and_keep_their_order() -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    assert session.receive(b"\0" + probe.poses(3), 1) == []
    events = session.receive(probe.say("hello") + probe.say("pose"), 2)
    assert isinstance(events[0], ProbeFound)
    assert names(events) == ["pose", "pose", "pose", "hello", "pose"]
    received = [event.stamp.t_received_ns for event in of(Received, events)]
    assert received == [1, 1, 1, 2, 2]
    assert {event.probe.probe_id for event in of(Received, events)} == {probe.name}


def test_messages_that_no_hello_follows_are_counted() -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    session.receive(b"\0" + probe.poses(WAITING_MAX + 5), 1)
    assert session.unnamed == 5
    session.close()
    assert session.counts()["unnamed"] == WAITING_MAX + 5


@given(st.integers(1, 58))
def test_the_frame_in_whose_middle_a_port_is_opened_is_not_corrupt(cut: int) -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    session.receive(probe.say("pose")[cut:] + probe.say("hello"), 1)
    counts = session.counts()
    assert (counts["partial"] + counts["frames"], counts["corrupt"]) in ((2, 0), (1, 0))
    assert session.probe is not None


FATES = st.sampled_from(["keep"] * 8 + ["lose", "double", "flip", "cut", "noise"])


@given(st.lists(FATES, max_size=50), st.data())
def test_a_damaged_wire_adds_up_and_nothing_wrong_is_passed_on(
    fates: list[str], data: st.DataObject
) -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    stream, sent = probe.say("hello"), []
    for fate in fates:
        frame = bytearray(probe.say("pose"))
        sent += reference.contents(bytes(frame))
        if fate == "flip":
            frame[data.draw(st.integers(0, len(frame) - 1))] ^= 1 << data.draw(
                st.integers(0, 7)
            )
        if fate == "cut":
            del frame[data.draw(st.integers(0, len(frame) - 1))]
        stream += bytes(frame) * {"lose": 0, "double": 2}.get(fate, 1)
        if fate == "noise":
            stream += data.draw(st.binary(max_size=20))
    stream += b"\0" + probe.say("status")
    heard = reference.contents(stream)
    events: list[Event] = []
    while stream:
        size = data.draw(st.integers(1, 200))
        events += session.receive(stream[:size], 1)
        stream = stream[size:]
    counts: Any = session.probe.account.counts()
    passed = [event.content for event in of(Received, events)]
    assert passed == list(dict.fromkeys(heard))
    assert [c for c in passed[1:-1] if c not in sent] == []
    assert counts["sent"] == len(fates) + 2
    assert counts["received"] == len(set(heard))
    assert counts["duplicated"] == len(heard) - len(set(heard))
    assert counts["lost"] == len(fates) + 2 - len(set(heard))


def test_a_restart_is_told_and_begins_a_count_of_its_own() -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    session.receive(probe.say("hello") + probe.poses(5), 1)
    probe.restart()
    events = session.receive(probe.say("hello") + probe.poses(2), 2)
    (found,) = of(ProbeFound, events)
    assert found.is_restart
    assert [e.stamp.t_device_us for e in of(Received, events)] == [0, 5000, 10000]
    counts: Any = session.probe.account.counts()
    assert (counts["boots"], counts["sent"], counts["lost"]) == (2, 3, 0)


def test_a_port_that_is_opened_again_goes_on_with_the_same_account() -> None:
    find, probe = registry(), FakeProbe()
    first = Session(find, 0)
    first.receive(probe.say("hello") + probe.poses(5), 1)
    first.close()
    probe.poses(7)
    second = Session(find, 2)
    (found,) = of(ProbeFound, second.receive(probe.say("hello"), 3))
    assert not found.is_restart
    counts: Any = find(probe.name).account.counts()
    assert (counts["sent"], counts["received"], counts["lost"]) == (14, 7, 7)


def test_a_probe_that_a_log_names_is_found_once() -> None:
    fake, pen = FakeProbe(), Probe("pen")
    session = Session(lambda _: pen)
    events: list[Event] = []
    for _ in range(3):
        events += session.receive(b"\0" + fake.say("hello") + fake.say("raw"), 0)
    assert len(of(ProbeFound, events)) == 1
    assert len(of(Received, events)) == 6


def test_another_probe_on_the_same_port_has_its_own_account() -> None:
    find, one = registry(), FakeProbe()
    two = FakeProbe(probe_id=bytes(range(8)))
    session = Session(find, 0)
    session.receive(one.say("hello") + one.poses(3), 1)
    session.receive(two.say("hello") + two.poses(4), 2)
    counts: list[Any] = [find(p.name).account.counts() for p in (one, two)]
    assert [(c["sent"], c["received"]) for c in counts] == [(4, 4), (5, 5)]


def test_a_probe_of_another_schema_is_named_once_and_not_called_corrupt() -> None:
    probe = FakeProbe(schema_fingerprint=schema.FINGERPRINT ^ 1, firmware="0.9.0")
    session = Session(registry(), 0)
    stream = other(probe.say("pose")) + other(probe.say("pose"))
    events = session.receive(stream + probe.say("hello"), 1)
    events += session.receive(other(probe.say("pose")) + probe.say("hello"), 2)
    (event,) = events
    assert isinstance(event, OtherSchema)
    assert (event.firmware, event.probe_id) == ("0.9.0", probe.name)
    assert event.fingerprint == schema.FINGERPRINT ^ 1
    counts = session.counts()
    assert (counts["corrupt"], counts["foreign"] + counts["partial"]) == (0, 3)
    assert session.check(10 * SECOND) != []  # and yet silence is noticed


def test_a_probe_that_is_updated_in_place_is_found() -> None:
    find = registry()
    old = FakeProbe(schema_fingerprint=schema.FINGERPRINT ^ 1)
    session = Session(find, 0)
    assert len(of(OtherSchema, session.receive(old.say("hello"), 1))) == 1
    fresh = FakeProbe()
    assert len(of(ProbeFound, session.receive(fresh.say("hello"), 2))) == 1
    flipped = bytearray(fresh.say("pose"))
    flipped[-8] ^= 0x10
    session.receive(bytes(flipped), 3)
    assert session.counts()["corrupt"] == 1


def test_noise_is_told_once_until_something_good_comes() -> None:
    session = Session(registry(), 0)
    noise = b"\x55" * (NOISE_BYTES + 1)
    session.receive(noise, SILENT_NS)
    assert session.check(SILENT_NS) == []
    (event,) = session.check(SILENT_NS + 1)
    assert event == OnlyNoise(NOISE_BYTES + 1)
    session.receive(noise, SILENT_NS + 2)
    assert session.check(9 * SECOND) == []
    session.receive(b"\0" + FakeProbe().say("hello") + noise, 9 * SECOND)
    assert session.check(9 * SECOND + SILENT_NS) == []
    session.receive(noise, 9 * SECOND + SILENT_NS)
    assert len(of(OnlyNoise, session.check(9 * SECOND + SILENT_NS + 1))) == 1


def test_silence_is_told_once() -> None:
    session = Session(registry(), 0)
    assert session.check(SILENT_NS) == []
    (event,) = session.check(SILENT_NS + 1)
    assert isinstance(event, Silent)
    assert event.seconds == pytest.approx(SILENT_NS / 1e9)
    assert session.check(2 * SILENT_NS) == []


def test_noise_after_a_silence_is_told_too() -> None:
    session = Session(registry(), 0)
    assert len(of(Silent, session.check(SILENT_NS + 1))) == 1
    session.receive(b"x" * (NOISE_BYTES + 1), SILENT_NS + 2)
    assert session.check(SILENT_NS + 3) == [OnlyNoise(NOISE_BYTES + 1)]
    assert session.check(3 * SILENT_NS) == []


def test_our_own_commands_coming_back_are_no_messages_of_a_probe() -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    session.receive(probe.say("hello"), 1)
    (event,) = session.receive(encode_frame(encode("command", COMMAND, 1, 2)), 2)
    assert isinstance(event, Rejected)
    assert event.skew.kind == "unknown_message"


def test_content_without_a_header_is_counted_by_its_port() -> None:
    session = Session(registry(), 0)
    assert session.receive(encode_frame(b"\x06abc"), 1) == []
    assert session.counts()["headless"] == {"wrong_length": 1}


def test_raw_counts_are_scaled_by_the_latest_hello() -> None:
    probe, session = FakeProbe(), Session(registry(), 0)
    session.receive(probe.say("hello"), 1)
    (event,) = of(Received, session.receive(probe.say("raw"), 1))
    assert event.probe.hello["acc_lsb"] == HELLO["acc_lsb"]
    message = decode(event.probe.hello_content)
    assert isinstance(message, Message)
    probe.hello_fields["acc_lsb"] = 0.001
    session.receive(probe.say("hello"), 2)
    assert event.probe.hello["acc_lsb"] == 0.001
