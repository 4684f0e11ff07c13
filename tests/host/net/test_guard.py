# SPDX-License-Identifier: MIT
"""Strangers at the TLS port keep nobody out, and nothing is left of them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from fakes import Stopwatch
from guarded import Guarded
from imud.client import Client
from imud.endpoint import host_and_port, network_of
from imud.net import guard_process
from imud.net.guard import (
    FAILURES,
    UNFINISHED_MAX,
    UNFINISHED_OF_ONE,
    WAIT_KNOWN_S,
    WAIT_MAX_S,
    Address,
    Guard,
    Inner,
    Outer,
    Records,
)

IDLE = 200


def admitted(guarded: Guarded, within_s: float) -> None:
    """A client with keys gets in."""
    watch = Stopwatch(guarded.daemon.process.pid)
    while True:
        try:
            with Client(guarded.endpoint, keys=guarded.keys / "clients/viewer.toml"):
                return
        except Exception:
            if watch.look() > within_s:
                raise


def guard_of(guarded: Guarded) -> int:
    """The process of the guard."""
    pid = guarded.daemon.process.pid
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    children = [int(each) for each in text.split()]
    for task in Path(f"/proc/{pid}/task").iterdir():
        children += map(int, (task / "children").read_text().split())
    return children[0]


def files_of(pid: int) -> int:
    return len([*Path(f"/proc/{pid}/fd").iterdir()])


@pytest.mark.parametrize(
    "first",
    [b"", b"\x16", b"\x16\x03\x01\x02\x00" + bytes(100), b"GET / HTTP/1.1\r\n\r\n"],
    ids=["nothing", "a byte", "half a hello", "another protocol"],
)
def test_idle_connections_keep_nobody_out_and_heal_when_they_go(
    guarded: Guarded, first: bytes
) -> None:
    address = host_and_port(guarded.endpoint.partition("/")[2])
    assert address is not None
    daemon, guard = guarded.daemon.process.pid, guard_of(guarded)
    before = files_of(daemon), files_of(guard)
    with contextlib.ExitStack() as stack:
        for _ in range(IDLE):
            with contextlib.suppress(OSError):
                each = stack.enter_context(socket.create_connection(address, 10))
                each.sendall(first)
        admitted(guarded, 15.0)
        assert files_of(daemon) <= before[0] + UNFINISHED_OF_ONE + 4
    while (files_of(daemon), files_of(guard)) > before:
        time.sleep(0.1)
    admitted(guarded, 2.0)


@pytest.mark.parametrize(
    ("sign", "words"),
    [(signal.SIGKILL, "ended with code -9"), (signal.SIGSTOP, "did nothing for")],
)
def test_a_guard_that_dies_or_hangs_is_told_and_there_again(
    guarded: Guarded, sign: signal.Signals, words: str
) -> None:
    os.kill(guard_of(guarded), sign)
    guarded.daemon.expect(f"the process that guards the TLS port {words}")
    admitted(guarded, 15.0)


class Wire(asyncio.Transport):
    """What an end of the guard writes; nothing is sent."""

    def __init__(self, host: str) -> None:
        super().__init__({"peername": (host, 5)})
        self.is_cut = False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Sends nothing."""

    def close(self) -> None:
        self.is_cut = True

    abort = close


HELLO = b"\x16\x03\x01\x00\x05hello"
RECORD = b"\x17\x03\x03\x00\x02ab"


