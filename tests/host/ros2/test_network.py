# SPDX-License-Identifier: MIT
"""The daemon as a node of ROS 2, on its network."""

from __future__ import annotations

import json
import queue
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from zenoh_ros2_sdk import attachment as other_attachment
from zenoh_ros2_sdk import discovery
from zenoh_ros2_sdk.session import ZenohSession

from fakes import HELLO, POSE, DaemonProcess, FakeProbe, Port, free_endpoint
from imud.config import reader
from imud.daemon.hub import Hub
from imud.errors import ConfigError
from imud.probes.record import Presence
from imud.ros2 import topics as ros2
from imud.sinks.ros2 import Ros2Sink, own_network
from ros_values import JAZZY


def refused(directory: Path, text: str) -> str:
    path = directory / "imud.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError) as caught:
        reader.load(path)
    return str(caught.value)


@pytest.mark.parametrize("namespace", ["/imud", "imud/", "a//b", "1st", "a b", "a__b"])
def test_a_namespace_that_ros_refuses_is_refused(
    tmp_path: Path, namespace: str
) -> None:
    error = refused(tmp_path, f'[ros2]\nenabled = true\nnamespace = "{namespace}"\n')
    assert f"[ros2] namespace: {namespace!r} can't be part of a topic" in error


def test_two_probes_of_one_name_in_ros_are_refused(tmp_path: Path) -> None:
    probes = "".join(
        f'[probes.001122334455660{n}]\nname = "{name}"\n'
        for n, name in enumerate(("arm-left", "arm_left"))
    )
    error = refused(tmp_path, f"[ros2]\nenabled = true\n{probes}")
    assert "'arm_left' and 'arm-left' are both arm_left in ROS" in error


def test_the_daemons_own_network_is_found_on_this_machine() -> None:
    listen = ("tcp/0.0.0.0:7447", "tls/[::]:7448", "tcp/192.168.0.2:1")
    own = ["tcp/127.0.0.1:7447", "tls/[::1]:7448", "tcp/192.168.0.2:1"]
    assert own_network("router", listen, ()) == own
    assert own_network("peer", listen, ("tcp/hub:7447",)) == ["tcp/hub:7447"]


@pytest.fixture
def ros() -> Iterator[Callable[[str], ZenohSession]]:
    """Another implementation's session: a peer as rmw_zenoh's nodes are."""
    opened: list[ZenohSession] = []

    def open_session(endpoint: str) -> ZenohSession:
        port = int(endpoint.rpartition(":")[2])
        opened.append(ZenohSession.get_instance("127.0.0.1", port))
        return opened[-1]

    yield open_session
    for session in opened:
        session.session.close()
    ZenohSession._instance = None


def topics_when(
    endpoint: str, domain: int, is_so: Callable[[dict[str, list[str]]], bool]
) -> dict[str, list[str]]:
    """The list of its discovery, once that is true."""
    while True:
        port = int(endpoint.rpartition(":")[2])
        found = discovery.get_topic_names_and_types(domain, "127.0.0.1", port)
        topics = dict(found)
        if is_so(topics):
            return topics
        time.sleep(0.05)


BASE = "/imud/probe_00112233445566aa"
EXPECTED = {
    f"{BASE}/imu/data": ["sensor_msgs/msg/Imu"],
    f"{BASE}/imu/mag": ["sensor_msgs/msg/MagneticField"],
    f"{BASE}/pose": ["geometry_msgs/msg/PoseStamped"],
    f"{BASE}/tip": ["geometry_msgs/msg/PointStamped"],
    f"{BASE}/path": ["nav_msgs/msg/Path"],
    "/tf": ["tf2_msgs/msg/TFMessage"],
    "/diagnostics": ["diagnostic_msgs/msg/DiagnosticArray"],
}


Published = dict[str, list[tuple[Any, other_attachment.Attachment]]]


