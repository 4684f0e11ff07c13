# SPDX-License-Identifier: MIT
"""Arrays of unit quaternions: w, x, y, z, Hamilton, `world_from_body`.

Quaternions lie along the last axis of an array and broadcast like numbers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

IDENTITY: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])


def multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """The rotation `right` followed by `left`, both seen from the world."""
    w1, x1, y1, z1 = np.moveaxis(left, -1, 0)
    w2, x2, y2, z2 = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def inverse(quat: FloatArray) -> FloatArray:
    """The inverse of a unit quaternion."""
    return np.asarray(quat * np.array([1.0, -1.0, -1.0, -1.0]))


def rotate(quat: FloatArray, vector_body: FloatArray) -> FloatArray:
    """The vector in the world that is `vector_body` in the body."""
    axis = quat[..., 1:]
    twist = 2.0 * np.cross(axis, vector_body)
    return np.asarray(vector_body + quat[..., :1] * twist + np.cross(axis, twist))


def from_rotation_vector(angle_rad: FloatArray) -> FloatArray:
    """A rotation about the direction of a vector, by its length in radians."""
    half = 0.5 * np.linalg.norm(angle_rad, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x)/(pi x): well defined for a rotation by nothing.
    return np.concatenate(
        [np.cos(half), 0.5 * angle_rad * np.sinc(half / np.pi)], axis=-1
    )


def to_rotation_vector(quat: FloatArray) -> FloatArray:
    """The shorter of the two rotation vectors of a quaternion, radians."""
    short = np.where(quat[..., :1] < 0.0, -quat, quat)
    sine = np.linalg.norm(short[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, short[..., :1])
    return np.asarray(short[..., 1:] / np.maximum(sine, 1e-300) * angle)


def from_heading_pitch_roll(
    heading_rad: float, pitch_rad: float, roll_rad: float
) -> FloatArray:
    """Rolled about x, then pitched about y (x goes down), then turned about up."""
    turns = np.diag([roll_rad, pitch_rad, heading_rad])
    roll, pitch, heading = from_rotation_vector(turns)
    return multiply(heading, multiply(pitch, roll))


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