async def strangers() -> list[list[int]]:
    """Failures of an address, by what it did, in the guard's own words."""
    ends, nothing = [], os.open(os.devnull, os.O_WRONLY)
    guard = Guard(("127.0.0.1", 9), nothing)
    does: list[list[bytes]] = [
        [HELLO + RECORD],  # all at once
        [HELLO, RECORD],  # before the answer
        [HELLO, b"", RECORD],  # Zenoh closes it, with an alert
        [HELLO, b"", RECORD, b"t" * 600],  # a session that never begins
        [HELLO, b"", RECORD, b"t" * 600, b"opened"],
    ]
    for number, steps in enumerate(does):
        outer = Outer(guard)
        outer.connection_made(Wire(f"192.0.2.{number}"))
        if len(steps) > 1:  # as if it were being connected to Zenoh
            outer._opening = asyncio.create_task(asyncio.sleep(0))  # ends at once
        for step in steps:
            if step == b"opened":
                guard.unopened["own"] = outer
                guard.hear(b"other own\n")
            elif step[:1] in (b"", b"t"):
                outer.answer(step)
            elif not outer.is_over:
                outer.data_received(step)
                outer._inner = Inner(outer)
                outer._inner.connection_made(Wire(""))
        if not outer.is_over:
            outer.end()
        outer.connection_lost(None)
        ends.append(outer)
    await asyncio.sleep(0)  # lets those tasks end
    os.close(nothing)
    for outer in ends[3:]:
        outer._judge()
    assert guard.unfinished == 0
    return [[each.address.failures, int(each.address.is_known)] for each in ends]


def test_a_connection_that_ends_without_a_session_is_a_failure_of_its_address() -> None:
    found = asyncio.run(strangers())
    # The first never reached Zenoh.
    assert found == [[0, 0], [1, 0], [1, 0], [1, 0], [0, 1]]


def test_where_all_places_are_taken_the_oldest_of_the_busiest_address_goes() -> None:
    async def crowd() -> list[bool]:
        guard = Guard(("127.0.0.1", 9), sys.stderr.fileno())
        guard.say = lambda *_: None  # type: ignore[method-assign]
        ends = []
        for number in range(UNFINISHED_MAX + 1):
            outer = Outer(guard)
            crowded = min(number // UNFINISHED_OF_ONE, 4)
            outer.connection_made(Wire(f"192.0.2.{crowded}"))
            ends.append(outer)
        return [each.is_over for each in ends]

    assert asyncio.run(crowd()) == [True] + [False] * UNFINISHED_MAX


def test_a_hello_is_followed_record_by_record_however_it_is_cut() -> None:
    stream = b"\x16\x03\x01\x00\x05hello\x14\x03\x03\x00\x01\x01\x17\x03\x03\x00\x02ab"
    for step in (1, 3, len(stream)):
        records = Records()
        for at in range(0, len(stream), step):
            assert records.feed(stream[at : at + step])
        assert records.seen == {22, 20, 23}
        assert records.whole == 3
    assert not Records().feed(b"GET / HTTP/1.1")
    assert not Records().feed(b"\x16\x03\x01\xff\xff")


def test_an_address_that_fails_again_and_again_waits_longer_and_longer() -> None:
    address = Address()
    for _ in range(FAILURES - 1):
        address.fail(0.0)
    assert address.until_s == 0.0
    waits = []
    for _ in range(12):
        address.fail(0.0)
        waits.append(address.until_s)
    assert waits[:3] == [0.5, 1.0, 2.0]
    assert waits[-1] == WAIT_MAX_S
    address.succeed()
    assert address.until_s == 0.0
    for _ in range(20):
        address.fail(0.0)
    assert address.until_s == WAIT_KNOWN_S


def test_a_network_of_ipv6_counts_as_one_address() -> None:
    assert network_of("2001:db8::1") == network_of("2001:db8::ffff:2")
    assert network_of("2001:db8:0:1::1") != network_of("2001:db8::1")
    assert network_of("::ffff:192.0.2.1") == network_of("192.0.2.1")
    assert network_of("fe80::1%eth0") == network_of("fe80::2")


def test_of_many_who_came_the_newest_names_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(guard_process, "KNOWN_MAX", 3)
    made = guard_process.GuardProcess([], lambda *_: None)
    try:
        for each in range(5):
            made._hear(["came", f"127.0.0.1:{5000 + each}", f"192.0.2.1:{each}"])
        told = made.name_of("127.0.0.1:5004, 127.0.0.1:5002, 127.0.0.1:5001")
        assert told == "192.0.2.1:4, 192.0.2.1:2, 127.0.0.1:5001"
    finally:
        made.close()
