# SPDX-License-Identifier: MIT
"""The judge of long runs notices what it is there for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from core.desk import lib
from hours.judge import SILENT_MAX_S, STACK_FREE_MIN, Judge
from imud.wire.frame import encode_frame
from imud.wire.messages import Message, decode
from twin_bench import Life, changed, followed, named, without

SUMMARY: dict[str, Any] = {
    "resets": 0,
    "crashed": False,
    "firmware_complaint": None,
    "sensor_complaint": None,
}


def contents_of(life: Life, stack_free: int = 300, uptime: int = 0) -> list[bytes]:
    """What it said; the fake board does not fill in its stack."""
    found = []
    for content in life.contents:
        message = decode(content)
        assert isinstance(message, Message)
        if message.name == "status":
            told = int(message.fields["uptime"]) + uptime  # type: ignore[call-overload]
            content = changed(content, stack_free=stack_free, uptime=told)
        found.append(content)
    return found


def silent(life: Life, seconds: float) -> Life:
    """No sample comes, and time goes by."""
    end_us = life.now_us + round(seconds * 1e6)
    while life.now_us < end_us:
        life.now_us = min(end_us, life.now_us + 500_000)
        lib.probe_step(life.c, False, life.time_us)
    return life


def judged(contents: Iterable[bytes], **summary: Any) -> Judge:
    judge = Judge()
    frames = [encode_frame(content) for content in contents]
    judge.take(b"\0" + b"".join(frames))
    judge.end(SUMMARY | {"frames": len(frames)} | summary)
    return judge


def test_a_good_run_has_no_problems_and_is_counted() -> None:
    life = followed().live(1000).order(lib.COMMAND_TARE, 0).miss(20).live(400)
    judge = judged(contents_of(life))
    assert judge.problems == []
    found = judge.part()
    assert (found["compared"], found["differed"]) == (found["poses"], 0)
    assert found["poses"] > 600
    assert found["raws"] == 1401
    assert found["stack_free"] == 300
    assert found["silent_s"] == 0.1


def test_the_clock_is_followed_through_its_wrap() -> None:
    life = followed().live(400)
    for _ in range(4):
        silent(life, 1200).live(300, has_gap=True)
    judge = judged(contents_of(life))
    assert judge.wraps == 1
    assert judge.device_us == pytest.approx(life.now_us, abs=1e6)
    assert not [text for text in judge.problems if "up for" in text]


def a_changed_pose(contents: list[bytes]) -> list[bytes]:
    at = named(contents, "pose")[100]
    return [
        *contents[:at],
        changed(contents[at], normal=(0.0, 0.0, 1.0)),
        *contents[at + 1 :],
    ]


@pytest.mark.parametrize(
    ("spoilt", "problem"),
    [
        (a_changed_pose, "the twin: TwinDiffers"),
        (lambda contents: without(contents, 700), "of those dropped: 1, expected 0"),
        (lambda contents: [*contents, contents[-1]], "duplicated messages: 1"),
    ],
)
def test_messages_that_are_not_what_was_sent_are_a_problem(
    spoilt: Callable[[list[bytes]], list[bytes]], problem: str
) -> None:
    judge = judged(spoilt(contents_of(followed().live(1000))))
    assert any(problem in text for text in judge.problems)


def test_a_silence_is_a_problem_and_so_is_a_stack_without_room() -> None:
    for seconds, problems in ((SILENT_MAX_S - 1, 0), (SILENT_MAX_S + 1, 1)):
        life = silent(followed().live(400), seconds).live(1, has_gap=True)
        judge = judged(contents_of(life))
        assert len(judge.problems) == problems
    assert "no sample for 10.0 s" in judge.problems[0]
    life = contents_of(followed().live(400), stack_free=STACK_FREE_MIN - 1)
    assert "the stack has left 63 bytes" in judged(life).problems[0]


def test_a_clock_that_is_not_the_uptime_is_a_problem() -> None:
    judge = judged(contents_of(followed().live(400), uptime=4295))
    assert "up for 42" in judge.problems[0]


def test_a_restart_is_a_problem() -> None:
    life = followed().live(400)
    again = followed(life.memory).live(400)
    judge = judged(contents_of(life) + contents_of(again))
    assert any("it restarted" in text for text in judge.problems)
    assert any("boots: 2" in text for text in judge.problems)


@pytest.mark.parametrize(
    ("name", "value"),
    [("resets", 1), ("crashed", True), ("sensor_complaint", "read too early")],
)
def test_what_the_emulator_saw_is_a_problem(name: str, value: object) -> None:
    contents = contents_of(followed().live(400))
    judge = judged(contents, **{name: value})
    assert any(f": {value}, expected" in text for text in judge.problems)
    judge = judged(contents, frames=len(contents) + 1)
    assert any("of those that left the UART" in text for text in judge.problems)


def test_a_twin_that_waits_for_longer_than_a_restart_takes_is_a_problem() -> None:
    life = followed().live(400).order(lib.COMMAND_STOP).order(lib.COMMAND_START)
    assert judged(contents_of(life.live(400))).problems == []
    judge = judged(contents_of(life.live(400)))
    (problem,) = judge.problems
    assert "the twin is waiting, not following" in problem


def test_a_message_that_the_probe_counts_as_dropped_may_be_missing() -> None:
    contents = contents_of(followed().live(1000))
    statuses = named(contents, "status")
    for dropped, words in ((1, "a message is missing"), (2, "1, expected 2")):
        for at in statuses:
            contents[at] = changed(contents[at], messages_dropped=dropped)
        judge = judged(without(contents, 700))
        # The twin can't know what it was.
        assert len(judge.problems) == (1 if dropped == 1 else 4)
        assert any(words in text for text in judge.problems)
