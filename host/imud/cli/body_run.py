# SPDX-License-Identifier: MIT
"""Joins the poses of many daemons to a body; prints its state as lines or JSON, and
publishes it, also as a ROS 2 node (JointState and /tf, as rmw_zenoh expects them).
"""

from __future__ import annotations

import contextlib
import math
import queue
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec
import zenoh

from imud.body import chain
from imud.body.live import LiveBody
from imud.body.state import BodyState, JointState
from imud.client import Client, Delivery, Pose, Raw
from imud.errors import ConfigError
from imud.log.file import Settings
from imud.net import network
from imud.net.access import BODIES, BODY_STATE
from imud.probes.record import Record
from imud.ros2 import cdr, topics
from imud.ros2.cdr import Transform
from imud.ros2.publisher import RosPublisher
from imud.ros2.topics import Node, Topic
from imud.sinks.log import FLUSH_S, LogSink
from imud.sinks.ros2 import TF, RosMessage
from imud.text_file import read_text

PRINT_S = 1.0


class Printer:
    """Prints what the person should do, what is missing, and the angles."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._instruction: str | None = None
        self._missing: tuple[str, ...] = ()
        self._remarks: set[str] = set()
        self._printed_s = 0.0

    def put(self, state: BodyState, payload: bytes) -> None:
        """Prints `payload` as it is with --json; else what has changed in the state,
        and once every PRINT_S the angles.
        """
        if self._as_json:
            self._print(payload.decode())
            return
        if state.instruction != self._instruction:
            self._instruction = state.instruction
            self._print(
                f"{state.body}: {state.instruction or 'aligned; move as you like'}"
            )
        for remark in state.remarks:
            if remark not in self._remarks:
                self._remarks.add(remark)
                self._print(f"{state.body}: {remark}")
        if state.stage != "running":
            return
        if state.missing != self._missing:
            self._missing = state.missing
            away = [f"{s.name} {s.presence}" for s in state.segments]
            away = [s for s in away if not s.endswith(" ok")]
            self._print(f"{state.body}: {', '.join(away) or 'all probes are present'}")
        time_s = state.t_ns * 1e-9
        if time_s - self._printed_s >= PRINT_S:
            self._printed_s = time_s
            self._print("  ".join(map(line_of, state.joints)))

    def close(self) -> None:
        """Nothing to do: each line is out."""

    def _print(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


def line_of(joint: JointState) -> str:
    """The angles of a joint and their errors, degrees."""
    if joint.angles_deg is None or joint.sigmas_deg is None:
        return f"{joint.child}: unknown"
    parts = [
        f"{name} {angle:.0f}±{joint.sigmas_deg[name]:.0f}"
        for name, angle in joint.angles_deg.items()
    ]
    return f"{joint.child}: {' '.join(parts)}"


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
        """Publishes the joint states and transforms of a state."""
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


WAITING_MAX = 20_000  # messages, of many probes in seconds

Arrived = tuple[str, Delivery]  # a topic, and its message

_POSE, _RAW = msgspec.json.Decoder(Pose), msgspec.json.Decoder(Raw)
_ENCODER = msgspec.json.Encoder()


class BodySink(Protocol):
    """Where states go."""

    def put(self, state: BodyState, payload: bytes) -> None:
        """Takes a state, and the same as JSON."""

    def close(self) -> None:
        """Ends it."""


@dataclass(frozen=True, slots=True)
class Where:
    """The daemons."""

    endpoints: tuple[str, ...]
    prefix: str
    keys: Path | None


@dataclass(frozen=True, slots=True)
class How:
    """The published state, and its options. `facing_rad`: counterclockwise from
    east."""

    facing_rad: float | None
    delay_s: float
    rate_hz: float
    ros2_domain: int | None
    log: Path | None


def run(
    file: Path, where: Where, how: How, seconds: float | None, *, as_json: bool
) -> int:
    """Runs until Ctrl-C or for some seconds; returns 0.

    ConfigError for the body's file, DaemonNotFound, FileError.
    """
    body = LiveBody(chain.read(read_text(file), str(file)), how.facing_rad, how.delay_s)
    if where.keys is not None and network.read_credentials(where.keys).role != "daemon":
        raise ConfigError(
            f"{where.keys}: only the role daemon may publish a body; create its file "
            "with imud keys add DIR daemon NAME"
        )
    with contextlib.ExitStack() as stack:
        arrived: queue.Queue[Arrived] = queue.Queue(WAITING_MAX)
        clients = [
            stack.enter_context(Client(each, where.prefix, where.keys))
            for each in where.endpoints
        ]
        for client in clients:
            _listen(client, arrived)
        key = f"{where.prefix}/{BODIES}/{body.chain.name}"
        sinks: list[BodySink] = [_Network(clients[0].session, key)]
        if how.log is not None:
            sinks.append(_Log(how.log, where.prefix))
        if how.ros2_domain is not None:
            sinks.append(Ros2Body(where.endpoints[0], where.keys, how.ros2_domain))
        for sink in sinks:
            stack.callback(sink.close)
        until_s = time.monotonic() + seconds if seconds is not None else math.inf
        # Ended like by Ctrl-C: the log gets its end.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with contextlib.suppress(KeyboardInterrupt):
            _loop(body, arrived, [*sinks, Printer(as_json=as_json)], how, until_s)
    return 0


def _listen(client: Client, arrived: queue.Queue[Arrived]) -> None:
    """Puts what a daemon says of its probes into a queue; what has no room is lost."""

    def keep(topic: str, delivery: Delivery) -> None:
        with contextlib.suppress(queue.Full):
            arrived.put_nowait((topic, delivery))

    client.listen("pose", None, lambda delivery: keep("pose", delivery))
    client.listen("raw", None, lambda delivery: keep("raw", delivery))


def _loop(
    body: LiveBody,
    arrived: queue.Queue[Arrived],
    sinks: Sequence[BodySink],
    how: How,
    until_s: float,
) -> None:
    next_s = time.monotonic()
    while (now_s := time.monotonic()) < until_s:
        with contextlib.suppress(queue.Empty):
            while True:
                left_s = max(0.0, next_s - time.monotonic())
                add_delivery(body, *arrived.get(timeout=left_s))
        # A pause of this machine leaves out states: they would all be late.
        next_s = max(next_s + 1.0 / how.rate_hz, now_s)
        state = body.state(time.time())
        payload = _ENCODER.encode(state)
        for sink in sinks:
            sink.put(state, payload)


def add_delivery(body: LiveBody, topic: str, delivery: Delivery) -> None:
    """Gives a payload of a probe to the body; others, and bad ones, are left out."""
    histories = body.histories
    history = histories.get(delivery.probe) or histories.get(delivery.probe_id)
    if history is None:
        return
    with contextlib.suppress(msgspec.DecodeError):
        if topic == "pose":
            pose = _POSE.decode(delivery.payload)
            history.is_dated = pose.t_ns is not None and pose.t_bound_us is not None
            if pose.t_ns is not None and history.is_dated:
                history.bound_us = pose.t_bound_us
                history.look(pose.t_ns * 1e-9, pose.t_device_us, pose.flags)
                sigmas = _radians(pose.tilt_sigma_deg), _radians(pose.heading_sigma_deg)
                history.add_pose(pose.t_ns * 1e-9, pose.q, sigmas)
            return
        raw = _RAW.decode(delivery.payload)
        if raw.t_ns is not None and raw.gyr_rad_s and raw.acc_m_s2:
            time_s = raw.t_ns * 1e-9
            history.add_raw(time_s, raw.gyr_rad_s, raw.acc_m_s2, raw.flags)


def _radians(degrees: float | None) -> float:
    return math.nan if degrees is None else math.radians(degrees)


class _Network:
    """Publishes to the first daemon's network."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._publisher = session.declare_publisher(
            f"{key}/{BODY_STATE}",
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def put(self, state: BodyState, payload: bytes) -> None:  # noqa: ARG002 - BodySink
        self._publisher.put(payload)

    def close(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            self._publisher.undeclare()


class _Log:
    """Logs states as the daemon logs poses."""

    def __init__(self, directory: Path, prefix: str) -> None:
        self._sink = LogSink(directory, Settings(prefix=prefix))
        self._sink.open()
        self._flushed_s = time.monotonic()

    def put(self, state: BodyState, payload: bytes) -> None:
        name = f"{BODIES}/{state.body}"
        now_ns = state.t_ns + state.age_us * 1000
        self._sink.write(
            Record(name, BODY_STATE, payload, b"", state.number, state.t_ns, now_ns)
        )
        if time.monotonic() - self._flushed_s > FLUSH_S:
            self._flushed_s = time.monotonic()
            self._sink.flush()

    def close(self) -> None:
        self._sink.flush()
        self._sink.close()
