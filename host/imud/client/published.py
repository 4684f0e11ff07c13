# SPDX-License-Identifier: MIT
"""The daemon's messages about a probe, as typed objects: docs/pose.md.

Units are in the names; vectors and quaternions are tuples. None: not known.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from imud import rotation
from imud.published import Event, Mark, PoseFields, Quaternion, Raw, Stroke, Vector

Topic = Literal["pose", "raw", "event", "stroke", "status", "mark", "body"]


class Pose(PoseFields, frozen=True, kw_only=True):
    """Orientation and position of a probe in the world, which is east-north-up."""

    @property
    def yaw_pitch_roll_deg(self) -> Vector:
        """The nautical angles, which are the default of `imud listen`."""
        return self.angles("nautical")

    def angles(self, convention: rotation.Convention) -> rotation.Angles:
        """Yaw, pitch and roll in degrees, as a named tuple, in a convention of
        docs/pose-details.md: yaw and roll in [-180, 180), pitch in [-90, 90].
        """
        return rotation.angles_deg(self.q, convention)

    @property
    def matrix(self) -> tuple[Vector, Vector, Vector]:
        """The rotation matrix, v_world = M v_body: rows east, north, up."""
        return rotation.matrix_rows(self.q)


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon's status of a probe, published once a second."""

    probe: str
    probe_id: str
    state: str
    port: str | None
    t_ns: int
    pose_rate_hz: float
    quality: dict[str, Any]
    ledger: dict[str, Any]
    link: dict[str, Any] | None = None
    clock: dict[str, Any] = {}
    counters: dict[str, Any] = {}
    params: dict[str, Any] = {}
    sensors: dict[str, Any] = {}
    equipment: dict[str, Any] | None = None
    hello: dict[str, Any] = {}


class Segment(msgspec.Struct, frozen=True, kw_only=True):
    """One of a body. `q`: world_from_segment; None while it is missing."""

    name: str
    parent: str | None
    presence: str
    q: Quaternion | None


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a body: docs/limb.md."""

    body: str
    side: str
    number: int
    t_ns: int
    t_bound_us: int | None
    stage: str
    missing: tuple[str, ...]
    segments: tuple[Segment, ...]
    joints: tuple[dict[str, Any], ...]


# The items of a subscription; KINDS has the type of each topic.
Published = Pose | Raw | Event | Stroke | Status | Mark | Body
KINDS: dict[str, type[Published]] = {
    "pose": Pose,
    "raw": Raw,
    "event": Event,
    "stroke": Stroke,
    "status": Status,
    "mark": Mark,
    "body": Body,
}
