# SPDX-License-Identifier: MIT
"""Joins the poses of many daemons to a body, publishes and prints its state."""

from __future__ import annotations

import contextlib
import math
import queue
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec
import zenoh

from imud.body import chain
from imud.body.live import LiveBody
from imud.body.state import BodyState
from imud.cli.body_print import Printer
from imud.cli.body_ros2 import Ros2Body
from imud.client import Client, Delivery, Pose, Raw
from imud.errors import ConfigError
from imud.log.file import Settings
from imud.net import network
from imud.net.access import BODIES, BODY_STATE
from imud.probes.record import Record
from imud.sinks.log import FLUSH_S, LogSink
from imud.text_file import read_text

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
    history = body.histories.get(delivery.probe)
    if history is None:
        return
    with contextlib.suppress(msgspec.DecodeError):
        if topic == "pose":
            pose = _POSE.decode(delivery.payload)
            history.is_dated = pose.t_ns is not None and pose.t_bound_us is not None
            if pose.t_ns is not None and history.is_dated:
                history.bound_us = pose.t_bound_us
                sigmas = _radians(pose.tilt_sigma_deg), _radians(pose.heading_sigma_deg)
                history.add_pose(pose.t_ns * 1e-9, pose.q, sigmas)
            return
        raw = _RAW.decode(delivery.payload)
        if raw.t_ns is not None and raw.gyr_rad_s and raw.acc_m_s2:
            history.add_raw(raw.t_ns * 1e-9, raw.gyr_rad_s, raw.acc_m_s2)


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
