# SPDX-License-Identifier: MIT
"""The daemon's messages about a probe, as typed objects: docs/pose.md.

Units are in the names; vectors and quaternions are tuples. None: not known.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from imud import rotation

Topic = Literal["pose", "raw", "event", "stroke", "status"]
Vector = tuple[float, float, float]


class Numbered(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of every message from a probe."""

    probe: str  # name of the probe, as in keys
    seq: int  # sequence number among all messages of the probe
    number: int  # sequence number within its kind, without gaps
    missing: int  # messages of any kind lost on the wire since the last of this kind
    t_device_us: int  # device time, without wrapping
    t_ns: int | None = None  # UTC of the sample or event
    t_bound_us: int | None = None  # t_ns is within this of the truth, 99 times in 100
    age_us: int | None = None  # of the sample, when the daemon had read it
    utc_host: str | None = None  # whose UTC t_ns is
    utc_bound_us: int | None = None  # how far that may be off; None: not synchronised


class SinceOrigin(msgspec.Struct, frozen=True, kw_only=True):
    """The 1-sigma errors of a pose since its origin was set: docs/pose.md."""

    heading_sigma_deg: float | None
    tilt_sigma_deg: float | None
    age_s: float | None  # None: the daemon did not hear when it was set
    void: str | None = None  # why nothing is known of them any more


class Pose(Numbered, frozen=True, kw_only=True):
    """Orientation and position of a probe in the world, which is east-north-up."""

    q: tuple[float, float, float, float]  # unit quaternion w, x, y, z: world_from_body
    position_m: Vector | None  # of the tip, in the world
    normal: Vector | None  # unit vector in the world
    tilt_sigma_deg: float | None  # 1-sigma errors
    heading_sigma_deg: float | None
    flags: tuple[str, ...]
    since_origin: SinceOrigin | None = None  # None: no origin

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


class Raw(Numbered, frozen=True, kw_only=True):
    """One sample of the sensor in the axes of the body: calibrated with the probe's
    params, and as counts. Without knowing the params, only counts.
    """

    acc_m_s2: Vector | None
    gyr_rad_s: Vector | None
    mag_uT: Vector | None  # noqa: N815 - the unit's own spelling
    temperature_c: float | None
    # Digest of the params that calibrate them; 0: the probe has none. None: unknown so
    # far.
    params_digest: int | None = None
    acc_counts: tuple[int, int, int]
    gyr_counts: tuple[int, int, int]
    mag_counts: tuple[int, int, int] | None
    flags: tuple[str, ...]


class Event(Numbered, frozen=True, kw_only=True):
    """Something that happened at the probe, and why."""

    event: str
    cause: str
    detail: int


class Stroke(Numbered, frozen=True, kw_only=True):
    """How far the sensor has moved between two rests, or with the button held. `end` is
    "running" while it moves and what follows is provisional, then "rest" or "button";
    with any other the displacement is None.
    """

    stroke: int  # number since the filter began
    end: str
    windows: int  # its length in windows of 0.1 s
    displacement_m: Vector | None  # in the world
    displacement_sigma_m: Vector | None  # 1-sigma errors, without that of the heading
    path_m: Vector | None  # from the origin to where the sensor is
    path_sigma_m: Vector | None
    flags: tuple[str, ...]
    advice: str | None = None  # what to do where it has no length


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


# The items of a subscription; KINDS has the type of each topic.
Published = Pose | Raw | Event | Stroke | Status
KINDS: dict[str, type[Published]] = {
    "pose": Pose,
    "raw": Raw,
    "event": Event,
    "stroke": Stroke,
    "status": Status,
}
