# SPDX-License-Identifier: MIT
"""ROS 2 over Zenoh as rmw_zenoh has it: names, keys, liveliness tokens, attachments.

Source: the design document of ros2/rmw_zenoh, and liveliness_utils.cpp, qos.cpp and
attachment_helpers.cpp of its rmw_zenoh_cpp/src/detail.
"""

from __future__ import annotations

import re
import struct
from typing import NamedTuple

import xxhash

from imud.ros2.hashes import RIHS01

# A topic's or node's name without its namespace: no digit first, no __ inside.
NAME = r"[A-Za-z](_?[A-Za-z0-9])*_?"
NAMESPACE = rf"^({NAME}(/{NAME})*)?$"

_NO_NAME = re.compile(r"[^A-Za-z0-9]+")
_ADMIN_SPACE = "@ros2_lv"

# Sequence number, source time, length of the GID, the GID.
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_SIZE = 16


class Type(NamedTuple):
    """A message type. protocol/generate.py finds the hashes of those below."""

    name: str

    @property
    def dds(self) -> str:
        """The name of the type in DDS."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"

    @property
    def hash(self) -> str:
        """Of REP 2011."""
        return RIHS01[self.name]


IMU = Type("sensor_msgs/msg/Imu")
MAGNETIC_FIELD = Type("sensor_msgs/msg/MagneticField")
POSE_STAMPED = Type("geometry_msgs/msg/PoseStamped")
POINT_STAMPED = Type("geometry_msgs/msg/PointStamped")
PATH = Type("nav_msgs/msg/Path")
TF_MESSAGE = Type("tf2_msgs/msg/TFMessage")
DIAGNOSTIC_ARRAY = Type("diagnostic_msgs/msg/DiagnosticArray")
JOINT_STATE = Type("sensor_msgs/msg/JointState")
TYPES = (
    IMU,
    MAGNETIC_FIELD,
    POSE_STAMPED,
    POINT_STAMPED,
    PATH,
    TF_MESSAGE,
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
)


class Topic(NamedTuple):
    """A topic by its full name. `depth`: messages kept for each reader."""

    name: str
    type: Type
    depth: int = 10  # as in ROS' own profiles; /tf has 100

    def key(self, domain: int) -> str:
        """The Zenoh key on which it is published."""
        return f"{domain}/{self.name.strip('/')}/{self.type.dds}/{self.type.hash}"

    @property
    def qos(self) -> str:
        """Reliable, volatile, keep the last `depth`; empty parts are the default."""
        return f"::,{self.depth}:,:,:,,"


class Node(NamedTuple):
    """The only node of a Zenoh session, in the root namespace."""

    domain: int
    session_id: str
    name: str

    @property
    def token(self) -> str:
        """The key of the node's liveliness token."""
        return f"{self._entity(0, 'NN')}"

    def publisher_token(self, number: int, topic: Topic) -> str:
        """The key of a publisher's liveliness token.

        `number`: 1 and up, another for each publisher; the node itself is 0.
        """
        return "/".join(
            (
                self._entity(number, "MP"),
                mangled(topic.name),
                topic.type.dds,
                topic.type.hash,
                topic.qos,
            )
        )

    def _entity(self, number: int, kind: str) -> str:
        # Enclave and namespace are empty: each a slash, mangled to %.
        place = f"{_ADMIN_SPACE}/{self.domain}/{self.session_id}/0/{number}"
        return f"{place}/{kind}/%/%/{self.name}"


def mangled(name: str) -> str:
    """A name with slashes as one part of a key."""
    return name.replace("/", "%")


def ros_name(text: str) -> str:
    """A probe's name as a name in ROS: a part of its topics, and its frame_id."""
    name = _NO_NAME.sub("_", text)
    return name if re.match("[A-Za-z]", name) else f"probe_{name.lstrip('_')}"


def gid_of(token: str) -> bytes:
    """A publisher's GID: XXH3-128 of its token, low half first."""
    digest = xxhash.xxh3_128_intdigest(token)
    return digest.to_bytes(_GID_SIZE, "little")


def attachment(number: int, t_ns: int, gid: bytes) -> bytes:
    """The attachment without which readers drop a message; `number` counts from 1."""
    return _ATTACHMENT.pack(number, t_ns, _GID_SIZE, gid)
