# SPDX-License-Identifier: MIT
"""Publishes poses, samples and status of each probe as ROS 2 messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
import zenoh

from imud.net import network
from imud.net.network import Credentials
from imud.probes.ledger import totals
from imud.probes.path import StrokePath
from imud.probes.record import Presence, Record
from imud.probes.sample_error import SampleError
from imud.probes.signs import Signs
from imud.published import POSE_NUMBERS
from imud.ros2 import cdr, topics
from imud.ros2.cdr import Diagnosis, Level, PathPoint
from imud.ros2.covariance import orientation_covariance
from imud.ros2.publisher import RosPublisher
from imud.ros2.topics import Node, Topic

NODE = "imud"
TF = Topic("/tf", topics.TF_MESSAGE, 100)
DIAGNOSTICS = Topic("/diagnostics", topics.DIAGNOSTIC_ARRAY)

# An Imu message has the angular rate and acceleration of the latest sample, up to this
# age: two periods of 100 Hz. At equal rates pose and sample are of the same time.
JOIN_US = 20_000

# After so long without a pose, samples are published without an orientation.
ALONE_US = 1_000_000

# Places of a path, the newest: each takes 90 bytes of every message.
PATH_MAX = 1000

NOTHING = (0.0, 0.0, 0.0)
UNTURNED = (1.0, 0.0, 0.0, 0.0)

# Flags of a pose that a user should know of, in words; the others are no fault.
FLAWS = {
    "starting": "still settles",
    "uncalibrated": "gyroscope is not calibrated",
    "mag_disturbed": "magnetic field is disturbed",
    "mag_absent": "no magnetometer",
    "clipped": "a sensor reached its range",
    "heading_free": "heading is relative and drifts",
    "gap": "samples are missing",
    "self_test_failed": "a sensor failed its self-test",
}
STALE_STATES = frozenset({"gone", "silent"})
ERROR_STATES = frozenset({"fault", "other schema"})

Fields = Mapping[str, Any]
RosMessage = tuple[Topic, bytes]


def _diagonal(square: float | None, unknown: Sequence[float]) -> Sequence[float]:
    if square is None:
        return unknown
    return (square, 0.0, 0.0, 0.0, square, 0.0, 0.0, 0.0, square)


class RosTranslator:
    """Turns the records of one probe into ROS 2 messages. No I/O."""

    def __init__(self, probe: str, namespace: str, world: str) -> None:
        self._world = world
        self.frame = topics.ros_name(probe)
        # The axes of the world, with the probe at the origin.
        self.level = f"{self.frame}_level"
        base = f"/{namespace}/{self.frame}" if namespace else f"/{self.frame}"
        self.imu = Topic(f"{base}/imu/data", topics.IMU)
        self.mag = Topic(f"{base}/imu/mag", topics.MAGNETIC_FIELD)
        self.pose = Topic(f"{base}/pose", topics.POSE_STAMPED)
        self.tip = Topic(f"{base}/tip", topics.POINT_STAMPED)
        self.path = Topic(f"{base}/path", topics.PATH)
        self._path = StrokePath()
        self._rest: PathPoint | None = None  # the last pose outside strokes, if known
        # Where it began comes first.
        self._stops: deque[PathPoint] = deque(maxlen=PATH_MAX)
        self._has_path = False  # one that is not empty was published
        self._sample: Fields | None = None
        self._errors = SampleError()
        self._pose_us: int | None = None
        self._signs = Signs()
        self._losses: dict[str, int] = {}

    @property
    def topics(self) -> tuple[Topic, ...]:
        own = (self.imu, self.mag, self.pose, self.tip, self.path)
        return (*own, TF, DIAGNOSTICS)

    def translate(self, record: Record) -> Iterator[RosMessage]:
        """The ROS 2 messages that follow from a record; none from most topics."""
        if record.topic == "pose":
            yield from self._take_pose(record.t_ns, record.values)
        elif record.topic == "raw":
            errors = self._errors
            if (record.hello, record.params) != (errors.hello, errors.params):
                self._errors = SampleError(record.hello, record.params)
            yield from self._take_raw(record.t_ns, record.values)
        elif record.topic in ("stroke", "event"):
            if self._path.add(record.values):
                yield from self._another_path(record.t_ns)
        elif record.topic == "status" and record.payload:
            status: Fields = msgspec.json.decode(record.payload)
            diagnoses = [self.diagnose(status)]
            yield DIAGNOSTICS, cdr.diagnostic_array(record.t_ns, "", diagnoses)

    def _take_pose(self, t_ns: int, pose: Fields) -> Iterator[RosMessage]:
        covariance = orientation_covariance(pose)
        self._pose_us = pose["t_device_us"]
        orientation = self._signs.steady(pose["q"], self._pose_us)
        yield self._imu(t_ns, orientation, covariance, self._joined(self._pose_us))
        # These messages can't express that the orientation or position is unknown.
        if covariance is cdr.ABSENT:
            return
        yield TF, cdr.transform(t_ns, self.level, self.frame, NOTHING, orientation)
        position = pose["position_m"]
        stop = None if position is None else PathPoint(t_ns, position, orientation)
        if position is not None:
            yield (
                self.pose,
                cdr.pose_stamped(t_ns, self._world, position, orientation),
            )
            yield self.tip, cdr.point_stamped(t_ns, self._world, position)
            yield TF, cdr.transform(t_ns, self._world, self.level, position, UNTURNED)
        if not self._path.is_moving:
            self._rest = stop
        if self._path.add_pose(pose) and stop is not None:
            self._stops.append(stop)
            yield self._whole_path(t_ns)

    def _another_path(self, t_ns: int) -> Iterator[RosMessage]:
        """It begins where the tip rested. An empty one: that place is not known."""
        self._stops.clear()
        if self._path.places and self._rest is not None:
            self._stops.append(self._rest)
        if self._has_path and not self._stops:
            yield self._whole_path(t_ns)

    def _whole_path(self, t_ns: int) -> RosMessage:
        """Since the origin."""
        self._has_path = bool(self._stops)
        return self.path, cdr.path(t_ns, self._world, self._stops)

    def _take_raw(self, t_ns: int, raw: Fields) -> Iterator[RosMessage]:
        t_us: int = raw["t_device_us"]
        if raw["acc_m_s2"] is not None and raw["gyr_rad_s"] is not None:
            self._sample = raw
            if self._pose_us is None or abs(t_us - self._pose_us) > ALONE_US:
                yield self._imu(t_ns, UNTURNED, cdr.ABSENT, raw)
        if raw["mag_uT"] is not None:
            field_t = [value * 1e-6 for value in raw["mag_uT"]]
            ut2 = self._errors.field_ut2
            # In this message, all zeros mean unknown.
            of_field = _diagonal(None if ut2 is None else ut2 * 1e-12, cdr.UNKNOWN)
            data = cdr.magnetic_field(t_ns, self.frame, field_t, of_field)
            yield self.mag, data

    def _joined(self, t_us: int) -> Fields | None:
        sample = self._sample
        if sample is None or abs(t_us - sample["t_device_us"]) > JOIN_US:
            return None
        return sample

    def _imu(
        self,
        t_ns: int,
        orientation: Sequence[float],
        covariance: Sequence[float],
        sample: Fields | None,
    ) -> RosMessage:
        rate = NOTHING if sample is None else sample["gyr_rad_s"]
        force = NOTHING if sample is None else sample["acc_m_s2"]
        of_rate = of_force = cdr.ABSENT
        if sample is not None:
            errors = self._errors
            # Zeros would say that nothing is wrong with it: readers ignore a -1.
            of_rate = _diagonal(errors.rate_rad2_s2(sample["gyr_rad_s"]), cdr.ABSENT)
            of_force = _diagonal(errors.force_m2_s4, cdr.ABSENT)
        data = cdr.imu(
            t_ns, self.frame, orientation, covariance, rate, of_rate, force, of_force
        )
        return self.imu, data

    def diagnose(self, status: Fields) -> Diagnosis:
        """The state of a probe; a loss is a warning where it is first counted."""
        ledger = status.get("ledger") or {}
        losses = {
            "lost": totals(ledger).lost,
            "corrupt": ledger.get("corrupt") or 0,
            "dropped": sum((ledger.get("dropped") or {}).values()),
        }
        fresh = {
            name: count - self._losses.get(name, 0) for name, count in losses.items()
        }
        self._losses = losses
        level, message = _verdict(status, fresh)
        return Diagnosis(
            level,
            f"{NODE}: {status['probe']}",
            message,
            str(status.get("probe_id", "")),
            _values(status, ledger, losses),
        )


def _verdict(status: Fields, fresh: Mapping[str, int]) -> tuple[Level, str]:
    state = str(status.get("state"))
    if state in STALE_STATES:
        return Level.STALE, state
    words: Sequence[str] = (status.get("sensors") or {}).get("words") or ()
    if state in ERROR_STATES:
        is_known = state == "fault" and words
        return Level.ERROR, f"{state}: {words[0]}" if is_known else state
    equipment = status.get("equipment") or {}
    quality = status.get("quality") or {}
    flags = quality.get("flags") or ()
    flaws = [f"{count} {name}" for name, count in fresh.items() if count > 0]
    if state == "streaming":
        flaws += [FLAWS[flag] for flag in flags if flag in FLAWS]
        flaws += quality.get("withheld", {}).get("words", ())
    if "low" in (equipment.get("power") or ()):
        flaws.append("battery is low")
    if equipment.get("clock") == "spare":
        flaws.append("crystal has failed")
    return (Level.WARN, ", ".join(flaws)) if flaws else (Level.OK, state)


def _values(
    status: Fields, ledger: Fields, losses: Mapping[str, int]
) -> dict[str, str]:
    quality = status.get("quality") or {}
    equipment = status.get("equipment") or {}
    hello = status.get("hello") or {}
    values = {
        "state": status.get("state"),
        "port": status.get("port"),
        "pose_rate_hz": status.get("pose_rate_hz"),
        **{number: quality.get(number) for number in POSE_NUMBERS},
        "flags": " ".join(quality.get("flags") or ()),
        "sensors": "; ".join((status.get("sensors") or {}).get("words") or ()),
        "received": totals(ledger).received,
        **losses,
        "battery_v": equipment.get("battery_v"),
        "firmware": hello.get("firmware"),
        "imud": status.get("imud"),
    }
    return {
        name: "unknown" if value is None else str(value)
        for name, value in values.items()
    }


class Ros2Sink:
    """A ROS 2 node in a Zenoh session of its own; the routers may come and go."""

    name = "ros2"
    period_s = 0.0
    patience_s = 0.8

    def __init__(
        self,
        connect: Sequence[str],
        domain: int,
        namespace: str,
        world: str,
        mine: Credentials | None = None,
    ) -> None:
        self._connect = tuple(connect)
        self._mine = mine
        self._domain = domain
        self._namespace = namespace
        self._world = world
        self._session: zenoh.Session | None = None
        self._node: Node | None = None
        self._node_token: zenoh.LivelinessToken | None = None
        self._translators: dict[str, RosTranslator] = {}
        self._publishers: dict[str, RosPublisher] = {}

    def open(self) -> None:
        self._session = network.open_node(self._connect, self._mine)
        self._node = Node(self._domain, str(self._session.zid()), NODE)
        liveliness = self._session.liveliness()
        self._node_token = liveliness.declare_token(self._node.token)

    def write(self, record: Record | Presence) -> None:
        """Publishes a record as ROS 2 messages; announces the topics of a probe that is
        new.
        """
        if self._session is None or self._node is None:
            return
        translator = self._translators.get(record.probe)
        if translator is None:
            translator = RosTranslator(record.probe, self._namespace, self._world)
            self._translators[record.probe] = translator
        # Announced before the first message, so that readers can wait for it.
        for topic in translator.topics:
            if topic.name not in self._publishers:
                number = 1 + len(self._publishers)
                self._publishers[topic.name] = RosPublisher(
                    self._session, self._node, number, topic
                )
        if isinstance(record, Record):
            for topic, data in translator.translate(record):
                self._publishers[topic.name].put(data)

    def flush(self) -> None:
        """Nothing to do: a put is sent when it returns."""

    def close(self) -> None:
        session, self._session = self._session, None
        self._node_token = None
        self._publishers.clear()
        if session is not None:
            session.close()


def own_network(mode: str, listen: Sequence[str], connect: Sequence[str]) -> list[str]:
    """Endpoints by which a session on this machine reaches the daemon's network."""
    if mode != "router":
        return list(connect)
    # The address for all interfaces is none to connect to.
    return [
        endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
        for endpoint in listen
    ]
