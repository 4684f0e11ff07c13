# SPDX-License-Identifier: MIT
"""The page's server, without a browser: what it serves, whom it refuses, and that
nobody who misbehaves disturbs another."""

from __future__ import annotations

import contextlib
import http.client
import logging
import socket
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import length
from fakes import PATIENCE_S
from imud import serving
from imud.web import connections, server, session
from imud.web.server import MESSAGE_MAX
from imud.web.users import TokenHolder
from streaming import until
from web.served import Live, Served


def test_the_page_and_its_modules_are_served_packed_and_guarded(served: Served) -> None:
    answer = served.get("/", **{"Accept-Encoding": "gzip"})
    assert answer.status == 200
    assert answer.getheader("Content-Encoding") == "gzip"
    policy = answer.getheader("Content-Security-Policy") or ""
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    plain = served.get("/main.js")
    body = plain.read()
    assert b"SPDX" in body
    assert plain.getheader("Content-Type") == "text/javascript; charset=utf-8"
    tag = plain.getheader("ETag") or ""
    again = served.get("/main.js", **{"If-None-Match": tag})
    assert (again.status, again.read()) == (304, b"")


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/vendor/../server.py",
        "/%2e%2e/server.py",
        "//etc/passwd",
        "/vendor/three/LICENSE",
        "/main.js/",
        "/nothing",
        "http://127.0.0.1/main.js",
    ],
)
def test_no_path_leads_out_of_the_page(served: Served, path: str) -> None:
    assert served.get(path).status == 404
    assert served.page.refused == {"path": 1}


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "[::2]", ""]
)
def test_another_sites_name_for_this_machine_is_refused(
    served: Served, host: str
) -> None:
    assert served.get("/", Host=host).status == 421
    assert served.page.refused == {"host": 1}
    assert "the request names another host" in served.notices[0]


@pytest.mark.parametrize("host", ["localhost:9", "[::1]:9", "127.0.0.1", "127.0.0.9:1"])
def test_a_tunnel_may_have_another_port(served: Served, host: str) -> None:
    assert served.get("/", Host=host).status == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1", "http://localhost"]
)
def test_another_sites_page_gets_no_connection(served: Served, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused, served.live(origin):
        pass
    assert refused.value.response.status_code == 403
    assert served.page.refused == {"origin": 1}


def test_a_connection_without_origin_is_refused(served: Served) -> None:
    with pytest.raises(InvalidStatus), connect(f"ws://{served.host}/live"):
        pass
    assert served.page.refused == {"origin": 1}


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\xff\xfe",
        "{}",
        "[]",
        '{"do":"fly"}',
        '{"do":"watch","every":[["a"]]}',
        '{"do":"watch","rate_hz":1e9}',
        '{"do":"ask","id":1,"probe":"a/b","command":"start"}',
        '{"do":"ask","id":1,"probe":"*","command":"start"}',
        '{"do":"ask","id":1,"probe":"a","command":"start?x"}',
        '{"do":"ask","id":1,"probe":"a","command":"rate","parameters":{"a":"1;b=2"}}',
        '{"do":"ask","id":1,"probe":"a","command":"start","more":1}',
        '{"do":"seen","n":"1"}',
        '{"do":' * 2000,
        '{"do":"read","id":1,"name":"a.mcap","offset":9223372036854775808}',
    ],
)
def test_a_message_that_is_none_of_the_pages_ends_the_connection(
    served: Served, message: bytes | str
) -> None:
    with served.live() as other, served.live() as browser:
        browser.send(message)
        served.until_refused("malformed")
        browser.until_closed()
        served.say(1)
        assert other.next("pose")["number"] == 1
    assert served.asked.all == []


