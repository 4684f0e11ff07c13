# SPDX-License-Identifier: MIT
"""A log played for one browser, in the place of what is live."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest

import log_files
from imud.web.logs import LogFolder
from imud.web.player import Pace
from imud.web.playing import PLAYERS_MAX
from imud.web.users import TokenHolder
from web.served import Served

COUNT = 200  # messages in 2 s


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return log_files.write(tmp_path, log_files.records(COUNT))


def test_messages_are_due_as_they_came_at_any_speed() -> None:
    pace = Pace(2.0, 0.0)
    assert pace.wait_s(5_000_000_000, 100.0) == 0.0
    assert pace.wait_s(9_000_000_000, 100.0) == 2.0
    pace.change(0.5, 9_000_000_000, 102.0)
    assert pace.wait_s(10_000_000_000, 102.0) == 2.0
    pace.change(0.0, 10_000_000_000, 104.0)
    assert pace.wait_s(10_000_000_000, 1000.0) > 0.0
    pace.change(100.0, 10_000_000_000, 1000.0)
    assert pace.wait_s(11_000_000_000, 1000.0) == pytest.approx(0.01)


def test_a_played_log_says_what_was_published(log: Path) -> None:
    served = Served(logs=LogFolder(log.parent))
    said = [r.payload for r in log_files.records(COUNT) if r.topic == "pose"]
    with contextlib.closing(served.page), served.live() as browser, served.live() as o:
        browser.say(do="watch", every=[["left", "pose"]], rate_hz=60)
        browser.say(do="play", id=1, name=log.name, speed=0.1)
        while browser.next("page")["playing"] != log.name:
            pass
        assert browser.next("pose") == json.loads(said[0])
        browser.say(do="play", id=2, name=log.name, speed=100)
        lines: list[dict[str, Any]] = []
        while not any(line.get("over") for line in lines):
            lines += browser.message()
            browser.say(do="seen", n=browser.head["n"])
        # Of a log that is played fast some are left out, and never the last.
        poses = [line for line in lines if line["type"] == "pose"]
        assert poses[-1] == json.loads(said[-1])
        assert all(json.dumps(p, separators=(",", ":")).encode() in said for p in poses)
        numbers = [pose["number"] for pose in poses]
        assert numbers == sorted({*numbers})
        served.say(7)  # live
        assert o.next("pose")["number"] == 7
        browser.say(do="live")
        assert browser.next("page")["playing"] is None
        assert browser.next("pose")["number"] == 7


def test_what_is_no_log_is_not_played(log: Path) -> None:
    served = Served(logs=LogFolder(log.parent))
    with contextlib.closing(served.page), served.live() as browser:
        browser.say(do="play", id=1, name="other.mcap")
        assert browser.next("answer")["error"] == "there is no such log"


def test_an_operator_plays_no_log(log: Path) -> None:
    users = TokenHolder("operator")
    served = Served(users, LogFolder(log.parent))
    with contextlib.closing(served.page), served.live() as browser:
        browser.say(do="login", user="", secret=users.token)
        browser.say(do="play", id=1, name=log.name)
        assert browser.next("answer")["error"] == "there are no logs for your role"
        assert served.page.refused == {"role": 1}


def test_only_so_many_logs_are_played_at_a_time(log: Path) -> None:
    served = Served(logs=LogFolder(log.parent))
    with contextlib.closing(served.page), contextlib.ExitStack() as stack:
        for _ in range(PLAYERS_MAX):
            browser = stack.enter_context(served.live())
            browser.say(do="play", id=1, name=log.name, speed=0)
            assert browser.next("answer")["error"] == ""
        last = stack.enter_context(served.live())
        last.say(do="play", id=1, name=log.name)
        assert last.next("answer")["error"] == "too many logs are being played"
