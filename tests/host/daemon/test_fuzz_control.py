# SPDX-License-Identifier: MIT
"""Any query, key or payload from the network gets an error line or no answer, never an
internal error. Poses continue meanwhile.
"""

from __future__ import annotations

import contextlib
import json
import queue
import random
import string
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st

from chain import Chain
from configured import bare_session
from fakes import (
    PATIENCE_S,
    SOON_S,
    assert_honest,
)
from imud.daemon.commands import arguments_of
from imud.errors import CommandRefused
from imud.wire import messages, schema
from streaming import Streaming

SEED = 20_260_102

# Known words of the control path, so that a guess is often nearly right.
COMMANDS = [command.name.lower() for command in schema.Command]
NAMES = ["stream", "streams", "hz", "what", "filter", "a", "", " hz", "HZ"]
VALUES = [
    *("pose", "raw", "pose,raw", "all", "undo", "heading", "fuse", "none", "", ","),
    *("0", "1", "50", "1000", "-1", "65536", "4294967296", "1e3", "0x10", "1.5"),
    *("١٢", "²", "1_0", "+5", " 5", "nan", "inf", "9" * 5000, "true", "null"),
]

SIGNS = string.printable + "äß€\x00\x1b\x7f\u202e\u2028😀"


_WORDS = st.text(st.characters(exclude_characters="/*$#?", codec="utf-8"), min_size=1)
_NAMES = st.sampled_from(["stream", "hz", "what", "streams", "filter"]) | _WORDS

_NUMBERS = st.integers(-(2**70), 2**70).map(str) | st.just("9" * 5000)
_VALUES = st.sampled_from(["pose", "raw", "all", "undo", "fuse", "pose,raw", ""])
_PARAMETERS = st.dictionaries(_NAMES, _VALUES | _NUMBERS | st.text(max_size=20))
_ORDERS = st.sampled_from(["rate", "fields", "tare", "restart", "start"])


@given(_ORDERS, _PARAMETERS)
@example("rate", {"stream": "pose", "hz": str(2**40)})
@example("rate", {"stream": "pose", "hz": "-1"})
def test_no_parameters_are_a_fault(command: str, parameters: dict[str, str]) -> None:
    try:
        arguments = arguments_of(command, parameters)
    except CommandRefused as error:
        assert str(error)
        return
    fields = {"command": command, "token": 1, "arguments": arguments}
    # What no field holds is refused as the daemon refuses it.
    with contextlib.suppress(ValueError):
        messages.encode("command", fields, 1, 1)


