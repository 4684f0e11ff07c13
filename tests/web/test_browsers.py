# SPDX-License-Identifier: MIT
"""The data and permissions of browsers: coalesced poses, commands, roles."""

from __future__ import annotations

import base64
import contextlib
from pathlib import Path
from typing import Any

from imud.commands import COMMANDS
from imud.config.settings import Config, ZenohSettings
from imud.net import keys
from imud.net.access import who_may
from imud.net.network import read_credentials, read_keys
from imud.roles import Role
from imud.web.browser import HEARTBEAT_S, WAITING_MAX, WINDOW
from imud.web.logs import LogFolder
from imud.web.server import Page
from imud.web.session import ASKS_MAX, LOGINS_MAX
from imud.web.users import KeyUsers, TokenHolder
from streaming import until
from web.served import WRONG, Served


def test_a_browser_gets_the_last_of_each_topic_and_then_what_comes(
    served: Served,
) -> None:
    for topic in ("pose", "status", "raw"):
        served.say(7, topic)
    with served.live() as browser:
        kinds = [line["type"] for line in browser.message()]
        while "status" not in kinds:
            kinds += [line["type"] for line in browser.message()]
        assert sorted(kinds) == ["page", "pose", "status"]
        served.say(8)
        assert browser.next("pose")["number"] == 8


def test_poses_are_coalesced_unless_all_are_asked_for(served: Served) -> None:
    with served.live() as latest, served.live() as every:
        every.say(do="watch", every=[["stylus", "pose"]], rate_hz=20)
        latest.say(do="watch", rate_hz=20)
        for browser in (latest, every):
            browser.say(do="ask", id=1, probe="stylus", command="start")
            browser.next("answer")
        for number in range(1, 101):
            served.say(number)
        got = [latest.next("pose")["number"]]
        while got[-1] < 100:
            got.append(latest.next("pose")["number"])
        assert len(got) < 20
        assert [every.next("pose")["number"] for _ in range(100)] == [*range(1, 101)]


def test_a_stopped_browser_is_sent_nothing_more_and_nobody_else_notices(
    served: Served,
) -> None:
    last = WAITING_MAX + 300
    with served.live() as stopped, served.live() as other:
        stopped.say(do="watch", every=[["stylus", "pose"]], rate_hz=240)
        stopped.say(do="ask", id=1, probe="stylus", command="start")
        until(lambda: served.asked.all)
        for number in range(last + 1):
            served.say(number)
            if number % 20 == 0:
                while other.next("pose")["number"] < number:
                    pass
        heads = []
        with contextlib.suppress(TimeoutError):
            while True:
                stopped.message(3 * HEARTBEAT_S)
                heads.append(stopped.head["n"])
        assert heads == [*range(1, WINDOW + 1)]
        stopped.say(do="seen", n=WINDOW)
        poses = [line["number"] for line in stopped.message() if line["type"] == "pose"]
        assert len(poses) == WAITING_MAX
        assert poses[-1] == last
        assert stopped.head["left_out"] > 0


def test_a_command_is_answered_and_a_refusal_has_its_reason(served: Served) -> None:
    rate = {"stream": "pose", "hz": "50"}
    with served.live() as browser:
        browser.say(do="ask", id=5, probe="stylus", command="rate", parameters=rate)
        answer = browser.next("answer")
        assert (answer["id"], answer["error"], answer["answer"]) == (
            5,
            "",
            {"ok": True},
        )
        browser.say(do="ask", id=6, probe="stylus", command="fly")
        assert browser.next("answer")["error"] == "probes can't fly"
    assert served.asked.all[0] == ("stylus", "rate", rate)


def test_a_browser_may_not_ask_too_much_at_once() -> None:
    served = Served()
    served.page.close()
    waiting: list[Any] = []
    page = Page(("127.0.0.1", 0), lambda *asked: waiting.append(asked[3]))
    page.start()
    served.page, served.host = page, page.url.removeprefix("http://")
    with contextlib.closing(page), served.live() as browser:
        for number in range(ASKS_MAX + 1):
            browser.say(do="ask", id=number, probe="stylus", command="start")
        answer = browser.next("answer")
        assert (answer["id"], answer["error"]) == (
            ASKS_MAX,
            "too many commands at once",
        )
        waiting[0](b"1", "")
        assert browser.next("answer")["id"] == 0


