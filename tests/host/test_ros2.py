# SPDX-License-Identifier: MIT
"""ROS 2 with no ROS: bytes against two other serialisers, names and tokens against
another implementation of rmw_zenoh's, and a daemon that its discovery finds.
"""

from __future__ import annotations

import json
import math
import queue
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from zenoh.ext import Int64, z_deserialize
from zenoh_ros2_sdk import attachment as other_attachment
from zenoh_ros2_sdk import discovery, entity, keyexpr, qos
from zenoh_ros2_sdk.session import ZenohSession

import ros_types
from fakes import HELLO, PATIENCE_S, POSE, DaemonProcess, FakeProbe, Port, free_endpoint
from imud.config import reader
from imud.daemon.hub import Hub
from imud.errors import ConfigError
from imud.probes.record import Presence, Record
from imud.ros2 import cdr
from imud.ros2 import topics as ros2
from imud.ros2.cdr import Diagnosis, Level
from imud.ros2.topics import Node, Topic
from imud.sinks.ros2 import (
    DIAGNOSTICS,
    FREE_RAD2,
    TF,
    Ros2Sink,
    Translator,
    own_network,
)

JAZZY = get_typestore(Stores.ROS2_JAZZY)
TYPES = JAZZY.types

# One of each length that aligns what follows otherwise, and one that is not ASCII.
FRAMES = ("", "a", "ab", "abc", "abcd", "imu_12", "probe_00112233445566aa", "Mühle")
T_NS = 1_795_237_912_345_678_901
Q = (0.9, 0.1, -0.2, 0.3)
XYZW = (0.1, -0.2, 0.3, 0.9)
COVARIANCE = tuple(0.25 * n for n in range(9))
RATE, FORCE, FIELD = (0.01, -0.02, 3.0), (-9.5, 0.125, 9.75), (2e-5, -1e-6, 4.5e-5)
DIAGNOSES = [
    Diagnosis(Level.WARN, "imud: tip", "3 lost", "0123", {"state": "ok", "n": ""}),
    Diagnosis(Level.STALE, "x", "", "", {}),
]


def theirs(kind: ros2.Type, build: Callable[[Callable[..., Any]], Any]) -> list[bytes]:
    """What both other serialisers make of a message that `build` makes of its parts."""

    def of_rosbags(name: str, *values: Any) -> Any:
        (full,) = (t for t in TYPES if t.endswith(f"/msg/{name}") and t in PARTS)
        return TYPES[full](
            *(np.array(v) if isinstance(v, tuple) else v for v in values)
        )

    def of_pycdr2(name: str, *values: Any) -> Any:
        return getattr(ros_types, name)(
            *(list(v) if isinstance(v, tuple) else v for v in values)
        )

    return [
        bytes(JAZZY.serialize_cdr(build(of_rosbags), kind.name)),
        build(of_pycdr2).serialize(),
    ]


PARTS = frozenset(
    {
        "builtin_interfaces/msg/Time",
        "std_msgs/msg/Header",
        "geometry_msgs/msg/Point",
        "geometry_msgs/msg/Pose",
        "geometry_msgs/msg/Quaternion",
        "geometry_msgs/msg/Transform",
        "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/Vector3",
        "diagnostic_msgs/msg/DiagnosticStatus",
        "diagnostic_msgs/msg/KeyValue",
        *(kind.name for kind in ros2.TYPES),
    }
)


def header(make: Callable[..., Any], frame: str) -> Any:
    return make("Header", make("Time", *divmod(T_NS, 10**9)), frame)


@pytest.mark.parametrize("frame", FRAMES)
def test_an_imu_is_byte_for_byte_that_of_two_other_serialisers(frame: str) -> None:
    ours = cdr.imu(T_NS, frame, Q, COVARIANCE, RATE, cdr.UNKNOWN, FORCE, cdr.ABSENT)
    others = theirs(
        ros2.IMU,
        lambda make: make(
            "Imu",
            header(make, frame),
            make("Quaternion", *XYZW),
            COVARIANCE,
            make("Vector3", *RATE),
            (0.0,) * 9,
            make("Vector3", *FORCE),
            (-1.0,) + (0.0,) * 8,
        ),
    )
    assert others == [ours, ours]


