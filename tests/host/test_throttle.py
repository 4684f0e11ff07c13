# SPDX-License-Identifier: MIT
"""A client that connects too often is refused before anything is read; others are
not."""

from __future__ import annotations

import contextlib
import http.client
import socket
import time

import pytest

from imud import throttle
from imud.daemon.metrics import RATE, MetricsServer
from imud.igtl.server import RATE as IGTL_RATE
from imud.igtl.server import Server
from imud.throttle import ALL, Rate, Throttle
from imud.web import connections
from imud.web.server import Page

SMALL = Rate(at_once=3, a_second=2.0)


def made(rate: Rate = SMALL) -> Throttle:
    return Throttle(rate, lambda _: None)


def admitted(door: Throttle, host: str, now_s: float, tries: int = 100) -> int:
    return sum(door.admits(host, now_s) for _ in range(tries))


def test_an_address_may_connect_so_often_at_once_and_then_so_often_a_second() -> None:
    door = made()
    assert admitted(door, "192.0.2.1", 10.0) == 3
    assert admitted(door, "192.0.2.1", 10.4) == 0
    assert admitted(door, "192.0.2.1", 11.0) == 2
    assert admitted(door, "192.0.2.1", 100.0) == 3


def test_others_are_not_kept_out_by_one_that_is_refused() -> None:
    door = made()
    assert admitted(door, "192.0.2.1", 10.0, 10_000) == 3
    assert admitted(door, "192.0.2.2", 10.0) == 3
    assert admitted(door, "2001:db8::1", 10.0) == 3
    assert admitted(door, "2001:db8::2", 10.0) == 0  # the same network


def test_all_addresses_together_are_bounded_and_few_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(throttle, "ADDRESSES_MAX", 20)
    door = made()
    taken = [admitted(door, f"192.0.2.{each}", 10.0) for each in range(100)]
    assert sum(taken) == ALL * SMALL.at_once
    assert len(door._each) == 20
    later = [admitted(door, f"192.0.2.{each}", 11.0) for each in range(100)]
    assert sum(later) == ALL * SMALL.a_second


def burst(port: int, tries: int) -> int:
    """How many of `tries` connections got an answer to a request."""
    answered = 0
    for _ in range(tries):
        with (
            contextlib.suppress(ConnectionError),
            socket.create_connection(("127.0.0.1", port), 5.0) as each,
        ):
            each.sendall(b"GET /none HTTP/1.1\r\nHost: localhost\r\n\r\n")
            answered += bool(each.recv(10))
    return answered


def test_a_flood_of_the_metrics_is_refused_and_counted_and_ends_by_itself() -> None:
    server = MetricsServer(("127.0.0.1", 0))
    server.start()
    try:
        begin_s = time.monotonic()
        answered = burst(server.port, 200)
        took_s = time.monotonic() - begin_s
        assert RATE.at_once <= answered <= RATE.at_once + 1 + took_s * RATE.a_second
        assert server.refused["rate"] == 200 - answered
        time.sleep(1.5 / RATE.a_second)  # until another is let in
        client = http.client.HTTPConnection("127.0.0.1", server.port)
        client.request("GET", "/metrics")
        assert client.getresponse().status == 200
    finally:
        server.close()


def test_a_flood_of_the_page_is_refused_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "RATE", SMALL)
    told: list[str] = []
    page = Page(
        ("127.0.0.1", 0),
        lambda *_: None,
        on_notice=lambda _, text, __: told.append(text),
    )
    page.start()
    try:
        begin_s = time.monotonic()
        answered = burst(int(page.url.rpartition(":")[2]), 50)
        took_s = time.monotonic() - begin_s
        assert SMALL.at_once <= answered <= SMALL.at_once + 1 + took_s * SMALL.a_second
        assert page.refused["rate"] == 50 - answered
        assert any("connections a second from its address" in text for text in told)
    finally:
        page.close()


def test_a_flood_of_openigtlink_is_refused_and_counted() -> None:
    server = Server(("127.0.0.1", 0))
    server.start()
    try:
        for _ in range(IGTL_RATE.at_once + 20):
            # A refusal may come before the client knows that it is connected.
            with contextlib.suppress(ConnectionResetError):
                socket.create_connection(("127.0.0.1", server.port), 5.0).close()
        while server.refused["rate"] < 15:
            time.sleep(0.01)
        assert 15 <= server.refused["rate"] <= 20
    finally:
        server.close()
