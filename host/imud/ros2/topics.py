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

# A topic's or node's name without its namespace: no digit first, no __ inside.
NAME = r"[A-Za-z](_?[A-Za-z0-9])*_?"
NAMESPACE = rf"^({NAME}(/{NAME})*)?$"

_NO_NAME = re.compile(r"[^A-Za-z0-9]+")
_ADMIN_SPACE = "@ros2_lv"

# Sequence number, source time, length of the GID, the GID.
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_SIZE = 16


class Type(NamedTuple):
    """A message type with its hash of REP 2011, the same since Iron."""

    name: str
    rihs01: str

    @property
    def dds(self) -> str:
        """The name of the type in DDS."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"

    @property
    def hash(self) -> str:
        return f"RIHS01_{self.rihs01}"


IMU = Type(
    "sensor_msgs/msg/Imu",
    "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
)
MAGNETIC_FIELD = Type(
    "sensor_msgs/msg/MagneticField",
    "e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
)
POSE_STAMPED = Type(
    "geometry_msgs/msg/PoseStamped",
    "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
)
POINT_STAMPED = Type(
    "geometry_msgs/msg/PointStamped",
    "4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897",
)
PATH = Type(
    "nav_msgs/msg/Path",
    "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
)
TF_MESSAGE = Type(
    "tf2_msgs/msg/TFMessage",
    "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
)
DIAGNOSTIC_ARRAY = Type(
    "diagnostic_msgs/msg/DiagnosticArray",
    "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)
JOINT_STATE = Type(
    "sensor_msgs/msg/JointState",
    "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)
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
