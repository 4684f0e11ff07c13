# SPDX-License-Identifier: MIT
"""A probe's own settings become commands."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from fakes import FakeProbe
from imud.config.settings import Config, ProbeSettings
from imud.daemon.commands import Commander, orders_of
from imud.daemon.registry import Registry


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