def test_a_fault_of_ours_is_one_line_and_a_count_and_ends_one_browser(
    served: Served, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "imud")
    monkeypatch.setattr(server, "faults", serving.Faults())

    def fail(_: Any, __: Any) -> None:
        raise ArithmeticError("made up")

    with monkeypatch.context() as patched:
        patched.setattr(session.BrowserSession, "handle", fail)
        for count in (1, 2):
            with served.live() as browser:
                browser.say(do="logs", id=1)
                served.until_refused("fault", count)
                browser.until_closed()
    with served.live() as other:
        served.say(1)
        assert other.next("pose")["number"] == 1
    lines = [r.getMessage() for r in caplog.records]
    assert [line for line in lines if "ArithmeticError: made up" in line] == lines[:1]
    assert server.faults.count == 2


def test_an_oversized_message_ends_the_connection(served: Served) -> None:
    with served.live() as other, served.live() as browser:
        browser.send("x" * (MESSAGE_MAX + 1))
        served.until_refused("oversized")
        served.say(1)
        assert other.next("pose")["number"] == 1


@pytest.mark.parametrize(
    "data",
    [b"\0\1\2", b"GET / HTTP/1.1\r\nX: " + b"x" * 20_000, b"POST / HTTP/1.1\r\n\r\n"],
)
def test_what_is_no_request_is_refused(served: Served, data: bytes) -> None:
    host, _, port = served.host.partition(":")
    with socket.create_connection((host, int(port)), PATIENCE_S) as end:
        end.sendall(data + b"\r\n\r\n")
        with contextlib.suppress(ConnectionError):
            while end.recv(4096):
                pass
    served.until_refused("unreadable")
    assert served.get("/").status == 200


def test_a_connection_that_never_spoke_is_no_refusal(served: Served) -> None:
    # A browser may open one in advance.
    host, _, port = served.host.partition(":")
    address = host, int(port)
    socket.create_connection(address).close()
    with socket.create_connection(address) as other:
        other.sendall(b"\x00 no request\r\n\r\n")
        served.until_refused("unreadable")
    assert dict(served.page.refused) == {"unreadable": 1}


@pytest.mark.long
def test_very_many_connections_are_cut_off_at_the_limit(served: Served) -> None:
    count = length.choose(everyday=2 * connections.CONNECTIONS_MAX, long=1000)
    host, _, port = served.host.partition(":")
    with served.live() as browser, contextlib.ExitStack() as stack:
        for _ in range(count):
            # A refusal may come before the client knows that it is connected.
            with contextlib.suppress(ConnectionResetError):
                end = socket.create_connection((host, int(port)), PATIENCE_S)
                stack.callback(end.close)
        served.until_refused(
            "connections", max(1, count - 5 * connections.CONNECTIONS_MAX)
        )
        served.say(1)
        assert browser.next("pose")["number"] == 1
    until(lambda: _serves(served))


def _serves(served: Served) -> bool:
    with contextlib.suppress(OSError, http.client.HTTPException):
        return served.get("/").status == 200
    return False


def test_who_does_not_log_in_makes_room_and_is_closed_in_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "STRANGERS_OF_ONE", 8)
    users = TokenHolder("viewer")
    with contextlib.closing(Served(users).page) as page, contextlib.ExitStack() as many:
        url = page.url.replace("http", "ws") + "/live"
        silent = [many.enter_context(connect(url, origin=page.url)) for _ in range(20)]
        known = Live(many.enter_context(connect(url, origin=page.url)))
        known.say(do="login", user="", secret=users.token)
        while known.next("page")["role"] != "viewer":
            pass
        Live(silent[0]).until_closed()  # the oldest made room
        assert silent[-1].recv(PATIENCE_S)
        assert page.refused == {"connections": 13}
        monkeypatch.setattr(connections, "LOGIN_S", 0.1)
        late = many.enter_context(connect(url, origin=page.url))
        Live(late).until_closed()
        assert page.refused["silent"] == 1
        known.say(do="ask", id=1, probe="a", command="id")
        assert known.next("answer")["id"] == 1


def test_the_number_of_browsers_is_limited(served: Served) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(connections.BROWSERS_MAX):
            stack.enter_context(served.live())
        with pytest.raises(InvalidStatus) as refused, served.live():
            pass
        assert refused.value.response.status_code == 503
    assert served.page.refused == {"browsers": 1}
