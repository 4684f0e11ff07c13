# SPDX-License-Identifier: MIT
"""Logs as bags of ROS 2, opened again by rosbags."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from msgspec.structs import replace
from rosbags.highlevel import AnyReader

from fakes import HELLO, FakeProbe
from fakes.records import ONE, calibrated_records, calibration_record
from imud import cli
from imud.probes.record import Record, Stamp, record_of
from imud.probes.references import References
from imud.probes.scales import Scales
from imud.sinks.ros2 import RosTranslator
from imud.wire.messages import Message, decode, encode
from imud.wire.params import digest_of
from log_files import BEGIN_NS, PERIOD_NS, records, write

COUNT = 60
ROS2 = ["--to", "rosbag2"]
PLACE = (0.25, -0.5, 0.125)
# Params of other sigmas.
EYE = [ONE, 0, 0, 0, ONE, 0, 0, 0, ONE]
LATER = b"".join(calibration_record(tag, [0] * 3, EYE, 500) for tag in (1, 2, 3))


def made(name: str) -> list[Record]:
    """A daemon's log of a probe: params that change, an origin, a stroke."""
    probe = FakeProbe()
    references = References()
    found = []
    for number in range(COUNT):
        params = calibrated_records(1) if number < 40 else LATER
        hello = encode("hello", HELLO | {"params_digest": digest_of(params)}, 1, 0)
        kind, fields = "pose", {"position": PLACE if number > 20 else None}
        if number == 20:
            kind, fields = "event", {"event": "tared"}
        elif number == 30:
            kind, fields = "stroke", {"path": (0.1, 0.0, 0.0)}
            fields["path_sigma"] = (0.001, 0.001)
        elif number % 2:
            kind, fields = "raw", {}
        if kind == "pose" and number > 20:
            fields["pose_flags"] = ("tared",)
        content = probe.content(kind, **fields)
        message = decode(content)
        assert isinstance(message, Message)
        t_ns = BEGIN_NS + number * PERIOD_NS
        stamp = Stamp(number + 1, 0, number * 10_000, t_ns, 1000, t_ns + 2_000_000)
        scales = Scales(hello, params)
        found.append(
            record_of(message, content, name, stamp, scales, references=references)
        )
    status = {"type": "status", "probe": name, "t_ns": BEGIN_NS, "state": "streaming"}
    payload = json.dumps(status).encode()
    return [*found, Record(name, "status", payload, b"", 0, BEGIN_NS, BEGIN_NS)]


def published(put: list[Record]) -> list[tuple[str, int, bytes]]:
    """The messages of the daemon's node: topics, times of arrival, bytes."""
    translators: dict[str, RosTranslator] = {}
    return [
        (topic.name, record.t_received_ns, data)
        for record in put
        for topic, data in translators.setdefault(
            record.probe, RosTranslator(record.probe, "imud", "world")
        ).translate(record)
    ]


def test_a_bag_has_the_messages_of_the_daemons_node(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = made("left") + made("right")
    path = write(tmp_path, put)
    out = tmp_path / "bags"
    assert cli.main(["export", str(path), *ROS2, "--out", str(out)]) == 0
    bag = out / f"{path.stem}-rosbag2"
    wanted = published(put)
    assert capsys.readouterr().out == f"{bag}: {len(wanted)} messages\n"
    with AnyReader([bag]) as reader:
        found = [(c.topic, t_ns, data) for c, t_ns, data in reader.messages()]
        assert sorted(found) == sorted(wanted)
        names = {c.topic for c in reader.connections}
        for probe in ("left", "right"):
            own = ("imu/data", "imu/mag", "pose", "tip", "path")
            assert names > {f"/imud/{probe}/{name}" for name in own}
        assert names > {"/tf", "/diagnostics"}
        places = []
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/imud/left/imu/data":
                rest = message.linear_acceleration_covariance[0]
                assert rest == -1 or rest > 0
            if connection.topic == "/imud/left/pose":
                place = message.pose.position
                places.append((place.x, place.y, place.z))
    assert places
    assert set(places) == {PLACE}
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        assert make_reader(stream).get_header().profile == "ros2"
    # Nothing is overwritten.
    assert cli.main(["export", str(path), *ROS2, "--out", str(out)]) == 1
    assert "already exists; choose another folder" in capsys.readouterr().err


def test_a_damaged_log_becomes_a_bag_of_what_is_good(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strange = [
        replace(each, payload=b'{"t_device_us": 5, "q": "no"}')
        for each in records(3)
        if each.topic == "pose"
    ]
    put = records(50)
    path = write(tmp_path, strange, put, put)
    path.write_bytes(path.read_bytes()[:-30])
    none = tmp_path / "none.mcap"
    assert cli.main(["export", str(none), str(path), *ROS2]) == 1
    assert capsys.readouterr().err.splitlines() == [
        f"{path}: 2 messages are not imud's JSON objects",
        f"imud: can't read {none}: No such file or directory",
    ]
    with AnyReader([tmp_path / f"{path.stem}-rosbag2"]) as reader:
        (imu,) = (c for c in reader.connections if c.topic == "/imud/left/imu/data")
        assert imu.msgcount == sum(each.topic == "pose" for each in put + put)
    assert [each.name for each in tmp_path.glob("none*")] == []


def test_a_log_without_probes_leaves_no_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, [])
    assert cli.main(["export", str(path), *ROS2]) == 0
    assert capsys.readouterr().out == f"{path} has no messages for ROS 2\n"
    assert list(tmp_path.iterdir()) == [path]


def test_without_rosbags_a_bag_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    path = write(tmp_path, records(3))
    assert cli.main(["export", str(path), *ROS2]) == 1
    assert capsys.readouterr().err == (
        "imud: writing bags needs rosbags: pip install 'imu-probe[rosbag2]'\n"
    )
