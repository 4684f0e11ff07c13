# SPDX-License-Identifier: MIT
"""ROS 2 messages as bytes: CDR of OMG's DDS-XTypes 1.3, section 7.4, little endian.

Each value is aligned to its size, counted from the end of the four bytes of the head.
Quaternions come in as this project says them, w first, and leave as ROS does, w last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

# Plain CDR, little endian, no options.
_HEAD = b"\x00\x01\x00\x00"

# One layout for each pair of frame names.
_LAYOUTS_MAX = 1024

_COUNT = Struct("<I")
_STAMP = Struct("<iI")

Vector = Sequence[float]

# 3 by 3 covariances, row by row, as sensor_msgs has them.
UNKNOWN: Vector = (0.0,) * 9
ABSENT: Vector = (-1.0,) + (0.0,) * 8  # the quantity itself is not available


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Diagnosis(NamedTuple):
    """A diagnostic_msgs/DiagnosticStatus."""

    level: Level
    name: str
    message: str
    hardware_id: str
    values: Mapping[str, str]


def imu(
    t_ns: int,
    frame: str,
    orientation: Vector,
    orientation_covariance: Vector,
    rate_rad_s: Vector,
    rate_covariance: Vector,
    force_m_s2: Vector,
    force_covariance: Vector,
) -> bytes:
    """sensor_msgs/Imu; `orientation` is w, x, y, z, covariances are 3 by 3."""
    w, x, y, z = orientation
    layout, text = _stamped(frame, 37)
    return layout.pack(
        _HEAD,
        *_stamp(t_ns),
        text,
        *(x, y, z, w),
        *orientation_covariance,
        *rate_rad_s,
        *rate_covariance,
        *force_m_s2,
        *force_covariance,
    )


def magnetic_field(t_ns: int, frame: str, field_t: Vector, covariance: Vector) -> bytes:
    """sensor_msgs/MagneticField; the field in tesla."""
    layout, text = _stamped(frame, 12)
    return layout.pack(_HEAD, *_stamp(t_ns), text, *field_t, *covariance)


def pose_stamped(
    t_ns: int, frame: str, position_m: Vector, orientation: Vector
) -> bytes:
    """geometry_msgs/PoseStamped; `orientation` is w, x, y, z."""
    w, x, y, z = orientation
    layout, text = _stamped(frame, 7)
    return layout.pack(_HEAD, *_stamp(t_ns), text, *position_m, x, y, z, w)


def point_stamped(t_ns: int, frame: str, position_m: Vector) -> bytes:
    """geometry_msgs/PointStamped."""
    layout, text = _stamped(frame, 3)
    return layout.pack(_HEAD, *_stamp(t_ns), text, *position_m)


class PathPoint(NamedTuple):
    """A place in m and attitude w, x, y, z at a time."""

    t_ns: int
    position_m: Vector
    orientation: Vector


def path(t_ns: int, frame: str, stops: Sequence[PathPoint]) -> bytes:
    """nav_msgs/Path; all of its poses are in that frame."""
    data = bytearray(_STAMP.pack(*_stamp(t_ns)))
    _add_text(data, frame)
    _add_count(data, len(stops))
    for stop in stops:
        data.extend(bytes(-len(data) % 4))
        data.extend(_STAMP.pack(*_stamp(stop.t_ns)))
        _add_text(data, frame)
        w, x, y, z = stop.orientation
        _add_doubles(data, (*stop.position_m, x, y, z, w))
    return _HEAD + data


def transform(
    t_ns: int, frame: str, child: str, translation_m: Vector, rotation: Vector
) -> bytes:
    """tf2_msgs/TFMessage with one transform; `rotation` is w, x, y, z."""
    w, x, y, z = rotation
    layout, texts = _transform(frame, child)
    return layout.pack(_HEAD, 1, *_stamp(t_ns), texts, *translation_m, x, y, z, w)


class Transform(NamedTuple):
    """A child's place in m and attitude w, x, y, z in a frame."""

    frame: str
    child: str
    translation_m: Vector
    rotation: Vector


def transforms(t_ns: int, parts: Sequence[Transform]) -> bytes:
    """tf2_msgs/TFMessage of several transforms of one time."""
    data = bytearray()
    _add_count(data, len(parts))
    for part in parts:
        data.extend(bytes(-len(data) % 4))
        data.extend(_STAMP.pack(*_stamp(t_ns)))
        _add_text(data, part.frame)
        _add_text(data, part.child)
        w, x, y, z = part.rotation
        _add_doubles(data, (*part.translation_m, x, y, z, w))
    return _HEAD + data


def joint_state(
    t_ns: int, frame: str, names: Sequence[str], position_rad: Vector
) -> bytes:
    """sensor_msgs/JointState of positions alone."""
    data = bytearray(_STAMP.pack(*_stamp(t_ns)))
    _add_text(data, frame)
    _add_count(data, len(names))
    for name in names:
        _add_text(data, name)
    for values in (position_rad, (), ()):
        _add_count(data, len(values))
        if values:
            _add_doubles(data, values)
    return _HEAD + data


def diagnostic_array(t_ns: int, frame: str, diagnoses: Sequence[Diagnosis]) -> bytes:
    """diagnostic_msgs/DiagnosticArray."""
    data = bytearray(_STAMP.pack(*_stamp(t_ns)))
    _add_text(data, frame)
    _add_count(data, len(diagnoses))
    for diagnosis in diagnoses:
        data.append(diagnosis.level)
        for text in (diagnosis.name, diagnosis.message, diagnosis.hardware_id):
            _add_text(data, text)
        _add_count(data, len(diagnosis.values))
        for key, value in diagnosis.values.items():
            _add_text(data, key)
            _add_text(data, value)
    return _HEAD + data


def _stamp(t_ns: int) -> tuple[int, int]:
    """builtin_interfaces/Time: its 32-bit seconds last until 2038."""
    return divmod(t_ns, 1_000_000_000)


def _add_count(data: bytearray, count: int) -> None:
    data.extend(bytes(-len(data) % 4))
    data.extend(_COUNT.pack(count))


def _add_doubles(data: bytearray, values: Vector) -> None:
    data.extend(bytes(-len(data) % 8))
    data.extend(Struct(f"<{len(values)}d").pack(*values))


def _add_text(data: bytearray, text: str) -> None:
    """Adds the length, counting the final zero, then the text and the zero."""
    encoded = text.encode() + b"\0"
    _add_count(data, len(encoded))
    data.extend(encoded)


@lru_cache(_LAYOUTS_MAX)
def _stamped(frame: str, count: int) -> tuple[Struct, bytes]:
    """The layout of a std_msgs/Header and doubles, and the text in between with its
    alignment.
    """
    data = bytearray(_STAMP.size)
    _add_text(data, frame)
    data.extend(bytes(-len(data) % 8))
    text = bytes(data[_STAMP.size :])
    return Struct(f"<4siI{len(text)}s{count}d"), text


@lru_cache(_LAYOUTS_MAX)
def _transform(frame: str, child: str) -> tuple[Struct, bytes]:
    """Of a sequence of one geometry_msgs/TransformStamped."""
    before = _COUNT.size + _STAMP.size
    data = bytearray(before)
    _add_text(data, frame)
    _add_text(data, child)
    data.extend(bytes(-len(data) % 8))
    texts = bytes(data[before:])
    return Struct(f"<4sIiI{len(texts)}s7d"), texts
