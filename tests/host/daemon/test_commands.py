# SPDX-License-Identifier: MIT
"""Commands on their way to a probe, and those that its settings become."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

import reference
from chain import Chain
from fakes import FakeProbe
from imud.config.settings import Config, ProbeSettings
from imud.daemon.commands import Commander, arguments_of, orders_of
from imud.daemon.registry import Registry
from imud.errors import CommandRefused, ProbeUnknown
from imud.wire import messages
from imud.wire.messages import Message


@pytest.mark.parametrize(
    ("name", "arguments", "numbers"),
    [
        ("start", {}, (0, 0)),
        ("stop", {}, (0, 0)),
        ("tare", {}, (0, 0)),
        ("tare", {"what": "heading"}, (1, 0)),
        ("tare", {"what": "undo"}, (2, 0)),
        ("rate", {"stream": "raw", "hz": "200"}, (1, 200)),
        ("fields", {"streams": "pose,raw"}, (3, 0)),
        ("hello", {}, (0, 0)),
        ("reset", {}, (0, 0)),
        ("restart", {}, (0, 0)),
        ("restart", {"filter": "madgwick"}, (4, 0)),
        ("restart", {"forget": "1"}, (0, 1)),
        ("restart", {"filter": "mahony", "forget": "0"}, (3, 0)),
    ],
)
def test_commands_become_two_numbers(
    name: str, arguments: dict[str, str], numbers: tuple[int, int]
) -> None:
    assert arguments_of(name, arguments) == numbers


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("start", {"fast": "1"}, "start has no parameter fast"),
        ("tare", {"what": "all of it"}, "tare needs what=all, heading or undo"),
        ("rate", {"stream": "pose"}, "rate needs stream"),
        ("rate", {"stream": "pose", "hz": "fast"}, "rate needs stream"),
        ("fields", {"streams": "mag"}, "fields needs streams"),
        ("restart", {"filter": "none"}, "restart needs filter=fuse, complementary"),
        ("restart", {"forget": "2"}, "restart needs filter=fuse, complementary"),
        ("restart", {"with": "fuse"}, "restart has no parameter with"),
    ],
)
def test_commands_that_make_no_sense_are_refused(
    name: str, arguments: dict[str, str], words: str
) -> None:
    with pytest.raises(CommandRefused, match=words):
        arguments_of(name, arguments)


def test_a_command_reaches_the_probe_and_its_answer_comes_back(chain: Chain) -> None:
    answer = chain.command("tare", what="heading")
    assert answer == {
        "ok": True,
        "probe": chain.probe.name,
        "command": "tare",
        "value": [1, 0],
    }
    assert chain.probe.commands[-1]["arguments"] == (1, 0)


def test_a_refusal_says_why(chain: Chain) -> None:
    chain.probe.results["start"] = "not_ready"
    with pytest.raises(CommandRefused, match="refused start: not ready"):
        chain.command("start")
    with pytest.raises(
        CommandRefused, match="no command 'dance', only aim, capture, close, configure"
    ):
        chain.client.command(chain.probe.name, "dance")
    with pytest.raises(CommandRefused, match="arguments can't be"):
        chain.client.command(chain.probe.name, "rate", stream="pose", hz="99999999999")
    with pytest.raises(ProbeUnknown, match="no probe stylus; choose one"):
        chain.client.command("stylus", "start")


def orders(data: bytes) -> list[Message]:
    """Commands among what the daemon wrote, but for questions for the time."""
    decoded = [messages.decode(content) for content in reference.contents(data)]
    assert all(isinstance(each, Message) for each in decoded)
    return [
        each
        for each in decoded
        if isinstance(each, Message) and each.fields["command"] != "time"
    ]


def test_a_command_is_repeated_with_its_token_and_carried_out_once(
    chain: Chain,
) -> None:
    heard: list[Message] = []

    def be_deaf_once() -> None:
        while len(heard) < 2:
            data = chain.port.read()
            reply = chain.probe.hear(data)
            heard.extend(orders(data))
        chain.port.write(reply)

    server = threading.Thread(target=be_deaf_once)
    server.start()
    answer = chain.client.command(chain.probe.name, "start")
    server.join()
    assert answer["ok"]
    assert [c["command"] for c in chain.probe.commands] == ["start"]
    assert len({order.fields["token"] for order in heard}) == 1


def test_a_probe_that_does_not_answer_is_an_error_after_three_tries(
    chain: Chain,
) -> None:
    with pytest.raises(CommandRefused, match="did not answer stop, 3 times"):
        chain.client.command(chain.probe.name, "stop")
    asked = [order.fields["command"] for order in orders(chain.port.read())]
    assert asked == ["stop"] * 3


@pytest.mark.parametrize(
    ("settings", "orders"),
    [
        ({}, []),
        ({"pose_rate": 100, "raw_rate": 0}, []),  # as its hello says
        ({"pose_rate": 50}, [("rate", {"stream": "pose", "hz": "50"})]),
        ({"raw_rate": 200}, [("rate", {"stream": "raw", "hz": "200"})]),
        ({"streams": ("pose", "raw")}, [("fields", {"streams": "pose,raw"})]),
        ({"start": True}, [("start", {})]),
    ],
)
def test_a_probes_settings_become_the_commands_that_are_needed(
    settings: dict[str, Any], orders: list[tuple[str, dict[str, str]]]
) -> None:
    hello = FakeProbe().hello_fields
    assert orders_of(ProbeSettings(**settings), hello) == orders


def test_a_rate_that_is_set_back_before_the_next_hello_is_set_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    registry = Registry(Config())
    registry.add("00112233445566aa").probe.hello.update(FakeProbe().hello_fields)
    commander, sent = Commander(registry), []

    async def command(_: str, name: str, parameters: dict[str, str]) -> None:
        sent.append((name, parameters["hz"]))

    monkeypatch.setattr(commander, "command", command)
    for rate in (50, 100, 100):
        settings = ProbeSettings(pose_rate=rate)
        asyncio.run(commander.set_up("00112233445566aa", settings))
    assert sent == [("rate", "50"), ("rate", "100")]
