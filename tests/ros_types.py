# SPDX-License-Identifier: MIT
"""The messages of ROS 2 that imud says, for pycdr2: typed from their .msg files.

pycdr2 needs annotations as they are, so these have a file without the future import.
"""

from dataclasses import dataclass

from pycdr2 import IdlStruct
from pycdr2.types import array, float64, int32, sequence, uint8, uint32


@dataclass
class Time(IdlStruct, typename="Time"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="Header"):
    stamp: Time
    frame_id: str


@dataclass
class Quaternion(IdlStruct, typename="Quaternion"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Vector3(IdlStruct, typename="Vector3"):
    x: float64
    y: float64
    z: float64


@dataclass
class Imu(IdlStruct, typename="Imu"):
    header: Header
    orientation: Quaternion
    orientation_covariance: array[float64, 9]
    angular_velocity: Vector3
    angular_velocity_covariance: array[float64, 9]
    linear_acceleration: Vector3
    linear_acceleration_covariance: array[float64, 9]


@dataclass
class MagneticField(IdlStruct, typename="MagneticField"):
    header: Header
    magnetic_field: Vector3
    magnetic_field_covariance: array[float64, 9]


@dataclass
class Pose(IdlStruct, typename="Pose"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="PoseStamped"):
    header: Header
    pose: Pose


@dataclass
class Point(IdlStruct, typename="Point"):
    x: float64
    y: float64
    z: float64


@dataclass
class PointStamped(IdlStruct, typename="PointStamped"):
    header: Header
    point: Point


@dataclass
class Path(IdlStruct, typename="Path"):
    header: Header
    poses: sequence[PoseStamped]


@dataclass
class Transform(IdlStruct, typename="Transform"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="TransformStamped"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="TFMessage"):
    transforms: sequence[TransformStamped]


@dataclass
class JointState(IdlStruct, typename="JointState"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class KeyValue(IdlStruct, typename="KeyValue"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="DiagnosticStatus"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="DiagnosticArray"):
    header: Header
    status: sequence[DiagnosticStatus]
