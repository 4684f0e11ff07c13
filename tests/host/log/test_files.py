# SPDX-License-Identifier: MIT
"""The contents of the log's files, and when the next one begins."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from msgspec.structs import replace

import imud.sinks.log
from chain import Chain
from fakes.messages import HELLO
from imud.log.channels import POSE_IN_FRAME, payload_on
from imud.log.file import Settings
from imud.log.reader import FRAME_ENCODING, Logged
from imud.log.schemas import FOXGLOVE_SCHEMA
from imud.probes.record import Record
from imud.sinks.log import LogSink
from imud.wire import schema
from imud.wire.messages import encode
from log_files import BEGIN_NS, frames, read_log, records, write


def test_a_file_is_as_large_as_told_and_none_is_lost_between(tmp_path: Path) -> None:
    put = records(400)
    sink = LogSink(tmp_path, Settings(rotate_bytes=20_000))
    sink.open()
    for begin in range(0, len(put), 20):
        for record in put[begin : begin + 20]:
            sink.write(record)
        sink.flush()
    sink.close()
    files = sorted(tmp_path.iterdir())
    assert len(files) > 2
    found = [frame for path in files for frame in frames(path)]
    assert found == [record.content for record in put]
    for path in files:
        list(read_log(path))  # each has its end
    assert all(path.stat().st_size < 40_000 for path in files)


def test_a_hello_that_says_nothing_new_is_written_once(tmp_path: Path) -> None:
    """A probe says it each second, with another number and another time."""
    put = records(2)
    again = encode("hello", HELLO, 700, 9_000_000)
    other = encode("hello", HELLO | {"params_digest": 7}, 900, 12_000_000)
    hellos = [put[0].hello, again, other, again]
    said = [replace(put[1], hello=hello) for hello in hellos for _ in range(50)]
    path = write(tmp_path, said)
    with path.open("rb") as file:
        found = [each.name for each in make_reader(file).iter_metadata()]
    assert found.count("hello") == 3
    assert len(frames(path)) == len(said)


def test_a_new_timeline_begins_a_file_and_a_step_forwards_none(tmp_path: Path) -> None:
    put = records(4)

    def clock(timeline: int) -> Record:
        text = json.dumps({"t_ns": 1, "step_ns": 2, "timeline": timeline})
        return Record("left", "clock", text.encode(), b"", 0, BEGIN_NS, BEGIN_NS)

    write(tmp_path, [put[0], clock(1), put[1], clock(2), put[2], clock(2), put[3]])
    found = [[*frames(path)] for path in sorted(tmp_path.iterdir())]
    contents = [record.content for record in put]
    assert found == [contents[:2], contents[2:]]


def test_the_index_in_memory_is_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imud.sinks.log, "INDEX_MAX", 12)
    put = records(60)
    write(tmp_path, *[put[at : at + 5] for at in range(0, 60, 5)])
    assert len(list(tmp_path.iterdir())) >= 4
    found = [frame for path in tmp_path.iterdir() for frame in frames(path)]
    assert sorted(found) == sorted(record.content for record in put)


def test_who_it_was_and_how_it_was_set_stand_in_each_file(tmp_path: Path) -> None:
    path = write(tmp_path, records(3), configuration='{"log":{}}')
    with path.open("rb") as file:
        found = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert found["configuration"]["json"] == '{"log":{}}'
    assert found["imud"]["schema_fingerprint"] == f"{schema.FINGERPRINT:#010x}"
    hello = found["hello"]
    assert (hello["probe"], hello["firmware"]) == ("left", "0.1.0+fake")
    assert hello["probe_id"] == "00112233445566aa"


def test_foxglove_finds_poses_that_it_can_draw(tmp_path: Path) -> None:
    path = write(tmp_path, records(1))
    with path.open("rb") as file:
        ((spec, channel, message),) = make_reader(file).iter_messages(
            topics=["imud/left/pose_in_frame"]
        )
    assert (spec.name, spec.encoding) == ("foxglove.PoseInFrame", "jsonschema")
    assert channel.message_encoding == "json"
    assert json.loads(message.data) == {
        "timestamp": {"sec": BEGIN_NS // 10**9, "nsec": BEGIN_NS % 10**9},
        "frame_id": "left_level",  # where that is in the world is not known
        "pose": {
            "position": {"x": 0.0, "y": 0.0, "z": 0.0},
            "orientation": {"w": 0.5, "x": 0.5, "y": -0.5, "z": 0.5},
        },
    }
    without = write(tmp_path / "plain", records(1), has_foxglove=False)
    topics = {each.topic for each in read_log(without) if isinstance(each, Logged)}
    assert topics == {"hello", "pose", "frame"}


def test_a_pose_whose_position_is_known_is_drawn_in_the_world() -> None:
    (record,) = records(1)[-1:]
    values = {**record.values, "position_m": (1.0, 2.0, 3.0)}
    drawn = json.loads(payload_on(replace(record, values=values), POSE_IN_FRAME))
    assert drawn["frame_id"] == "world"
    assert drawn["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 3.0}


# What Foxglove wants of its PoseInFrame, as its published schema has it: all of these.
PUBLISHED = {
    "timestamp": {"sec": "integer", "nsec": "integer"},
    "frame_id": "string",
    "pose": {
        "position": dict.fromkeys("xyz", "number"),
        "orientation": dict.fromkeys("xyzw", "number"),
    },
}


def wanted_of(spec: dict[str, Any]) -> Any:
    """A schema as names and types; nothing in it may be left out."""
    if spec["type"] != "object":
        return spec["type"]
    assert sorted(spec["required"]) == sorted(spec["properties"])
    return {name: wanted_of(each) for name, each in spec["properties"].items()}


def test_poses_for_foxglove_are_of_its_published_schema() -> None:
    assert FOXGLOVE_SCHEMA["title"] == "foxglove.PoseInFrame"
    assert wanted_of(FOXGLOVE_SCHEMA) == PUBLISHED
    checker = Draft202012Validator(FOXGLOVE_SCHEMA)
    for record in records(20):
        if record.topic == "pose":
            checker.validate(json.loads(payload_on(record, POSE_IN_FRAME)))


def decoded(path: Path) -> Counter[str]:
    """How many of each topic; with nothing of imud's, each is what its schema says."""
    found: Counter[str] = Counter()
    with path.open("rb") as file:
        for spec, channel, message in make_reader(
            file, validate_crcs=True
        ).iter_messages():
            topic = channel.topic.rpartition("/")[2]
            found[topic] += 1
            if topic == "frame":
                assert channel.message_encoding == FRAME_ENCODING
                continue
            assert spec is not None, topic
            assert (spec.encoding, channel.message_encoding) == ("jsonschema", "json")
            body = json.loads(spec.data)
            Draft202012Validator.check_schema(body)
            payload = json.loads(message.data)
            Draft202012Validator(body).validate(payload)
            assert payload.keys() <= body["properties"].keys() or topic == "status"
    return found