@pytest.mark.parametrize("frame", FRAMES)
def test_a_magnetic_field_is_byte_for_byte_theirs(frame: str) -> None:
    ours = cdr.magnetic_field(T_NS, frame, FIELD, COVARIANCE)
    others = theirs(
        ros2.MAGNETIC_FIELD,
        lambda make: make(
            "MagneticField", header(make, frame), make("Vector3", *FIELD), COVARIANCE
        ),
    )
    assert others == [ours, ours]


@pytest.mark.parametrize("frame", FRAMES)
def test_a_pose_is_byte_for_byte_theirs(frame: str) -> None:
    ours = cdr.pose_stamped(T_NS, frame, FORCE, Q)
    others = theirs(
        ros2.POSE_STAMPED,
        lambda make: make(
            "PoseStamped",
            header(make, frame),
            make("Pose", make("Vector3", *FORCE), make("Quaternion", *XYZW)),
        ),
    )
    assert others == [ours, ours]


@pytest.mark.parametrize("child", FRAMES)
@pytest.mark.parametrize("frame", FRAMES[:5])
def test_a_transform_is_byte_for_byte_theirs(frame: str, child: str) -> None:
    ours = cdr.transform(T_NS, frame, child, FORCE, Q)
    others = theirs(
        ros2.TF_MESSAGE,
        lambda make: make(
            "TFMessage",
            [
                make(
                    "TransformStamped",
                    header(make, frame),
                    child,
                    make(
                        "Transform", make("Vector3", *FORCE), make("Quaternion", *XYZW)
                    ),
                )
            ],
        ),
    )
    assert others == [ours, ours]


def diagnostics(make: Callable[..., Any], frame: str, said: list[Diagnosis]) -> Any:
    return make(
        "DiagnosticArray",
        header(make, frame),
        [
            make(
                "DiagnosticStatus",
                int(one.level),
                one.name,
                one.message,
                one.hardware_id,
                [make("KeyValue", *pair) for pair in one.values.items()],
            )
            for one in said
        ],
    )


TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)


@given(
    frame=TEXT,
    said=st.lists(
        st.builds(
            Diagnosis,
            st.sampled_from(Level),
            TEXT,
            TEXT,
            TEXT,
            st.dictionaries(TEXT, TEXT, max_size=3),
        ),
        max_size=3,
    ),
)
def test_diagnostics_are_byte_for_byte_theirs(
    frame: str, said: list[Diagnosis]
) -> None:
    ours = cdr.diagnostic_array(T_NS, frame, said)
    others = theirs(ros2.DIAGNOSTIC_ARRAY, lambda make: diagnostics(make, frame, said))
    assert others == [ours, ours]


@pytest.mark.parametrize("kind", ros2.TYPES, ids=lambda kind: kind.name)
@pytest.mark.parametrize(
    "store", [Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED]
)
def test_a_type_has_the_hash_of_its_definition(kind: ros2.Type, store: Stores) -> None:
    assert get_typestore(store).hash_rihs01(kind.name) == kind.hash


TOPICS = (Topic("/imud/tip/imu/data", ros2.IMU), TF, DIAGNOSTICS)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_keys_and_tokens_are_those_of_another_implementation(topic: Topic) -> None:
    node = Node(3, "51f2a", "imud")
    other_node = entity.NodeEntity(3, "51f2a", 0, "imud")
    assert node.token == keyexpr.node_liveliness_keyexpr(other_node)
    # Its own default of depth is 10, that of rmw_zenoh is 42: it is always said here.
    reliable = qos.QosProfile(history_depth=topic.depth)
    other = entity.EndpointEntity(
        other_node,
        7,
        entity.EntityKind.PUBLISHER,
        topic.name,
        topic.type.dds,
        topic.type.hash,
        reliable.encode(),
    )
    assert node.publisher_token(7, topic) == keyexpr.endpoint_liveliness_keyexpr(other)
    assert qos.QosProfile.decode(topic.qos) == reliable
    key = keyexpr.topic_keyexpr(3, topic.name, topic.type.dds, topic.type.hash)
    assert topic.key(3) == key


