# SPDX-License-Identifier: MIT
"""What the outputs share: what they are told, which parts of a pose have a stated
error, a UDP socket, and the library that an output needs.
"""

from __future__ import annotations

import importlib
import logging
import socket
from typing import Any, ClassVar, NamedTuple

import msgspec

from imud.client import Body, Event, Mark, Pose, Status, Topic
from imud.endpoint import host_and_port
from imud.errors import ConfigError, reason
from imud.probes.aim import sigmas_of
from imud.rotation import Quat

logger = logging.getLogger("imud")

# States of a probe in which nothing of it can be known; AWAY: its daemon is.
AWAY = "away"
ABSENT = frozenset({AWAY, "gone", "silent", "other schema"})
STREAMING = "streaming"


class Output:
    """Ignores everything: an output has those methods that it needs. All are called in
    one thread, its own.
    """

    topics: ClassVar[tuple[Topic, ...]] = ("pose", "status")
    rate_hz = 0.0  # most poses of a probe per second; 0: all

    def pose(self, pose: Pose) -> None:
        """Of a probe, at most so often."""

    def status(self, status: Status) -> None:
        """Of each probe once a second; while the daemon is away, with that state."""

    def event(self, event: Event) -> None:
        """As it is published."""

    def mark(self, mark: Mark) -> None:
        """As it is published."""

    def body(self, body: Body) -> None:
        """As it is published."""

    def tick(self) -> None:
        """Once a second."""

    def close(self) -> None:
        """Ends it."""


class Shown(NamedTuple):
    """The parts of a pose whose errors are stated. None: withheld, so not sent."""

    q: Quat | None
    tilt_sigma_deg: float | None
    heading_sigma_deg: float | None
    has_heading: bool


def shown(pose: Pose, *, relative_heading: bool) -> Shown:
    """With an origin, errors are those since it. `relative_heading`: the orientation is
    shown whatever its heading is worth.
    """
    sigmas = sigmas_of(msgspec.structs.asdict(pose))
    has_level = pose.tilt_sigma_deg is not None and sigmas.tilt is not None
    has_heading = has_level and (relative_heading or sigmas.heading is not None)
    quat = pose.q if has_heading else None
    return Shown(quat, sigmas.tilt if has_level else None, sigmas.heading, has_heading)


class Udp:
    """Datagrams to one receiver. One that is away, or slow, loses them, and nobody
    waits for it.
    """

    def __init__(self, name: str, to: str) -> None:
        self._name, self._to = name, to
        address = host_and_port(to) or ("", 0)
        try:
            (family, _, _, _, where), *_ = socket.getaddrinfo(
                *address, type=socket.SOCK_DGRAM
            )
        except OSError as error:
            raise ConfigError(f"[{name}] to: {to}: {reason(error)}") from error
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(where)
        self._trouble = ""

    def send(self, data: bytes) -> None:
        trouble = self._tried(data)
        if trouble:  # that of the datagram before this one, which is not sent
            self._tried(data)
        if trouble != self._trouble:
            self._trouble = trouble
            logger.warning("%s: %s: %s", self._name, self._to, trouble or "sends again")

    def _tried(self, data: bytes) -> str:
        try:
            self._socket.send(data)
        except ConnectionRefusedError:
            return "nobody receives there; sending goes on"
        except OSError as error:
            return reason(error)
        return ""

    def close(self) -> None:
        self._socket.close()


def library(module: str, extra: str) -> Any:
    """A module that only this output needs; ConfigError says what to install."""
    try:
        return importlib.import_module(module)
    except (ImportError, RuntimeError) as error:  # pylsl raises that without liblsl
        has_it = isinstance(error, RuntimeError)
        raise ConfigError(
            f"{module} does not find its C library; see docs/bridge.md"
            if has_it
            else f"this output needs a library: pip install 'imu-probe[{extra}]'"
        ) from error