class Room(Chain):
    """A daemon with a probe that streams and answers, and a session of an intruder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.heard: queue.Queue[int] = queue.Queue()
        self.client.subscribe(
            "pose", None, lambda _, data: self.heard.put(json.loads(data)["seq"])
        )
        self.sent: list[int] = []
        self._stream = Streaming(self.port, self.probe, say=self._said)
        self.heard.get()  # the daemon knows of the subscriber
        self._bare = bare_session(self.daemon)
        self.session = self._bare.__enter__()

    def _said(self) -> bytes:
        answers = self.port.answers(self.probe)
        self.sent.append(self.probe.sequence)
        is_due = self.probe.sequence % 200 == 0
        return answers + self.probe.say("hello" if is_due else "pose")

    def ask(self, selector: str, payload: bytes) -> list[zenoh.Reply] | None:
        """All answers; None for what is no selector: the library refuses that."""
        try:
            asked = self.session.get(selector, payload=payload, timeout=PATIENCE_S)
        except (zenoh.ZError, ValueError):
            return None
        return list(asked)

    def stop_stream(self) -> None:
        self._stream.stop()

    def close(self) -> None:
        self.stop_stream()
        self._bare.__exit__(None, None, None)
        super().close()


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    made = Room(tmp_path_factory.mktemp("room"))
    yield made
    made.close()


def text(chance: random.Random, most: int = 12) -> str:
    return "".join(chance.choices(SIGNS, k=chance.randint(0, most)))


def parameters(chance: random.Random) -> str:
    """Pairs that are nearly right, or no pairs at all."""
    if chance.random() < 0.1:
        return text(chance, 40)
    if chance.random() < 0.02:
        return ";".join(f"p{n}={n}" for n in range(5000))
    pairs = []
    for _ in range(chance.randint(0, 3)):
        name = chance.choice([*NAMES, text(chance)])
        value = chance.choice([*VALUES, text(chance)])
        pairs.append(f"{name}{chance.choice(['=', '=', '=', '==', '', '?'])}{value}")
    return chance.choice([";", ";", ";;", "&"]).join(pairs)


def test_queries_are_answered_or_refused_and_poses_go_on(room: Room) -> None:
    chance = random.Random(SEED)  # noqa: S311 - no secret
    answered = refused = 0
    for _ in range(600):
        command = chance.choice([*COMMANDS, *COMMANDS, text(chance), "*", "**", "cmd"])
        probe = chance.choice([room.probe.name] * 4 + ["*", "nobody", text(chance)])
        payload = chance.choice([b"", b"\xff\xfe\x00", chance.randbytes(300)])
        if chance.random() < 0.01:
            payload = bytes(1_000_000)
        query = parameters(chance)
        selector = f"imud/{probe}/cmd/{command}" + (f"?{query}" if query else "")
        replies = room.ask(selector, payload)
        for reply in replies or []:
            if reply.ok is not None:
                answer = json.loads(reply.ok.payload.to_bytes())
                assert answer["ok"], selector
                answered += 1
            else:
                line = reply.err.payload.to_string()
                assert line, selector
                assert line.isprintable(), line
                assert len(line) < 500, line
                refused += 1
        if probe == room.probe.name and command in COMMANDS and replies is not None:
            assert replies, selector
    assert answered > 50
    assert refused > 50
    for command in room.probe.commands:
        first, second = command["arguments"]
        assert command["command"] in COMMANDS
        assert 0 <= first < 1 << 32
        assert 0 <= second <= 65_535


def test_other_keys_and_puts_are_ignored_and_told_seldom(room: Room) -> None:
    chance = random.Random(SEED + 1)  # noqa: S311 - no secret
    before = len(room.probe.commands)
    keys = [f"imud/{room.probe.name}/cmd/{command}" for command in COMMANDS]
    keys += [f"imud/{room.probe.name}/{topic}" for topic in ("status", "alive", "x")]
    keys += ["imud", "imud/cmd/start", f"imud/{room.probe.name}", "a/b/c"]
    forged = f"imud/{room.probe.name}/x\n00:00:00 warning: forged\x1b[31m\u202e"
    room.session.put(forged, b"")
    room.daemon.expect(
        r"another program also publishes on .*/x\?00:00:00 warning: forged\?\[31m\?"
    )
    for _ in range(400):
        key = chance.choice([*keys, f"imud/{room.probe.name}/{text(chance)}"])
        try:
            if chance.random() < 0.3:
                room.session.delete(key)
            else:
                room.session.put(key, chance.randbytes(chance.randint(0, 2000)))
        except (zenoh.ZError, ValueError):
            continue
    for key in ("imud/nobody/cmd/start", "imud/cmd/start", "imud/x/y/z"):
        assert room.ask(key, b"") == []
    assert len(room.probe.commands) == before


def test_nothing_was_lost_and_nothing_was_a_fault(room: Room) -> None:
    """After the tests above."""
    room.stop_stream()
    seen: list[int] = []
    hellos = {n for n in room.sent if n % 200 == 0}
    while not seen or seen[-1] < max(set(room.sent) - hellos):
        seen.append(room.heard.get())
    assert set(room.sent) - hellos >= set(seen)
    expected = [n for n in room.sent if n not in hellos and n >= seen[0]]
    assert seen == expected
    ledger: dict[str, object] = {}
    while ledger.get("received") != room.probe.sequence:
        (status,) = room.client.statuses(room.probe.name)
        ledger = status["ledger"]
    assert ledger["lost"] == 0
    assert ledger["adds_up"], ledger
    assert room.daemon.stop() < SOON_S
    assert_honest(room.daemon)
    # However many keys a client invents.
    assert (
        sum("another program also publishes on" in line for line in room.daemon.lines)
        <= 6
    )
