# SPDX-License-Identifier: MIT
"""Publishes on a topic so that ROS nodes find it."""

from __future__ import annotations

import time

import zenoh

from imud.ros2 import topics
from imud.ros2.topics import Node, Topic


class RosPublisher:
    """One topic: a Zenoh publisher, and the token by which ROS nodes discover it."""

    def __init__(
        self, session: zenoh.Session, node: Node, number: int, topic: Topic
    ) -> None:
        token = node.publisher_token(number, topic)
        self._gid = topics.gid_of(token)
        self._sent = 0
        self._publisher = session.declare_publisher(
            topic.key(node.domain), congestion_control=zenoh.CongestionControl.DROP
        )
        self._token = session.liveliness().declare_token(token)

    def put(self, data: bytes) -> None:
        self._sent += 1
        attachment = topics.attachment(self._sent, time.time_ns(), self._gid)
        self._publisher.put(data, attachment=attachment)