def test_a_viewer_reads_but_does_not_command() -> None:
    users = TokenHolder("viewer")
    with Served(users) as served, served.live() as browser:
        served.say(1)
        assert browser.next("page")["reads"] == []
        browser.say(do="login", user="", secret=WRONG)
        assert browser.next("login")["error"]
        browser.say(do="login", user="", secret=users.token)
        message = browser.next("page")
        assert (message["role"], message["commands"]) == ("viewer", False)
        assert message["reads"] == [
            "aim",
            "body",
            "mark",
            "marks",
            "params",
            "path",
            "pose",
            "status",
            "stroke",
        ]
        assert browser.next("pose")["number"] == 1
        browser.say(do="watch", every=[["stylus", "raw"]])
        browser.say(do="ask", id=1, probe="stylus", command="start")
        assert "role" in browser.next("answer")["error"]
        for topic in ("raw", "event", "pose"):
            served.say(2, topic)
        kinds = {line["type"] for _ in range(2) for line in browser.message()}
        assert kinds == {"pose"}
    assert served.asked.all == []
    assert served.page.refused == {"login": 1, "role": 1}


def test_who_guesses_passwords_is_sent_away() -> None:
    with Served(TokenHolder("operator")) as served, served.live() as browser:
        for _ in range(LOGINS_MAX):
            browser.say(do="login", user="", secret=WRONG)
        browser.until_closed()
    assert served.page.refused["login"] == LOGINS_MAX


def test_users_of_imud_keys_have_their_roles_on_the_page(tmp_path: Path) -> None:
    keys.initialise(tmp_path / "keys", [], 7447)
    settings = ZenohSettings(keys=str(tmp_path / "keys"))
    held = read_keys(Config(zenoh=settings))
    users = KeyUsers(held.roles, held.passwords)
    for name in ("viewer", "operator", "recorder"):
        mine = read_credentials(tmp_path / "keys" / "clients" / f"{name}.toml")
        grant = users.log_in(name, mine.password)
        assert grant.role == name
        assert grant.commands == frozenset(COMMANDS if name == "operator" else ())
        assert ("raw" in grant.reads) == (name in who_may("raw"))
        assert users.log_in("viewer", mine.password + "x") is None
    assert users.log_in("nobody", "") is None
    assert users.at_first().reads == frozenset()


def test_logs_are_listed_and_read_and_nothing_else_is(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    content = bytes(range(256)) * 1000
    (tmp_path / "logs" / "a.mcap").write_bytes(content)
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    with Served(logs=LogFolder(tmp_path / "logs")) as served, served.live() as browser:
        assert browser.next("page")["logs"]
        browser.say(do="logs", id=1)
        (file,) = browser.next("answer")["answer"]
        assert (file["name"], file["bytes"]) == ("a.mcap", len(content))
        come = b""
        while len(come) < len(content):
            browser.say(do="read", id=2, name="a.mcap", offset=len(come))
            come += base64.b64decode(browser.next("answer")["answer"])
        assert come == content
        for name in ("b.mcap", "..", "secret.mcap"):
            browser.say(do="read", id=3, name=name, offset=0)
            assert browser.next("answer")["error"] == "there is no such log"
        browser.say(do="read", id=4, name="../secret.mcap", offset=0)
        browser.until_closed()
    assert served.page.refused == {"malformed": 1}


def test_logs_are_for_who_may_read_every_message(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"x")
    cases: tuple[tuple[Role, bool], ...] = (
        ("viewer", False),
        ("operator", False),
        ("recorder", True),
    )
    for role, is_allowed in cases:
        users = TokenHolder(role)
        with Served(users, LogFolder(tmp_path)) as served, served.live() as browser:
            browser.say(do="login", user="", secret=users.token)
            browser.say(do="logs", id=1)
            answer = browser.next("answer")
            assert bool(answer["answer"]) == is_allowed
            assert served.page.refused["role"] == (not is_allowed)
