# SPDX-License-Identifier: MIT
"""A log played for one browser, in the place of what is live."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import pytest

import log_files
from imud.log.reader import Logged
from imud.log.seekable import SeekableLog
from imud.web import playing, processes
from imud.web.logs import LogFolder
from imud.web.player import PAYLOAD_MAX, Schedule, line_of
from imud.web.playing import PLAYERS_MAX
from imud.web.users import TokenHolder
from streaming import until
from web.served import Live, Served

COUNT = 200  # messages in 2 s


@pytest.fixture
def log(tmp_path: Path) -> Path:
    # A chunk for each tenth of a second, as the daemon writes them.
    made = log_files.records(COUNT)
    batches = [made[place : place + 10] for place in range(0, COUNT, 10)]
    return log_files.write(tmp_path, *batches)


def test_messages_are_due_as_they_came_at_any_speed() -> None:
    pace = Schedule(2.0, 0.0)
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
    published = [r.payload for r in log_files.records(COUNT) if r.topic == "pose"]
    with served, served.live() as browser, served.live() as o:
        browser.say(do="watch", every=[["left", "pose"]], rate_hz=60)
        browser.say(do="play", id=1, name=log.name, speed=0.1)
        while browser.next("page")["playing"] != log.name:
            pass
        assert browser.next("pose") == json.loads(published[0])
        browser.say(do="play", id=2, name=log.name, speed=100)
        lines: list[dict[str, Any]] = []
        while not any(line.get("over") for line in lines):
            lines += browser.message()
            browser.say(do="seen", n=browser.head["n"])
        # Of a log that is played fast some are left out, and never the last.
        poses = [line for line in lines if line["type"] == "pose"]
        assert poses[-1] == json.loads(published[-1])
        assert all(
            json.dumps(p, separators=(",", ":")).encode() in published for p in poses
        )
        numbers = [pose["number"] for pose in poses]
        assert numbers == sorted({*numbers})
        served.say(7)  # live
        assert o.next("pose")["number"] == 7
        browser.say(do="live")
        assert browser.next("page")["playing"] is None
        assert browser.next("pose")["number"] == 7


@pytest.mark.parametrize(
    ("payload", "line"),
    [
        (b'{"type":"pose","probe":"a"}', b'{"type":"pose","probe":"a"}'),
        (b'{"type":"pose",\n"probe":"a"}', b'{"type":"pose","probe":"a"}'),
        (b'{}\na\tstatus\t{"type":"status","probe":"b"}', None),
        (b'{"type":"pose","probe":"b"}', None),
        (b'{"type":"page","probe":"a"}', None),
        (b'{"type":"pose","probe":5}', None),
        (b'{"type":"pose","probe":"a","t":NaN}', None),
        (b"[" * 100_000, None),
        (b"\xff", None),
        (b"", None),
        (b'{"type":"pose","probe":"a","x":"%s"}' % (b"x" * PAYLOAD_MAX), None),
    ],
)
def test_a_log_speaks_for_its_own_probe_and_topic_in_one_line(
    payload: bytes, line: bytes | None
) -> None:
    assert line_of("a", "pose", payload) == line


def test_a_player_that_ends_is_told_with_its_reason(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(playing, "SEEK", b"no number ")
    with Served(logs=LogFolder(log.parent)) as served, served.live() as browser:
        browser.say(do="play", id=1, name=log.name, speed=0)
        browser.say(do="seek", id=2, t_ms=5)
        while not (played := browser.next("played"))["over"]:
            pass
        assert "could not convert string to float" in played["error"]


def test_who_leaves_while_a_player_ends_leaves_no_process() -> None:
    async def leave() -> int | None:
        process = await processes.start("imud.web.player", "no log", "1")
        ending = asyncio.create_task(processes.end(process))
        await asyncio.sleep(0)  # it has begun
        ending.cancel()
        await asyncio.wait([ending])
        return process.returncode

    assert asyncio.run(leave()) is not None


def played_to(browser: Live, t_ms: float) -> list[dict[str, Any]]:
    """What is played until it is at that time."""
    lines: list[dict[str, Any]] = []
    while not any(
        line["type"] == "played" and abs(line["t_ms"] - t_ms) < 1 for line in lines
    ):
        lines += browser.message()
        browser.say(do="seen", n=browser.head["n"])
    return lines


def test_a_log_goes_to_any_of_its_times(log: Path) -> None:
    served = Served(logs=LogFolder(log.parent))
    poses = [r for r in log_files.records(COUNT) if r.topic == "pose"]
    first_ms = log_files.records(1)[0].t_received_ns / 1e6
    with served, served.live() as browser:
        browser.say(do="watch", every=[], rate_hz=60)
        browser.say(do="seek", id=1, t_ms=first_ms)
        assert browser.next("answer")["error"] == "no log is being played"
        browser.say(do="play", id=2, name=log.name, speed=0)
        # From the end back and forth again, while it stands still: what is shown is the
        # last pose before that time.
        for number in (120, 7, 55):
            wanted = poses[number]
            browser.say(do="seek", id=3, t_ms=wanted.t_received_ns / 1e6 + 1)
            lines = played_to(browser, wanted.t_received_ns / 1e6 + 1)
            shown = [line for line in lines if line["type"] == "pose"]
            assert shown[-1] == json.loads(wanted.payload)
            state = [line for line in lines if line["type"] == "played"][-1]
            assert abs(state["first_ms"] - first_ms) < 1
            assert state["last_ms"] >= poses[-1].t_received_ns / 1e6
            assert not state["over"]
        browser.say(do="seek", id=4, t_ms=state["last_ms"] + 5000)
        assert browser.next("pose") == json.loads(poses[-1].payload)
        browser.say(do="play", id=5, name=log.name, speed=100)
        browser.say(do="seek", id=6, t_ms=poses[3].t_received_ns / 1e6)
        while not browser.next("played")["over"]:
            pass


def test_the_end_of_a_log_that_is_still_written_stays_in_reach(log: Path) -> None:
    served = Served(logs=LogFolder(log.parent))
    poses = [r for r in log_files.records(COUNT) if r.topic == "pose"]
    whole, half = log.read_bytes(), SeekableLog(log).spans[10].at
    log.write_bytes(whole[:half])
    with served, served.live() as browser:
        browser.say(do="watch", every=[], rate_hz=60)
        browser.say(do="play", id=1, name=log.name, speed=0)
        browser.next("played")
        with log.open("ab") as file:
            file.write(whole[half:])
        browser.say(do="play", id=2, name=log.name, speed=100)
        early_ms = poses[3].t_received_ns / 1e6
        browser.say(do="seek", id=3, t_ms=early_ms)
        end_ms = poses[-1].t_received_ns / 1e6
        while not (state := browser.next("played"))["over"] or state["t_ms"] < end_ms:
            pass
        browser.say(do="play", id=4, name=log.name, speed=0)
        browser.say(do="seek", id=5, t_ms=early_ms)
        state = [x for x in played_to(browser, early_ms) if x["type"] == "played"][-1]
        assert state["last_ms"] >= end_ms
        browser.say(do="seek", id=6, t_ms=state["last_ms"])
        assert browser.next("pose") == json.loads(poses[-1].payload)


def test_a_log_without_its_end_can_be_read_from_anywhere(log: Path) -> None:
    whole = SeekableLog(log)
    everything = [each for each in whole.read() if isinstance(each, Logged)]
    middle_ns = everything[len(everything) // 2].t_ns
    span = next(each for each in whole.spans if each.last_ns >= middle_ns)
    wanted = [each for each in everything if each.t_ns >= span.first_ns]
    cut = log.with_name("cut.mcap")
    cut.write_bytes(log.read_bytes()[: whole.spans[-1].at])
    for path, count in ((log, len(wanted)), (cut, None)):
        found = SeekableLog(path)
        read = [each for each in found.read(middle_ns) if isinstance(each, Logged)]
        assert read == wanted[: count or len(read)]
        assert read
        assert found.times_ns[0] == whole.times_ns[0]
        assert [*found.read(whole.times_ns[1] + 1)][:0] == []


def test_what_is_no_log_is_not_played(log: Path) -> None:
    with Served(logs=LogFolder(log.parent)) as served, served.live() as browser:
        browser.say(do="play", id=1, name="other.mcap")
        assert browser.next("answer")["error"] == "there is no such log"


def test_the_tables_of_a_log_are_there_until_the_browser_leaves(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = tmp_path / "tables"
    tables.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tables))
    (log.parent / "no.mcap").write_bytes(b"no log")
    served = Served(logs=LogFolder(log.parent))
    with contextlib.closing(served.page), served.live() as browser:
        browser.say(do="export", id=1, name="no.mcap")
        assert "no.mcap" in browser.next("answer")["error"]
        browser.say(do="export", id=2, name=log.name)
        browser.say(do="export", id=3, name=log.name)
        assert "are being made" in browser.next("answer")["error"]
        made = browser.next("answer")["answer"]
        browser.say(do="read", id=4, name=made["name"], offset=0)
        data = base64.b64decode(browser.next("answer")["answer"])
        assert len(data) == made["bytes"]
        with zipfile.ZipFile(io.BytesIO(data)) as found:
            (poses,) = (name for name in found.namelist() if "-pose" in name)
            published = [r for r in log_files.records(COUNT) if r.topic == "pose"]
            assert len(found.read(poses).splitlines()) == 1 + len(published)
        browser.say(do="export", id=5, name=log.name)
    until(lambda: not [*tables.iterdir()])


def test_an_operator_plays_no_log(log: Path) -> None:
    users = TokenHolder("operator")
    with Served(users, LogFolder(log.parent)) as served, served.live() as browser:
        browser.say(do="login", user="", secret=users.token)
        browser.say(do="play", id=1, name=log.name)
        assert browser.next("answer")["error"] == "your role may not read logs"
        browser.say(do="export", id=2, name=log.name)
        assert browser.next("answer")["error"] == "your role may not read logs"
        assert served.page.refused == {"role": 2}


def test_only_so_many_logs_are_played_at_a_time(log: Path) -> None:
    with Served(logs=LogFolder(log.parent)) as served, contextlib.ExitStack() as stack:
        for _ in range(PLAYERS_MAX):
            browser = stack.enter_context(served.live())
            browser.say(do="play", id=1, name=log.name, speed=0)
            assert browser.next("answer")["error"] == ""
        last = stack.enter_context(served.live())
        last.say(do="play", id=1, name=log.name)
        assert last.next("answer")["error"] == "too many logs are being played"
