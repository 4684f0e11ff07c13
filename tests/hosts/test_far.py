# SPDX-License-Identifier: MIT
"""A router at the edge of a site lowers rates for far consumers, who know it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes import FakeProbe, free_endpoint
from imud.client import Client
from sites import ROUTER, configuration
from streaming import Process, until

RATE_HZ = 20.0  # of docs/fleet.md


@pytest.fixture
def border(tmp_path: Path) -> Iterator[str]:
    """The endpoint of such a router, with nobody behind it."""
    endpoint = free_endpoint()
    path = configuration("border.json5", {"router-a": "127.0.0.1"}, tmp_path)
    text = path.read_text("utf-8").replace("tcp/127.0.0.1:7447", free_endpoint())
    path.write_text(text.replace("tcp/0.0.0.0:7447", endpoint), "utf-8")
    process = Process(ROUTER, str(path))
    yield endpoint
    process.kill()


def test_far_consumers_get_fewer_poses_and_all_events(border: str) -> None:
    name = FakeProbe().name
    heard: dict[str, list[int]] = {topic: [] for topic in ("pose", "frame", "event")}
    with Client(border) as far, Client(border) as near:
        for topic, numbers in heard.items():
            far.listen(topic, None, lambda d, to=numbers: to.append(int(d.payload)))
        sent = 0
        begin_s = time.monotonic()

        def are_enough() -> bool:
            nonlocal sent
            for topic in heard:
                near.session.put(f"imud/{name}/{topic}", str(sent).encode())
            sent += 1
            time.sleep(0.005)  # 200 a second: more than the border lets through
            return len(heard["pose"]) >= 10 and len(heard["event"]) >= 40

        # Without the pause of until(): a hundred messages a second and more.
        while not are_enough():
            pass
        until(lambda: heard["event"][-1] == sent - 1)
        passed_s = time.monotonic() - begin_s
    events = heard["event"]
    assert events == list(range(events[0], sent))
    assert heard["frame"] == []
    assert len(heard["pose"]) <= RATE_HZ * passed_s + 1
    assert len(heard["pose"]) < len(events)