def test_with_mcap_alone_all_that_the_daemon_logs_is_what_its_schema_says(
    chain: Chain,
) -> None:
    probe = chain.probe
    chain.port.write(probe.poses(50) + probe.say("raw") + probe.say("event"))
    chain.status_when(lambda status: status["ledger"]["logged"].get("event") == 1)
    chain.daemon.stop()
    found = decoded(chain.daemon.log)
    assert (found["pose"], found["pose_in_frame"]) == (50, 50)
    assert (found["raw"], found["event"]) == (1, 1)
    assert found["status"] > 0
    assert found["frame"] >= 53


def test_what_the_daemon_says_of_itself_is_logged_with_its_schema(
    tmp_path: Path,
) -> None:
    head = {"probe": "left", "t_ns": 1}
    published = [
        {"type": "clock", **head, "step_ns": -5, "timeline": 1},
        {"type": "log", **head, "state": "paused", "reason": "full", "dropped": 3},
        {"type": "log", **head, "state": "on", "reason": None, "dropped": 9},
    ]
    put = [
        Record("left", str(each["type"]), json.dumps(each).encode(), b"", 0, 1, 1)
        for each in published
    ]
    assert decoded(write(tmp_path, put)) == {"clock": 1, "log": 2}


def test_a_probe_that_is_not_to_be_logged_is_not(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        records(4, name="left"),
        records(4, name="right"),
        unlogged=frozenset({"right"}),
    )
    probes = {each.probe for each in read_log(path) if isinstance(each, Logged)}
    assert probes == {"left"}


def test_the_defaults_of_the_sink_and_of_the_configuration_are_one() -> None:
    from imud.config.settings import LogSettings

    log, settings = LogSettings(), Settings()
    assert settings.rotate_s == log.rotate_minutes * 60
    assert settings.has_foxglove == log.foxglove
