# SPDX-License-Identifier: MIT
"""The seam for work on messages, with a stage of this file's own."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from fakes import FakeProbe
from fakes.messages import EXAMPLES
from imud.config.settings import Config, ProbeSettings
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.journal.output import Journal
from imud.probes.record import Record
from imud.probes.session import ProbeFound, Received, Session
from imud.stages import (
    InjectMessage,
    LogLine,
    Publish,
    SendCommands,
    Stage,
    StageResult,
)
from imud.stages.fusion import FusionStage
from imud.wire.messages import encode
from sessions import received
from twin_bench import followed


class Shakes:
    """Counts poses that clipped; publishes so, logs the first and then has it tared."""

    name = "shakes"
    replaced: frozenset[str] = frozenset()

    def __init__(self, config: Config) -> None:
        self.config = config
        self.count = 0
        self.appeared: list[bool] = []

    def configure(self, config: Config) -> None:
        self.config = config

    def on_probe_found(self, found: ProbeFound) -> None:
        self.appeared.append(found.is_restart)

    def on_message(self, received: Received) -> Iterator[StageResult]:
        flags = received.message.fields.get("pose_flags")
        if not isinstance(flags, tuple) or "clipped" not in flags:
            return
        self.count += 1
        yield Publish("shake", {"count": self.count})
        if self.count == 1:
            yield LogLine("first", "it was shaken", is_warning=True)
            yield SendCommands((("tare", {"what": "all"}),), "it can't be tared")

    def status(self) -> dict[str, Any]:
        return {"count": self.count}

    def closing_line(self) -> str:
        return f"{self.count} shakes"


class Bench:
    """An intake whose probes have a stage each, and what its hub is given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.hub = hub = Hub()
        self.records: list[Record] = []
        monkeypatch.setattr(hub, "put", self._put)
        self.stages: list[Shakes] = []
        self.intake = Intake(Config(), hub, Journal(), self._make)
        self.orders: list[tuple[str, SendCommands]] = []
        self.intake.stages.on_commands = lambda name, order: self.orders.append(
            (name, order)
        )
        self.port: Any = SimpleNamespace(name="/dev/ttyS9", session=None, baud=500_000)
        self.session = Session(self.intake.probe)

    def _put(self, item: object) -> None:
        if isinstance(item, Record):
            self.records.append(item)

    def _make(self, config: Config) -> list[Stage]:
        self.stages.append(Shakes(config))
        return [self.stages[-1]]

    def hear(self, data: bytes) -> None:
        for event in self.session.receive(b"\0" + data, None):
            self.intake.handle(event, self.port)

    def published(self, topic: str) -> list[dict[str, Any]]:
        return [json.loads(r.payload) for r in self.records if r.topic == topic]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_what_a_stage_answers_is_published_logged_and_sent(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    probe = FakeProbe()
    with caplog.at_level(logging.INFO, "imud"):
        bench.hear(probe.say("hello") + probe.say("pose"))
        assert bench.published("shake") == []
        for _ in range(2):
            bench.hear(probe.say("pose", pose_flags=("clipped",)))
    assert bench.published("shake") == [
        {"type": "shake", "probe": probe.name, "count": count} for count in (1, 2)
    ]
    told = [(r.levelname, r.getMessage()) for r in caplog.records]
    assert told.count(("WARNING", f"probe {probe.name}: it was shaken")) == 1
    [(name, order)] = bench.orders
    assert (name, order.commands) == (probe.name, (("tare", {"what": "all"}),))


def test_a_record_of_a_stage_follows_its_message_and_has_its_number(
    bench: Bench,
) -> None:
    probe = FakeProbe()
    bench.hear(probe.say("hello") + probe.say("pose", pose_flags=("clipped",)))
    pose, shake = bench.records[-2:]
    assert (pose.topic, shake.topic) == ("pose", "shake")
    assert shake.sequence == pose.sequence
    entry = bench.intake.registry.named(probe.name)
    assert entry.put == len(bench.records)  # the ledger counts it


def test_a_stage_hears_of_each_appearance_and_stands_in_the_status(
    bench: Bench,
) -> None:
    probe = FakeProbe()
    bench.hear(probe.say("hello") + probe.say("pose", pose_flags=("clipped",)))
    probe.restart()
    bench.hear(probe.say("hello"))
    [stage] = bench.stages
    assert stage.appeared == [False, True]
    status = bench.published("status")[-1]
    assert status["shakes"] == {"count": 1}
    assert "twin" not in status
    assert bench.intake.registry.closing_line().endswith(", 1 shakes")


def test_each_probe_has_stages_of_its_own_that_hear_of_a_reload(bench: Bench) -> None:
    for number in range(2):
        probe = FakeProbe(probe_id=bytes([number] * 8))
        bench.session = Session(bench.intake.probe)
        bench.hear(probe.say("hello") + probe.say("pose", pose_flags=("clipped",)))
    assert [stage.count for stage in bench.stages] == [1, 1]
    config = Config(twin=True)
    bench.intake.registry.configure(config)
    assert all(stage.config is config for stage in bench.stages)


class Doubles(Shakes):
    """Adds a pose of its own for each raw message."""

    def on_message(self, received: Received) -> Iterator[StageResult]:
        if received.message.name == "raw":
            self.count += 1
            message = received.message
            pose = encode("pose", EXAMPLES["pose"], message.sequence, message.time_us)
            yield InjectMessage(pose)


def test_a_message_that_a_stage_adds_is_published_but_not_as_a_frame(
    bench: Bench,
) -> None:
    bench.intake = Intake(Config(), bench.hub, Journal(), lambda c: [Doubles(c)])
    bench.session = Session(bench.intake.probe)
    probe = FakeProbe()
    bench.hear(probe.say("hello") + probe.say("raw") + probe.say("raw"))
    raws, poses = bench.published("raw"), bench.published("pose")
    assert [pose["number"] for pose in poses] == [1, 2]
    assert [pose["seq"] for pose in poses] == [raw["seq"] for raw in raws]
    assert [pose["t_device_us"] for pose in poses] == [r["t_device_us"] for r in raws]
    assert all(not r.content for r in bench.records if r.topic == "pose")
    entry = bench.intake.registry.named(probe.name)
    assert (entry.poses, entry.pose["number"], entry.received) == (2, 2, 3)


def test_what_a_stage_computes_stands_in_the_place_of_what_the_probe_sends(
    bench: Bench,
) -> None:
    """One pose a moment: those that it sends itself remain as frames only. Published
    numbers have no gaps.
    """
    stage = Doubles(Config())
    bench.intake = Intake(Config(), bench.hub, Journal(), lambda _: [stage])
    bench.session = Session(bench.intake.probe)
    probe = FakeProbe()
    bench.hear(probe.say("hello") + probe.say("pose"))
    stage.replaced = frozenset({"pose"})
    for _ in range(3):
        bench.hear(probe.say("raw") + probe.say("pose"))
    stage.replaced = frozenset()
    bench.hear(probe.say("pose"))
    records = [record for record in bench.records if record.topic == "pose"]
    said = [json.loads(record.payload) for record in records if record.payload]
    assert [each["number"] for each in said] == [1, 2, 3, 4, 5]
    computed = [record for record in records if not record.content]
    frames = [record for record in records if not record.payload]
    assert (len(computed), len(frames), len(records)) == (3, 3, 8)
    assert all(record.content for record in frames)
    entry = bench.intake.registry.named(probe.name)
    assert (entry.poses, entry.received) == (5, 9)
    assert entry.put == len(bench.records)  # the ledger counts them all


def test_a_probe_that_goes_on_sending_poses_is_not_heard_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One whose command to send no poses was lost, and is fused on the host."""
    life = followed(raw_hz=200).live(300)
    bench = Bench(monkeypatch)
    probe_id = received(life.contents)[0].probe_id
    config = Config(probes={probe_id: ProbeSettings(fuse_on_host=True)})
    bench.intake = Intake(config, bench.hub, Journal(), lambda c: [FusionStage(c)])
    session = Session(bench.intake.probe)
    for content in life.contents:
        for event in session.receive_content(content, None):
            bench.intake.handle(event, bench.port)
    poses = [
        json.loads(r.payload) for r in bench.records if r.topic == "pose" and r.payload
    ]
    moments = [pose["t_device_us"] for pose in poses]
    assert len(moments) > 100
    assert len({*moments}) == len(moments)
    assert [pose["number"] for pose in poses] == [*range(1, len(poses) + 1)]
