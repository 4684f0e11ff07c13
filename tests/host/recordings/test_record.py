# SPDX-License-Identifier: MIT
"""`imud record` logs all published messages, and reports sequence gaps."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import POSE, FakeProbe, Forked
from imud.client import Delivery
from imud.log.file import Settings
from imud.log.reader import METADATA_OF_PROBES, Logged
from imud.net.access import READS
from imud.recordings import info
from imud.recordings.record import TOPICS, Recorder
from imud.wire.messages import encode
from log_files import read_log
from streaming import Streaming, until

NAME = "stylus"


class FakeClient:
    """Where a test is the network."""

    def __init__(self) -> None:
        self.callbacks: dict[str, Callable[[Delivery], None]] = {}

    def check_may(self, do: str) -> None:
        assert do in READS["recorder"]

    def listen(
        self, topic: str, probe: str | None, callback: Callable[[Delivery], None]
    ) -> None:
        assert probe is None
        self.callbacks[topic] = callback

    def pose(self, number: int, missing: int = 0, source: str = "a") -> None:
        values = {
            **{"type": "pose", "probe": NAME, "seq": number + 7, "number": number},
            **{"missing": missing, "t_device_us": 1, "t_ns": 10**18, "t_bound_us": 2},
            **{"age_us": 3, "q": [1.0, 0.0, 0.0, 0.0], "position_m": None},
        }
        self.say("pose", json.dumps(values).encode(), source)

    def say(self, topic: str, payload: bytes, source: str = "a") -> None:
        self.callbacks[topic](Delivery(NAME, payload, source))


@pytest.fixture
def network() -> FakeClient:
    return FakeClient()


def recorder(network: FakeClient, directory: Path) -> Recorder:
    return Recorder(network, directory, Settings(), None)  # type: ignore[arg-type]


def logged(path: Path) -> list[Logged]:
    about = METADATA_OF_PROBES.values()
    found = (each for each in read_log(path) if isinstance(each, Logged))
    return [each for each in found if each.topic not in about]


def of_topic(messages: list[Logged], topic: str) -> list[Any]:
    return [json.loads(each.data) for each in messages if each.topic == topic]


def test_what_is_missing_is_in_the_log_by_number(
    tmp_path: Path, network: FakeClient
) -> None:
    made = recorder(network, tmp_path)
    for number in (5, 6, 9, 9, 10):
        network.pose(number, missing=2 if number == 9 else 0)
    network.pose(3, source="b")
    made.close()
    assert made.path is not None
    messages = logged(made.path)
    assert [each["number"] for each in of_topic(messages, "pose")] == [5, 6, 9, 10, 3]
    gaps = [
        (gap["after"], gap["before"], gap["network"], gap["wire"])
        for gap in of_topic(messages, "gap")
    ]
    assert gaps == [(6, 9, 2, 2), (10, 3, 2, 0)]
    of = made.summary()[NAME]
    assert of["missed"]["network"] == 4
    assert of["missed"]["wire"] == 2
    assert of["missed"]["daemon_restarts"] == 1
    assert of["written"] == 5 + 2
    assert of["last"] == {"pose": 3}


def test_every_topic_is_kept_as_it_was_published(
    tmp_path: Path, network: FakeClient
) -> None:
    made = recorder(network, tmp_path)
    assert set(network.callbacks) == set(TOPICS)
    probe = FakeProbe()
    hello, pose = probe.content("hello"), probe.content("pose")
    network.say("frame", hello)
    network.say("frame", pose)
    network.say("frame", b"short")
    network.say("status", b'{"type":"status"}')
    network.say("params", b'{"type":"params","bytes":"0102"}')
    network.say("params", b'{"type":"params","bytes":null}')
    network.say("pose", b"forged")
    made.close()
    assert made.path is not None
    messages = logged(made.path)
    frames = [each.data for each in messages if each.topic == "frame"]
    assert frames == [hello, pose]
    assert of_topic(messages, "status") == [{"type": "status"}]
    assert made.missed().unreadable == 1
    assert info.run([made.path], as_json=True) == 0


def test_a_disk_without_room_is_told_and_counted(
    tmp_path: Path, network: FakeClient
) -> None:
    settings = Settings(floor_bytes=1 << 62)
    made = Recorder(network, tmp_path, settings, None)  # type: ignore[arg-type]
    network.say("frame", encode("pose", POSE, 1, 2))
    made.write()
    assert "logging is paused" in made.trouble
    assert made.summary()[NAME]["unwritten"] == 1


def test_a_recorder_as_a_process_keeps_all_that_a_daemon_says(
    tmp_path: Path, chain: Chain
) -> None:
    process = Forked(
        *("-m", "imud", "record", "--json"),
        *("--connect", chain.daemon.endpoint, "--log", tmp_path / "kept"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        assert "records to" in process.stderr.readline()
        (path,) = (tmp_path / "kept").glob("*.mcap")
        empty = path.stat().st_size
        with Streaming(chain.port, chain.probe):
            until(lambda: path.stat().st_size > empty + 5000)
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 0
    (of,) = json.loads(out).values()
    messages = logged(path)
    numbers = [each["number"] for each in of_topic(messages, "pose")]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert of["last"]["pose"] == numbers[-1]
    assert of["missed"]["network"] == of["unwritten"] == 0
    kept = [each for each in messages if each.topic != "pose_in_frame"]
    assert of["written"] == len(kept)