def test_an_attachment_is_read_by_zenoh_and_by_another_implementation() -> None:
    gid = ros2.gid_of("@ros2_lv/0/token")
    data = ros2.attachment(5, T_NS, gid)
    other = other_attachment.Attachment.from_bytes(data)
    assert (other.sequence_id, other.timestamp_ns, other.gid) == (5, T_NS, gid)
    assert other.to_bytes() == data
    read = z_deserialize(tuple[Int64, Int64, bytes], zenoh.ZBytes(data))
    assert read == (5, T_NS, gid)


def test_a_gid_is_the_hash_of_the_token_low_half_first() -> None:
    # XXH3-128 of nothing, by the test vectors of xxHash's specification.
    low, high = 0x6001C324468D497F, 0x99AA06D3014798D8
    assert ros2.gid_of("") == struct.pack("<QQ", low, high)


@given(st.text(min_size=1))
def test_any_name_of_a_probe_becomes_one_of_ros(text: str) -> None:
    name = ros2.ros_name(text)
    assert ros2.ros_name(name) == name
    topic = Topic(f"/imud/{name}/pose", ros2.POSE_STAMPED)
    assert zenoh.KeyExpr(topic.key(0)).intersects(
        zenoh.KeyExpr(f"0/imud/{name}/pose/*/*")
    )
    assert not name[0].isdigit()
    assert "__" not in name


def pose(**fields: Any) -> Record:
    said = {
        "type": "pose",
        "t_device_us": 1_000_000,
        "q": Q,
        "position_m": None,
        "tilt_sigma_deg": 0.5,
        "heading_sigma_deg": 2.0,
        "flags": (),
    } | fields
    return Record("tip", "pose", b"{}", b"", 1, T_NS, T_NS, said=said)


def raw(**fields: Any) -> Record:
    said = {
        "type": "raw",
        "t_device_us": 1_000_000,
        "acc_m_s2": FORCE,
        "gyr_rad_s": RATE,
        "mag_uT": None,
    } | fields
    return Record("tip", "raw", b"{}", b"", 1, T_NS, T_NS, said=said)


def status(**fields: Any) -> Record:
    said = {
        "type": "status",
        "probe": "tip",
        "probe_id": "00112233445566aa",
        "state": "streaming",
        "pose_rate_hz": 100.0,
        "quality": {"tilt_sigma_deg": 0.5, "heading_sigma_deg": None, "flags": []},
        "ledger": {"received": 10, "lost": 0, "corrupt": 0, "dropped": {"log": 0}},
        "equipment": None,
    } | fields
    return Record("tip", "status", json.dumps(said).encode(), b"", 0, T_NS, T_NS)


def said_by(translator: Translator, *records: Record) -> dict[str, list[Any]]:
    said: dict[str, list[Any]] = {}
    for record in records:
        for topic, data in translator.take(record):
            message = JAZZY.deserialize_cdr(data, topic.type.name)
            said.setdefault(topic.name, []).append(message)
    return said


@pytest.fixture
def translator() -> Translator:
    return Translator("tip", "imud", "world")


def test_a_pose_is_said_three_times(translator: Translator) -> None:
    said = said_by(translator, pose(position_m=(1.0, 2.0, 3.0)))
    assert list(said) == ["/imud/tip/imu/data", "/imud/tip/pose", "/tf"]
    (imu,), (stamped,), (tf,) = said.values()
    (transform,) = tf.transforms
    assert imu.header.frame_id == transform.child_frame_id == "tip"
    assert stamped.header.frame_id == transform.header.frame_id == "world"
    for message in (imu, stamped, transform):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == T_NS
    for q in (imu.orientation, stamped.pose.orientation, transform.transform.rotation):
        assert (q.w, q.x, q.y, q.z) == Q
    for p in (stamped.pose.position, transform.transform.translation):
        assert (p.x, p.y, p.z) == (1.0, 2.0, 3.0)


