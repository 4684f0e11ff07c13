# SPDX-License-Identifier: MIT
"""Strangers at the TLS port keep nobody out, and nothing is left of them."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes import Stopwatch
from guarded import Guarded
from imud.client import Client
from imud.endpoint import host_and_port, network_of
from imud.net import guard_process
from imud.net.guard import (
    FAILURES,
    UNFINISHED_OF_ONE,
    WAIT_KNOWN_S,
    WAIT_MAX_S,
    Address,
    Records,
)

IDLE = 200


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    made = Guarded(tmp_path_factory.mktemp("guarded"))
    yield made
    made.close()


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


def test_a_guard_that_dies_is_there_again(guarded: Guarded) -> None:
    os.kill(guard_of(guarded), signal.SIGKILL)
    admitted(guarded, 15.0)


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
