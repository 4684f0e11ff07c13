# SPDX-License-Identifier: MIT
"""MAVLink 2: each probe is a component, an IMU, with a HEARTBEAT a second and its
attitude with the covariance of its error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from imud.bridge.output import ABSENT, STREAMING, Output, Udp, library, shown
from imud.client import Pose, Status
from imud.config.settings import MavlinkSettings
from imud.ros2.covariance import FREE_RAD2, orientation_covariance
from imud.rotation import Quat, multiply

# north-east-down from east-north-up, and the body's axes from x ahead, y left, z up.
NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
FRD = np.array([0.0, 1.0, 0.0, 0.0])
PER_SYSTEM = 3  # components that are an IMU
# The cosine of a pitch at which roll and yaw can't be told apart.
UPRIGHT = 0.02


class _Link:
    """The file that pymavlink's encoder writes to."""

    def __init__(self, udp: Udp) -> None:
        self.write = udp.send


class MavlinkOutput(Output):
    """In the order in which they appear, probes are components 200 to 202 of a system,
    then of the next one. One that is away has no heartbeat.
    """

    def __init__(self, settings: MavlinkSettings) -> None:
        self._mavlink = library("pymavlink.dialects.v20.common", "mavlink")
        self._settings = settings
        self.rate_hz = settings.rate_hz
        self._udp = Udp("mavlink", settings.to)
        self._components: dict[str, Any] = {}

    def pose(self, pose: Pose) -> None:
        stated = shown(pose, relative_heading=self._settings.relative_heading)
        if stated.q is None:
            return
        quat, unknown = ned_of(stated.q), math.nan
        self._component(pose.probe).attitude_quaternion_cov_send(
            (pose.t_ns or 0) // 1000,
            quat,
            *(unknown, unknown, unknown),  # rates: a pose has none
            euler_covariance(
                quat, orientation_covariance(msgspec.structs.asdict(pose))
            ),
        )

    def status(self, status: Status) -> None:
        if status.state in ABSENT:
            return
        kinds = self._mavlink
        state = kinds.MAV_STATE_STANDBY
        if status.state == "fault" or status.sensors.get("words"):
            state = kinds.MAV_STATE_CRITICAL
        elif status.state == STREAMING:
            state = kinds.MAV_STATE_ACTIVE
        elif status.state == "calibrating":
            state = kinds.MAV_STATE_CALIBRATING
        self._component(status.probe).heartbeat_send(
            kinds.MAV_TYPE_IMU, kinds.MAV_AUTOPILOT_INVALID, 0, 0, state
        )

    def _component(self, probe: str) -> Any:
        if probe not in self._components:
            further, unit = divmod(len(self._components), PER_SYSTEM)
            system = self._settings.system + further
            component = self._mavlink.MAV_COMP_ID_IMU + unit
            self._components[probe] = self._mavlink.MAVLink(
                _Link(self._udp), system, component
            )
        return self._components[probe]

    def close(self) -> None:
        self._udp.close()


def ned_of(quat: Quat) -> Quat:
    """The same attitude in MAVLink's frames, in which z is down."""
    w, x, y, z = multiply(multiply(NED, np.array(quat)), FRD).tolist()
    return w, x, y, z


def euler_covariance(quat: Quat, world: Sequence[float]) -> tuple[float, ...]:
    """Of roll, pitch and yaw, rad^2, from errors about level axes and the vertical."""
    tilt, heading = world[0], world[8]
    w, x, y, z = quat
    sine = max(-1.0, min(1.0, 2.0 * (w * y - z * x)))
    cosine = math.sqrt(1.0 - sine * sine)
    if cosine < UPRIGHT:
        return FREE_RAD2, 0.0, 0.0, 0.0, tilt, 0.0, 0.0, 0.0, FREE_RAD2
    roll, both = tilt / cosine**2, tilt * sine / cosine**2
    yaw = heading + tilt * (sine / cosine) ** 2
    return roll, 0.0, both, 0.0, tilt, 0.0, both, 0.0, yaw