def test_tilt_is_about_the_level_axes_and_heading_about_the_one_that_points_up(
    translator: Translator,
) -> None:
    # On its side, the probe's own x points up: what is said stays the world's.
    on_its_side = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    (imu,) = said_by(translator, pose(q=on_its_side))["/imud/tip/imu/data"]
    expected = np.diag(np.radians([0.5, 0.5, 2.0]) ** 2)
    assert np.array_equal(imu.orientation_covariance.reshape(3, 3), expected)


def test_a_free_heading_may_be_anything(translator: Translator) -> None:
    (imu,) = said_by(translator, pose(heading_sigma_deg=None))["/imud/tip/imu/data"]
    turns = np.linspace(-np.pi, np.pi, 100_001)
    assert pytest.approx(turns.var(), rel=1e-4) == FREE_RAD2
    assert imu.orientation_covariance[8] == FREE_RAD2


def test_an_orientation_that_still_settles_is_not_said(translator: Translator) -> None:
    said = said_by(translator, pose(tilt_sigma_deg=None, heading_sigma_deg=None))
    assert list(said) == ["/imud/tip/imu/data"]
    (imu,) = said["/imud/tip/imu/data"]
    assert imu.orientation_covariance[0] == -1


def test_without_samples_an_imu_says_that_it_has_none(translator: Translator) -> None:
    (imu,) = said_by(translator, pose())["/imud/tip/imu/data"]
    assert imu.angular_velocity_covariance[0] == -1
    assert imu.linear_acceleration_covariance[0] == -1


@pytest.mark.parametrize("age_us", [0, 5_000, 20_000, -20_000])
def test_a_pose_is_joined_with_the_sample_before_it(
    translator: Translator, age_us: int
) -> None:
    before = pose(t_device_us=999_000)
    said = said_by(translator, before, raw(), pose(t_device_us=1_000_000 + age_us))
    imu = said["/imud/tip/imu/data"][-1]
    rate, force = imu.angular_velocity, imu.linear_acceleration
    assert (rate.x, rate.y, rate.z) == RATE
    assert (force.x, force.y, force.z) == FORCE
    assert not imu.angular_velocity_covariance.any()
    assert not imu.linear_acceleration_covariance.any()


def test_an_old_sample_is_not_joined(translator: Translator) -> None:
    said = said_by(translator, pose(), raw(), pose(t_device_us=1_020_001))
    first, last = said["/imud/tip/imu/data"]
    assert first.angular_velocity_covariance[0] == -1
    assert last.angular_velocity_covariance[0] == -1


def test_samples_without_poses_go_out_by_themselves(translator: Translator) -> None:
    said = said_by(translator, raw(), pose(), raw(t_device_us=2_000_000))
    assert len(said["/imud/tip/imu/data"]) == 2  # the first, and the pose's
    (imu,) = said_by(translator, raw(t_device_us=2_000_001))["/imud/tip/imu/data"]
    assert imu.orientation_covariance[0] == -1
    assert imu.angular_velocity.x == RATE[0]


def test_samples_before_the_first_hello_have_no_scale(translator: Translator) -> None:
    assert said_by(translator, raw(acc_m_s2=None, gyr_rad_s=None)) == {}


def test_a_magnetic_field_is_in_tesla(translator: Translator) -> None:
    said = said_by(translator, pose(), raw(mag_uT=(20.0, -1.0, 45.0)))
    (mag,) = said["/imud/tip/imu/mag"]
    field = mag.magnetic_field
    assert (field.x, field.y, field.z) == pytest.approx((20e-6, -1e-6, 45e-6))
    assert mag.header.frame_id == "tip"
    assert not mag.magnetic_field_covariance.any()


def verdict(translator: Translator, **fields: Any) -> tuple[int, str]:
    (message,) = said_by(translator, status(**fields))["/diagnostics"]
    (one,) = message.status
    assert (one.name, one.hardware_id) == ("imud: tip", "00112233445566aa")
    return one.level, one.message


