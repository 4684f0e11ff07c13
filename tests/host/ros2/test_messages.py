# SPDX-License-Identifier: MIT
"""Messages, types and keys of ROS 2 are those of other implementations."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from zenoh.ext import Int64, z_deserialize
from zenoh_ros2_sdk import attachment as other_attachment
from zenoh_ros2_sdk import entity, keyexpr, qos

from imud.ros2 import cdr
from imud.ros2 import topics as ros2
from imud.ros2.cdr import Diagnosis, Level
from imud.ros2.topics import Node, Topic
from imud.sinks.ros2 import DIAGNOSTICS, TF
from ros_values import FIELD, FORCE, JAZZY, RATE, T_NS, Q

TYPES = JAZZY.types

# One of each length that aligns what follows otherwise, and one that is not ASCII.
FRAMES = ("", "a", "ab", "abc", "abcd", "imu_12", "probe_00112233445566aa", "Mühle")

XYZW = (0.1, -0.2, 0.3, 0.9)
COVARIANCE = tuple(0.25 * n for n in range(9))


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


def make(name: str, *values: Any) -> Any:
    """A message of rosbags, by the last part of its name."""
    (full,) = (t for t in TYPES if t.endswith(f"/msg/{name}") and t in PARTS)
    return TYPES[full](*(np.array(v) if isinstance(v, tuple) else v for v in values))


def theirs(kind: ros2.Type, message: Any) -> bytes:
    """The bytes of another serialiser."""
    return bytes(JAZZY.serialize_cdr(message, kind.name))


def header(frame: str) -> Any:
    return make("Header", make("Time", *divmod(T_NS, 10**9)), frame)


def stamped(frame: str, child: str) -> Any:
    transform = make("Transform", make("Vector3", *FORCE), make("Quaternion", *XYZW))
    return make("TransformStamped", header(frame), child, transform)


def pose() -> Any:
    return make("Pose", make("Point", *FORCE), make("Quaternion", *XYZW))


@pytest.mark.parametrize("frame", FRAMES)
def test_an_imu_is_byte_for_byte_that_of_another_serialiser(frame: str) -> None:
    ours = cdr.imu(T_NS, frame, Q, COVARIANCE, RATE, cdr.UNKNOWN, FORCE, cdr.ABSENT)
    message = make(
        *("Imu", header(frame), make("Quaternion", *XYZW), COVARIANCE),
        *(make("Vector3", *RATE), (0.0,) * 9),
        *(make("Vector3", *FORCE), (-1.0,) + (0.0,) * 8),
    )
    assert theirs(ros2.IMU, message) == ours


@pytest.mark.parametrize("frame", FRAMES)
def test_a_field_a_pose_and_a_point_are_byte_for_byte_theirs(frame: str) -> None:
    head = header(frame)
    field = make("MagneticField", head, make("Vector3", *FIELD), COVARIANCE)
    ours = cdr.magnetic_field(T_NS, frame, FIELD, COVARIANCE)
    assert theirs(ros2.MAGNETIC_FIELD, field) == ours
    ours = cdr.pose_stamped(T_NS, frame, FORCE, Q)
    assert theirs(ros2.POSE_STAMPED, make("PoseStamped", head, pose())) == ours
    point = make("PointStamped", head, make("Point", *FORCE))
    assert theirs(ros2.POINT_STAMPED, point) == cdr.point_stamped(T_NS, frame, FORCE)


@pytest.mark.parametrize("count", [0, 1, 4])
@pytest.mark.parametrize("frame", FRAMES)
def test_a_path_is_byte_for_byte_theirs(frame: str, count: int) -> None:
    ours = cdr.path(T_NS, frame, [cdr.PathPoint(T_NS, FORCE, Q)] * count)
    stops = [make("PoseStamped", header(frame), pose()) for _ in range(count)]
    assert theirs(ros2.PATH, make("Path", header(frame), stops)) == ours


@pytest.mark.parametrize("count", range(len(FRAMES) + 1))
@pytest.mark.parametrize("frame", FRAMES[:5])
def test_transforms_are_byte_for_byte_theirs(frame: str, count: int) -> None:
    children = FRAMES[:count]
    ours = cdr.transforms(
        T_NS, [cdr.Transform(frame, child, FORCE, Q) for child in children]
    )
    message = make("TFMessage", [stamped(frame, child) for child in children])
    assert theirs(ros2.TF_MESSAGE, message) == ours


@pytest.mark.parametrize("child", FRAMES)
@pytest.mark.parametrize("frame", FRAMES[:5])
def test_a_transform_is_one_of_several(frame: str, child: str) -> None:
    several = cdr.transforms(T_NS, [cdr.Transform(frame, child, FORCE, Q)])
    assert cdr.transform(T_NS, frame, child, FORCE, Q) == several
    message = make("TFMessage", [stamped(frame, child)])
    assert theirs(ros2.TF_MESSAGE, message) == several


@pytest.mark.parametrize("names", [(), ("a",), ("shank_flexion", "foot_x", "ab")])
@pytest.mark.parametrize("frame", FRAMES[:5])
def test_joints_are_byte_for_byte_theirs(frame: str, names: tuple[str, ...]) -> None:
    angles = tuple(0.5 * n for n in range(len(names)))
    ours = cdr.joint_state(T_NS, frame, names, angles)
    message = make("JointState", header(frame), [*names], angles, (), ())
    assert theirs(ros2.JOINT_STATE, message) == ours


TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)


@given(
    frame=TEXT,
    diagnoses=st.lists(
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
    frame: str, diagnoses: list[Diagnosis]
) -> None:
    statuses = [
        make(
            *("DiagnosticStatus", int(one.level), one.name, one.message),
            *(
                one.hardware_id,
                [make("KeyValue", *pair) for pair in one.values.items()],
            ),
        )
        for one in diagnoses
    ]
    message = make("DiagnosticArray", header(frame), statuses)
    ours = cdr.diagnostic_array(T_NS, frame, diagnoses)
    assert theirs(ros2.DIAGNOSTIC_ARRAY, message) == ours


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
