# SPDX-License-Identifier: MIT
"""Arrays of unit quaternions: w, x, y, z, Hamilton, `world_from_body`.

Quaternions lie along the last axis of an array and broadcast like numbers; so do angles
(yaw, pitch, roll, radians: docs/pose-details.md) and the rows of a matrix.
angles_deg() and matrix_rows() convert one attitude for display.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Row = tuple[float, float, float]
Quat = tuple[float, float, float, float]

# Names of the conventions of docs/pose-details.md.
Convention = Literal["aerospace", "nautical", "nectec"]

IDENTITY: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])

# Closer to the vertical than this, x is taken as vertical: pitch is a quarter turn,
# roll is 0. web/site/rotation.js has the same value.
GIMBAL_LOCK_RAD = 1e-5


# Of plain numbers, for which numpy takes ten times as long, and of arrays.
_ONE = (math.atan2, math.hypot, lambda is_so, one, other: one if is_so else other)
_MANY = (np.arctan2, np.hypot, np.where)


def multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """The rotation `right` followed by `left`, both seen from the world."""
    w1, x1, y1, z1 = components(left)
    w2, x2, y2, z2 = components(right)
    return _joined(
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
    )


def components(rows: FloatArray) -> Any:
    """Arrays of each component; of one row plain numbers, which are faster."""
    is_one = rows.ndim == 1
    return rows.tolist() if is_one else rows.transpose(-1, *range(rows.ndim - 1))


def _joined(*parts: Any) -> FloatArray:
    """What components() took apart."""
    rows = np.array(parts)
    return np.ascontiguousarray(rows.transpose(*range(1, rows.ndim), 0))


def inverse(quat: FloatArray) -> FloatArray:
    """The inverse of a unit quaternion."""
    return np.asarray(quat * np.array([1.0, -1.0, -1.0, -1.0]))


def rotate(quat: FloatArray, vector_body: FloatArray) -> FloatArray:
    """The vector in the world that is `vector_body` in the body."""
    w, x, y, z = components(quat)
    a, b, c = components(vector_body)
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return _joined(
        a + w * p + (y * r - z * q),
        b + w * q + (z * p - x * r),
        c + w * r + (x * q - y * p),
    )


def beside(quat: Quat, last: Quat | None) -> Quat:
    """The attitude `quat` with the sign that is nearer to `last`; None: as it is."""
    if last is None or sum(a * b for a, b in zip(quat, last, strict=True)) >= 0.0:
        return quat
    w, x, y, z = quat
    return 0.0 - w, 0.0 - x, 0.0 - y, 0.0 - z  # no -0.0


def continuous(quat: FloatArray) -> FloatArray:
    """The attitudes of (n, 4), each with the sign nearer to the last one that is
    known. Rows of NaN stay.
    """
    made = np.array(quat, dtype=float)
    known = np.flatnonzero(np.isfinite(made).all(axis=-1))
    cosines = np.sum(made[known[1:]] * made[known[:-1]], axis=-1)
    signs = np.cumprod(np.where(cosines < 0.0, -1.0, 1.0))
    made[known[1:]] *= signs[:, None]
    return made


def from_rotation_vector(angle_rad: FloatArray) -> FloatArray:
    """A rotation about the direction of a vector, by its length in radians."""
    half = 0.5 * np.sqrt((angle_rad * angle_rad).sum(axis=-1, keepdims=True))
    some = np.maximum(half, 1e-20)
    sines = 0.5 * angle_rad * (np.sin(some) / some)
    return np.concatenate([np.cos(half), sines], axis=-1)


def to_rotation_vector(quat: FloatArray) -> FloatArray:
    """The shorter of the two rotation vectors of a quaternion, radians."""
    short = np.where(quat[..., :1] < 0.0, -quat, quat)
    sine = np.linalg.norm(short[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, short[..., :1])
    return np.asarray(short[..., 1:] / np.maximum(sine, 1e-300) * angle)


def from_heading_pitch_roll(
    heading_rad: float, pitch_rad: float, roll_rad: float
) -> FloatArray:
    """First rolled about x, then pitched about y (x goes down), then turned about up.

    Angles in radians, about the axes of the world.
    """
    turns = np.diag([roll_rad, pitch_rad, heading_rad])
    roll, pitch, heading = from_rotation_vector(turns)
    return multiply(heading, multiply(pitch, roll))


def to_yaw_pitch_roll(quat: FloatArray) -> FloatArray:
    """The nautical angles, as from_heading_pitch_roll() takes them, radians.

    z-y'-x'' of east-north-up, x ahead, y to port, z up: yaw from east to north, pitch
    with x down, roll with y up. Yaw and roll in [-pi, pi), pitch in [-pi/2, pi/2].
    """
    w, x, y, z = components(quat)
    atan2, hypot, where = _ONE if quat.ndim == 1 else _MANY
    # Of q = q_z(yaw) q_y(pitch) q_x(roll): (w - y, x + z) is sqrt(1 - sin pitch) long
    # and has the angle (yaw + roll) / 2, (w + y, z - x) is sqrt(1 + sin pitch) long and
    # has the angle (yaw - roll) / 2. Only one of them gets short near the lock.
    half_sum = atan2(x + z, w - y)
    half_difference = atan2(z - x, w + y)
    sum_length = hypot(x + z, w - y)
    difference_length = hypot(z - x, w + y)
    lock = GIMBAL_LOCK_RAD / math.sqrt(2.0)
    is_down = sum_length < lock
    is_up = difference_length < lock
    half_sum = where(is_down, half_difference, half_sum)
    half_difference = where(is_up, half_sum, half_difference)
    pitch = atan2(2.0 * (w * y - z * x), sum_length * difference_length)
    pitch = where(is_down, np.pi / 2, where(is_up, -np.pi / 2, pitch))
    yaw, roll = half_sum + half_difference, half_sum - half_difference
    return _joined(_wrapped(yaw, where), pitch, _wrapped(roll, where))


def to_aerospace(quat: FloatArray) -> FloatArray:
    """Yaw, pitch and roll of aircraft (ISO 1151-1), radians: of north-east-down, x
    ahead, y right, z down. Yaw from north to east, pitch with x up, roll with y down.
    """
    yaw, pitch, roll = components(to_yaw_pitch_roll(quat))
    where = (_ONE if quat.ndim == 1 else _MANY)[2]
    return _joined(_wrapped(np.pi / 2 - yaw, where), -pitch, roll)


def to_nectec(quat: FloatArray) -> FloatArray:
    """The nautical angles as NECTEC's paper names them, radians: yaw about x, roll
    about z.
    """
    return to_yaw_pitch_roll(quat)[..., ::-1]


CONVERSIONS: Mapping[Convention, Callable[[FloatArray], FloatArray]] = {
    "aerospace": to_aerospace,
    "nautical": to_yaw_pitch_roll,
    "nectec": to_nectec,
}


class Angles(NamedTuple):
    """Angles in degrees: yaw and roll in [-180, 180), pitch in [-90, 90]."""

    yaw_deg: float
    pitch_deg: float
    roll_deg: float


def angles_deg(quat: Sequence[float], convention: Convention) -> Angles:
    """The angles of one unit quaternion in a convention of docs/pose-details.md."""
    return Angles(*np.degrees(CONVERSIONS[convention](np.array(quat))).tolist())


def to_matrix(quat: FloatArray) -> FloatArray:
    """The matrix whose columns are the body's axes in the world."""
    rows = np.array(matrix_rows(components(quat)))
    return rows if quat.ndim == 1 else np.moveaxis(rows, (0, 1), (-2, -1))


