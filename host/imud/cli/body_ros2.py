# SPDX-License-Identifier: MIT
"""A body as a ROS 2 node: JointState and /tf, by Zenoh as rmw_zenoh expects them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from imud.body.state import BodyState
from imud.net import network
from imud.ros2 import cdr, topics
from imud.ros2.cdr import Transform
from imud.ros2.publisher import RosPublisher
from imud.ros2.topics import Node, Topic
from imud.sinks.ros2 import TF, RosMessage

NODE = "imud_body"


def messages(state: BodyState) -> Iterator[RosMessage]:
    """The ROS 2 messages of a state, without missing joints and segments."""
    body = topics.ros_name(state.body)
    names, angles = [], []
    for joint in state.joints:
        for name, angle in (joint.angles_deg or {}).items():
            names.append(topics.ros_name(f"{joint.child}_{name}"))
            angles.append(math.radians(angle))
    if names:
        data = cdr.joint_state(state.t_ns, body, names, angles)
        yield joint_topic(state.body), data
    parts = [
        Transform(body, topics.ros_name(f"{state.body}_{s.name}"), s.start_m, s.q)
        for s in state.segments
        if s.start_m is not None and s.q is not None
    ]
    if parts:
        yield TF, cdr.transforms(state.t_ns, parts)


def joint_topic(body: str) -> Topic:
    return Topic(f"/imud/body/{topics.ros_name(body)}/joint_states", topics.JOINT_STATE)


class Ros2Body:
    """The node, in a Zenoh session of its own."""

    def __init__(self, endpoint: str, keys: Path | None, domain: int) -> None:
        mine = network.read_credentials(keys) if keys is not None else None
        self._session = network.open_node((endpoint,), mine)
        self._node = Node(domain, str(self._session.zid()), NODE)
        self._token = self._session.liveliness().declare_token(self._node.token)
        self._publishers: dict[str, RosPublisher] = {}

    def put(self, state: BodyState, payload: bytes) -> None:  # noqa: ARG002 - a sink's
        # Announced before the first message, so that readers can wait for it.
        for topic in (joint_topic(state.body), TF):
            if topic.name not in self._publishers:
                number = 1 + len(self._publishers)
                self._publishers[topic.name] = RosPublisher(
                    self._session, self._node, number, topic
                )
        for topic, data in messages(state):
            self._publishers[topic.name].put(data)

    def close(self) -> None:
        self._session.close()