def test_the_state_of_a_probe_is_a_level(translator: Translator) -> None:
    assert verdict(translator) == (Level.OK, "streaming")
    assert verdict(translator, state="idle") == (Level.OK, "idle")
    assert verdict(translator, state="gone") == (Level.STALE, "gone")
    assert verdict(translator, state="silent") == (Level.STALE, "silent")
    assert verdict(translator, state="fault") == (Level.ERROR, "fault")
    assert verdict(translator, state="other schema") == (Level.ERROR, "other schema")


def test_what_a_pose_lacks_is_a_warning_while_it_streams(
    translator: Translator,
) -> None:
    flawed = {"flags": ["at_rest", "mag_disturbed", "gap"]}
    assert verdict(translator, quality=flawed) == (
        Level.WARN,
        "magnetic field is disturbed, samples are missing",
    )
    assert verdict(translator, state="idle", quality=flawed) == (Level.OK, "idle")
    assert verdict(translator, equipment={"power": ["low"], "clock": "spare"}) == (
        Level.WARN,
        "battery is low, crystal has failed",
    )


def test_a_loss_is_a_warning_once(translator: Translator) -> None:
    ledger = {"lost": 1, "earlier_boots": {"lost": 2}, "corrupt": 4}
    ledger |= {"dropped": {"log": 5, "zenoh": 1}}
    told = (Level.WARN, "3 lost, 4 corrupt, 6 dropped")
    assert verdict(translator, ledger=ledger) == told
    assert verdict(translator, ledger=ledger) == (Level.OK, "streaming")
    restarted = {"lost": 0, "earlier_boots": {"lost": 4}}
    told_again = verdict(translator, ledger=ledger | restarted)
    assert told_again == (Level.WARN, "1 lost")


def test_figures_of_a_probe_are_in_its_diagnostics(translator: Translator) -> None:
    (message,) = said_by(translator, status(equipment={"battery_v": 3.9}))[
        "/diagnostics"
    ]
    values = {pair.key: pair.value for pair in message.status[0].values}
    assert values["pose_rate_hz"] == "100.0"
    assert values["tilt_sigma_deg"] == "0.5"
    assert values["heading_sigma_deg"] == "unknown"
    assert (values["received"], values["lost"], values["dropped"]) == ("10", "0", "0")
    assert values["battery_v"] == "3.9"


def test_a_status_of_which_little_is_known_is_said(translator: Translator) -> None:
    bare = status(quality=None, ledger=None, state=None)
    (message,) = said_by(translator, bare)["/diagnostics"]
    assert message.status[0].level == Level.OK


def refused(directory: Path, text: str) -> str:
    path = directory / "imud.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError) as told:
        reader.load(path)
    return str(told.value)


@pytest.mark.parametrize("namespace", ["/imud", "imud/", "a//b", "1st", "a b", "a__b"])
def test_a_namespace_that_ros_refuses_is_refused(
    tmp_path: Path, namespace: str
) -> None:
    said = refused(tmp_path, f'[ros2]\nenabled = true\nnamespace = "{namespace}"\n')
    assert f"[ros2] namespace: {namespace!r} can't be part of a topic" in said


def test_two_probes_of_one_name_in_ros_are_refused(tmp_path: Path) -> None:
    probes = "".join(
        f'[probes.001122334455660{n}]\nname = "{name}"\n'
        for n, name in enumerate(("arm-left", "arm_left"))
    )
    said = refused(tmp_path, f"[ros2]\nenabled = true\n{probes}")
    assert "'arm_left' and 'arm-left' are both arm_left in ROS" in said


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
    """What its discovery lists, once that is true."""
    until = time.monotonic() + PATIENCE_S
    while True:
        port = int(endpoint.rpartition(":")[2])
        found = discovery.get_topic_names_and_types(domain, "127.0.0.1", port)
        topics = dict(found)
        if is_so(topics):
            return topics
        assert time.monotonic() < until, topics
        time.sleep(0.05)