def matrix_rows(quat: Sequence[float]) -> tuple[Row, Row, Row]:
    """to_matrix() of one unit quaternion: rows east, north, up; columns x, y, z."""
    w, x, y, z = quat
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(matrix: FloatArray) -> FloatArray:
    """The unit quaternion of a rotation matrix, its largest component positive."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    xx, yy, zz = m[0, 0], m[1, 1], m[2, 2]
    # Four times the products of all components: each row is a multiple of the
    # quaternion, and the row of its largest component is the best conditioned.
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    products = np.array(
        [
            [1.0 + xx + yy + zz, wx, wy, wz],
            [wx, 1.0 + xx - yy - zz, xy, xz],
            [wy, xy, 1.0 - xx + yy - zz, yz],
            [wz, xz, yz, 1.0 - xx - yy + zz],
        ]
    )
    products = np.moveaxis(products, (0, 1), (-2, -1))
    squares = np.diagonal(products, axis1=-2, axis2=-1)
    largest = np.argmax(squares, axis=-1)[..., None, None]
    row = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    return np.asarray(row / np.linalg.norm(row, axis=-1, keepdims=True))


def _wrapped(angle_rad: Any, where: Callable[..., Any]) -> Any:
    """The same angle in [-pi, pi)."""
    wrapped = (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    # The remainder of a tiny negative number rounds to the whole turn.
    return where(wrapped >= np.pi, -np.pi, wrapped)


def interpolate(
    times: FloatArray, known_times: FloatArray, known: FloatArray
) -> FloatArray:
    """Slerp of `known` at `times`; NaN outside, and where a neighbour is NaN."""
    after = np.clip(np.searchsorted(known_times, times), 1, len(known_times) - 1)
    before = after - 1
    share = (times - known_times[before]) / (known_times[after] - known_times[before])
    step = to_rotation_vector(multiply(inverse(known[before]), known[after]))
    quat = multiply(known[before], from_rotation_vector(share[:, None] * step))
    # A sample that falls on a known one needs no neighbour.
    quat = np.where((share == 0.0)[:, None], known[before], quat)
    quat = np.where((share == 1.0)[:, None], known[after], quat)
    is_outside = (share < 0.0) | (share > 1.0)
    return np.where(is_outside[:, None], np.nan, quat)
