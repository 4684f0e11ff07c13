# SPDX-License-Identifier: MIT
"""Signed datagrams: what is taken, once and in which order, and what is refused."""

from __future__ import annotations

import pytest

from fakes.datagrams import SignedProbe, signed
from imud.ports.datagram import (
    DATAGRAM_MAX,
    GREETED_MAX,
    WINDOW,
    DatagramFault,
    Peer,
    Window,
    addressed,
)

ID = bytes(range(8))
KEY = bytes(range(32))
HERE = ("192.0.2.7", 5000)
THERE = ("192.0.2.8", 5000)


@pytest.fixture
def peer() -> Peer:
    return Peer(ID, KEY)


def greeted(peer: Peer, address: tuple[str, int] = HERE) -> SignedProbe:
    probe = SignedProbe(ID, peer.key)
    welcome = peer.welcome(probe.hello(), address)
    assert isinstance(welcome, bytes)
    probe.heed(welcome)
    return probe


def test_a_session_gives_each_payload_once(peer: Peer) -> None:
    probe = greeted(peer)
    datagrams = [probe.data(bytes([n]) * n) for n in range(5)]
    assert addressed(datagrams[0]) == (0x13, ID)
    assert [peer.open(each, HERE) for each in datagrams] == [
        bytes([n]) * n for n in range(5)
    ]
    assert {peer.open(each, HERE) for each in datagrams} == {DatagramFault.REPLAYED}
    assert peer.sessions == 1


def test_what_the_daemon_sends_is_signed_and_counted(peer: Peer) -> None:
    probe = greeted(peer)
    peer.open(probe.data(b""), HERE)
    sealed = [peer.channel.seal(payload) for payload in (b"one", b"", b"three")]
    assert [probe.opened(each) for each in sealed] == [
        (0, b"one"),
        (1, b""),
        (2, b"three"),
    ]
    # Sent back to the daemon, they are nothing that a probe has signed.
    assert [peer.open(each, HERE) for each in sealed] == [DatagramFault.MALFORMED] * 3


@pytest.mark.parametrize("bit", [0, 7])
def test_a_change_of_any_byte_is_refused(peer: Peer, bit: int) -> None:
    probe = greeted(peer)
    whole = probe.data(b"payload")
    for at in range(len(whole)):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << bit
        assert peer.open(bytes(damaged), HERE) == DatagramFault.BAD_SIGNATURE
    assert peer.open(whole, HERE) == b"payload"


def test_without_the_key_nothing_is_answered_or_taken(peer: Peer) -> None:
    stranger = SignedProbe(ID, bytes(32), session=bytes(32))
    assert peer.welcome(stranger.hello(), HERE) is DatagramFault.BAD_SIGNATURE
    assert peer.open(stranger.data(b"x"), HERE) is DatagramFault.NO_SESSION
    probe = greeted(peer)
    assert peer.open(stranger.data(b"x"), HERE) is DatagramFault.BAD_SIGNATURE
    assert peer.open(probe.data(b"x"), HERE) == b"x"
    assert peer.open(stranger.data(b"x", 7), HERE) is DatagramFault.BAD_SIGNATURE


def test_a_session_can_not_be_played_again(peer: Peer) -> None:
    probe = greeted(peer)
    recorded = [probe.hello(), probe.data(b"a"), probe.data(b"b")]
    for each in recorded[1:]:
        peer.open(each, HERE)
    # The hello is answered, as it is signed; the rest has the key of another session.
    for place in (HERE, THERE):
        assert isinstance(peer.welcome(recorded[0], place), bytes)
    assert peer.open(recorded[1], HERE) is DatagramFault.REPLAYED
    assert peer.open(recorded[1], THERE) is DatagramFault.BAD_SIGNATURE
    assert peer.sessions == 1
    assert peer.open(probe.data(b"c"), HERE) == b"c"


def test_a_new_daemon_takes_nothing_of_an_earlier_session(peer: Peer) -> None:
    probe = greeted(peer)
    recorded = probe.data(b"a")
    later = Peer(ID, KEY)
    assert later.open(recorded, HERE) is DatagramFault.NO_SESSION
    greeted(later)
    assert later.open(recorded, HERE) is DatagramFault.BAD_SIGNATURE


def test_a_recorded_hello_does_not_end_a_session(peer: Peer) -> None:
    probe = greeted(peer)
    hello = probe.hello()
    peer.open(probe.data(b""), HERE)
    for _ in range(3 * GREETED_MAX):
        peer.welcome(hello, HERE)
    assert peer.open(probe.data(b"on"), HERE) == b"on"


def test_the_next_session_ends_the_one_before(peer: Peer) -> None:
    first = greeted(peer)
    peer.open(first.data(b""), HERE)
    second = greeted(peer, THERE)
    assert peer.open(first.data(b"still"), HERE) == b"still"
    assert peer.open(second.data(b"here"), THERE) == b"here"
    assert peer.open(first.data(b"late"), HERE) is DatagramFault.NO_SESSION
    assert (peer.address, peer.sessions) == (THERE, 2)


def test_a_session_stays_at_its_address(peer: Peer) -> None:
    probe = greeted(peer)
    peer.open(probe.data(b""), HERE)
    assert peer.open(probe.data(b"x"), THERE) is DatagramFault.NO_SESSION


@pytest.mark.parametrize(
    ("datagram", "fault"),
    [
        (b"", DatagramFault.MALFORMED),
        (bytes(24), DatagramFault.MALFORMED),
        (bytes(DATAGRAM_MAX + 1), DatagramFault.OVERSIZED),
    ],
)
def test_what_can_not_be_a_datagram_is_refused(
    datagram: bytes, fault: DatagramFault
) -> None:
    assert addressed(datagram) is fault


def test_signed_datagrams_of_a_wrong_form_are_refused(peer: Peer) -> None:
    short = signed(KEY, b"\x11" + ID)
    assert peer.welcome(short, HERE) is DatagramFault.MALFORMED
    probe = greeted(peer)
    assert (
        peer.open(signed(probe.session, b"\x13" + ID), HERE) is DatagramFault.MALFORMED
    )
    assert peer.open(probe.data(b"x"), HERE) == b"x"


def test_late_datagrams_are_taken_within_the_window() -> None:
    window = Window()
    order = [0, 2, 1, 2, 1, WINDOW + 1, 2 + 1, 2, WINDOW + 1, 10 * WINDOW, 9 * WINDOW]
    taken = [True, True, True, False, False, True, True, False, False, True, False]
    assert [window.accept(counter) for counter in order] == taken
    edge = 10 * WINDOW - (WINDOW - 1)
    assert not window.accept(edge - 1)
    assert window.accept(edge)
    assert not window.accept(edge)
    assert window.highest == 10 * WINDOW