BASE = "/imud/probe_00112233445566aa"
EXPECTED = {
    f"{BASE}/imu/data": ["sensor_msgs/msg/Imu"],
    f"{BASE}/imu/mag": ["sensor_msgs/msg/MagneticField"],
    f"{BASE}/pose": ["geometry_msgs/msg/PoseStamped"],
    "/tf": ["tf2_msgs/msg/TFMessage"],
    "/diagnostics": ["diagnostic_msgs/msg/DiagnosticArray"],
}


def test_a_daemon_is_a_node_that_another_implementation_finds_and_reads(
    tmp_path: Path, ros: Callable[[str], ZenohSession]
) -> None:
    settings = tmp_path / "imud.toml"
    settings.write_text("[ros2]\nenabled = true\ndomain = 5\n", "utf-8")
    probe, port = FakeProbe(), Port(tmp_path / "port")
    with DaemonProcess(
        port.path, "--config", settings, directory=tmp_path, log=False
    ) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        session = ros(daemon.endpoint)
        topics = topics_when(daemon.endpoint, 5, lambda found: len(found) >= 5)
        assert topics == EXPECTED

        heard: queue.Queue[tuple[str, bytes, bytes, str]] = queue.Queue()

        def hear(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            assert sample.attachment is not None
            heard.put(
                (key, sample.payload.to_bytes(), sample.attachment.to_bytes(), key)
            )

        subscriber = session.session.declare_subscriber("5/**", hear)
        said: dict[str, list[tuple[Any, other_attachment.Attachment]]] = {}
        until = time.monotonic() + PATIENCE_S
        while len(said) < 5 or len(said[f"{BASE}/pose"]) < 5:
            assert time.monotonic() < until, {name: len(m) for name, m in said.items()}
            port.write(probe.say("raw") + probe.say("pose"))
            try:
                key, payload, attached, _ = heard.get(timeout=0.02)
            except queue.Empty:
                continue
            _, *parts, dds, _ = key.split("/")
            kind = next(kind for kind in ros2.TYPES if kind.dds == dds)
            message = JAZZY.deserialize_cdr(payload, kind.name)
            attachment = other_attachment.Attachment.from_bytes(attached)
            said.setdefault("/" + "/".join(parts), []).append((message, attachment))

        imu, _ = said[f"{BASE}/imu/data"][-1]
        q = imu.orientation
        assert (q.w, q.x, q.y, q.z) == pytest.approx(POSE["q"])
        assert imu.header.frame_id == "probe_00112233445566aa"
        sigmas = [POSE["tilt_sigma"], POSE["tilt_sigma"], POSE["heading_sigma"]]
        expected = np.diag(np.radians(sigmas) ** 2)
        assert imu.orientation_covariance.reshape(3, 3) == pytest.approx(expected)
        assert imu.linear_acceleration.z == pytest.approx(2048 * HELLO["acc_lsb"])
        mag, _ = said[f"{BASE}/imu/mag"][-1]
        assert mag.magnetic_field.z == pytest.approx(45e-6)

        tokens: set[str] = set()
        while len(tokens) < 6:
            assert time.monotonic() < until, tokens
            replies = session.liveliness.get("@ros2_lv/5/**")
            tokens |= {str(reply.ok.key_expr) for reply in replies if reply.ok}
        # Each entity of the node has a number of its own: the node itself has 0.
        assert sorted(token.split("/")[4] for token in tokens) == list("012345")
        gids = {ros2.gid_of(token) for token in tokens if "/MP/" in token}
        assert sum("/NN/" in token for token in tokens) == 1
        for name, messages in said.items():
            numbers = [attachment.sequence_id for _, attachment in messages]
            assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), name
            (gid,) = {attachment.gid for _, attachment in messages}
            gids.remove(gid)
        assert gids == set()
        assert len({str(attachment) for _, attachment in said["/tf"]}) == len(
            said["/tf"]
        )

        subscriber.undeclare()
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