def published_on_all_topics(
    session: ZenohSession, probe: FakeProbe, port: Port
) -> Published:
    """Messages and their attachments, by topic; at least five poses."""
    heard: queue.Queue[tuple[str, bytes, bytes]] = queue.Queue()

    def hear(sample: zenoh.Sample) -> None:
        payload, attached = sample.payload.to_bytes(), sample.attachment.to_bytes()
        heard.put((str(sample.key_expr), payload, attached))

    subscriber = session.session.declare_subscriber("5/**", hear)
    published: Published = {}
    while len(published) < len(EXPECTED) or len(published[f"{BASE}/pose"]) < 5:
        path = {"path": (0.1, 0.2, 0.3), "path_sigma": (0.001, 0.001)}
        port.write(probe.say("raw") + probe.say("stroke", **path))
        port.write(probe.say("pose", position=(0.1, 0.2, 0.3)))
        try:
            key, payload, attached = heard.get(timeout=0.02)
        except queue.Empty:
            continue
        _, *parts, dds, _ = key.split("/")
        kind = next(kind for kind in ros2.TYPES if kind.dds == dds)
        message = JAZZY.deserialize_cdr(payload, kind.name)
        attachment = other_attachment.Attachment.from_bytes(attached)
        published.setdefault("/" + "/".join(parts), []).append((message, attachment))
    subscriber.undeclare()
    return published


def assert_numbered_by_tokens(session: ZenohSession, published: Published) -> None:
    """Each topic has a token, by whose hash its messages are numbered."""
    tokens: set[str] = set()
    while len(tokens) < 1 + len(EXPECTED):
        replies = session.liveliness.get("@ros2_lv/5/**")
        tokens |= {str(reply.ok.key_expr) for reply in replies if reply.ok}
    # Each entity of the node has a number of its own: the node itself has 0.
    assert sorted(token.split("/")[4] for token in tokens) == list("01234567")
    gids = {ros2.gid_of(token) for token in tokens if "/MP/" in token}
    assert sum("/NN/" in token for token in tokens) == 1
    for name, messages in published.items():
        numbers = [attachment.sequence_id for _, attachment in messages]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), name
        (gid,) = {attachment.gid for _, attachment in messages}
        gids.remove(gid)
    assert gids == set()
    assert len({str(attachment) for _, attachment in published["/tf"]}) == len(
        published["/tf"]
    )


def test_a_daemon_is_a_node_that_another_implementation_finds_and_reads(
    tmp_path: Path, ros: Callable[[str], ZenohSession]
) -> None:
    settings = tmp_path / "imud.toml"
    settings.write_text("[ros2]\nenabled = true\ndomain = 5\n", "utf-8")
    probe, port = FakeProbe(), Port(tmp_path / "port")
    with DaemonProcess(
        port.path, "--config", settings, directory=tmp_path, log=False
    ) as daemon:
        daemon.find(port, probe)
        session = ros(daemon.endpoint)
        topics = topics_when(
            daemon.endpoint, 5, lambda found: len(found) >= len(EXPECTED)
        )
        assert topics == EXPECTED

        published = published_on_all_topics(session, probe, port)
        imu, _ = published[f"{BASE}/imu/data"][-1]
        q = imu.orientation
        assert (q.w, q.x, q.y, q.z) == pytest.approx(POSE["q"])
        assert imu.header.frame_id == "probe_00112233445566aa"
        sigmas = [POSE["tilt_sigma"], POSE["tilt_sigma"], POSE["heading_sigma"]]
        expected = np.diag(np.radians(sigmas) ** 2)
        assert imu.orientation_covariance.reshape(3, 3) == pytest.approx(expected)
        assert imu.linear_acceleration.z == pytest.approx(2048 * HELLO["acc_lsb"])
        mag, _ = published[f"{BASE}/imu/mag"][-1]
        assert mag.magnetic_field.z == pytest.approx(45e-6)

        assert_numbered_by_tokens(session, published)
        port.vanish()
        daemon.stop()


def router(endpoint: str) -> zenoh.Session:
    settings = zenoh.Config()
    settings.insert_json5("mode", '"router"')
    settings.insert_json5("listen/endpoints", json.dumps([endpoint]))
    settings.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(settings)


def test_a_router_of_ros_may_come_late_and_come_back(
    ros: Callable[[str], ZenohSession],
) -> None:
    endpoint = free_endpoint()
    hub = Hub()
    try:
        hub.add(Ros2Sink([endpoint], 0, "imud", "world"))
        hub.put(Presence("00112233445566aa", is_alive=True))
        for _ in range(2):
            middle = router(endpoint)
            ros(endpoint)
            found = topics_when(endpoint, 0, lambda topics: len(topics) >= 5)
            assert found == EXPECTED
            ZenohSession.get_instance().session.close()
            ZenohSession._instance = None
            middle.close()
    finally:
        hub.close()


def test_an_address_that_makes_no_sense_is_named() -> None:
    sink = Ros2Sink(["nonsense"], 0, "imud", "world")
    with pytest.raises(ConfigError, match="nonsense"):
        sink.open()
