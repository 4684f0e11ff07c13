# SPDX-License-Identifier: MIT
"""What the daemon publishes, as types: docs/pose.md. None: not known.

Generated from published.toml by protocol/generate.py.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Numbered(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of every message from a probe."""

    probe: str
    seq: int
    number: int
    missing: int
    t_device_us: int
    t_ns: int | None = None
    t_bound_us: int | None = None
    age_us: int | None = None
    utc_host: str | None = None
    utc_bound_us: int | None = None


class About(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of what the daemon says about a probe."""

    probe: str
    t_ns: int


class SinceOrigin(msgspec.Struct, frozen=True):
    """One-sigma errors of a pose since a moment, in degrees. None: not known."""

    heading_sigma_deg: float | None
    tilt_sigma_deg: float | None
    age_s: float | None
    void: str | None = None


class PoseFields(Numbered, frozen=True, kw_only=True):
    """Orientation and position of a probe in the world, which is east-north-up."""

    q: Quaternion
    position_m: Vector | None
    normal: Vector | None
    tilt_sigma_deg: float | None
    heading_sigma_deg: float | None
    flags: tuple[str, ...]
    since_origin: SinceOrigin | None = None


class Stroke(Numbered, frozen=True, kw_only=True):
    """How far the sensor has moved between two rests, or with the button held."""

    stroke: int
    end: str
    advice: str | None = None
    windows: int
    displacement_m: Vector | None
    displacement_sigma_m: Vector | None
    path_m: Vector | None
    path_sigma_m: Vector | None
    flags: tuple[str, ...]


class Path(msgspec.Struct, frozen=True, kw_only=True):
    """The path of a probe's strokes, closed."""

    probe: str
    t_ns: int
    by: Literal["button", "command"]
    strokes: int
    off_m: Vector
    off_sigma_m: Vector
    is_explained: bool
    path_m: tuple[Vector, ...]
    closed_m: tuple[Vector, ...] | None
    closed_sigma_m: tuple[Vector, ...] | None


class Raw(Numbered, frozen=True, kw_only=True):
    """One sample in the axes of the body: calibrated, and as counts."""

    acc_m_s2: Vector | None
    gyr_rad_s: Vector | None
    mag_uT: Vector | None  # noqa: N815 - the unit's own spelling
    params_digest: int | None = None
    temperature_c: float | None
    acc_counts: tuple[int, int, int]
    gyr_counts: tuple[int, int, int]
    mag_counts: tuple[int, int, int] | None
    flags: tuple[str, ...]


class Event(Numbered, frozen=True, kw_only=True):
    """Something that happened at the probe, and why."""

    event: str
    cause: str
    detail: int


class Aim(msgspec.Struct, frozen=True, kw_only=True):
    """How far a pose is from the target that its probe was given."""

    probe: str
    number: int
    t_device_us: int
    t_ns: int | None
    target: str
    target_q: Quaternion
    axis: Literal["x", "y", "z", "all"]
    tolerance_deg: float
    hold_s: float
    error_deg: float
    sigma_deg: float | None
    since: Literal["origin", "capture"] | None = None
    void: str | None = None
    state: Literal["off", "unsure", "sure"]
    difference_deg: Vector
    held_s: float
    bound_deg: float | None
    is_reached: bool


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """A value or a note from outside, with the pose of that moment."""

    probe: str
    t_ns: int
    id: str | None = None
    state: Literal["new", "corrected", "withdrawn"] | None = None
    probe_id: str | None = None
    value: float | None
    unit: str | None = None
    text: str
    t_pose_ns: int | None
    t_device_us: int | None
    number: int | None
    q: Quaternion | None
    position_m: Vector | None
    normal: Vector | None
    tilt_sigma_deg: float | None
    heading_sigma_deg: float | None
    flags: tuple[str, ...] | None
    since_origin: SinceOrigin | None
    position_sigma_m: float | None
    no_position: str | None = None


class Command(About, frozen=True, kw_only=True):
    """A command that was carried out, and who gave it."""

    command: str
    parameters: dict[str, Any]
    by: str
    refused: str | None = None


class Twin(Numbered, frozen=True, kw_only=True):
    """Whether the poses are those that the twin computes."""

    state: str
    compared: int
    differed: int
    lost: dict[str, Any] | None
    first_difference: dict[str, Any] | None


class Learn(About, frozen=True, kw_only=True):
    """What the learned calibration has come to."""

    state: str
    heading_deg: float | None
    sigma_uT: float | None  # noqa: N815 - the unit's own spelling
    digest: str | None
    records: str | None


class StatusAbout(About, frozen=True, kw_only=True):
    """The daemon's status of a probe."""


class Clock(About, frozen=True, kw_only=True):
    """A step of the host's clock."""

    step_ns: int
    timeline: int
    reason: str


class Params(About, frozen=True, kw_only=True):
    """The params of a probe."""

    probe_id: str
    digest: str | None
    error: str | None
    bytes: str
    records: dict[str, Any]


class Gap(About, frozen=True, kw_only=True):
    """Of `imud record`: numbers between `after` and `before` did not arrive."""

    topic: str
    after: int | None
    before: int
    network: int
    wire: int
    daemon_restarts: int


class Log(About, frozen=True, kw_only=True):
    """Whether the messages of a probe are logged."""

    state: Literal["on", "paused", "off"]
    reason: str | None
    dropped: int


TOPICS: dict[str, type[msgspec.Struct]] = {
    "pose": PoseFields,
    "stroke": Stroke,
    "path": Path,
    "raw": Raw,
    "event": Event,
    "aim": Aim,
    "mark": Mark,
    "command": Command,
    "twin": Twin,
    "learn": Learn,
    "status": StatusAbout,
    "clock": Clock,
    "params": Params,
    "gap": Gap,
    "log": Log,
}

# The numbers of a pose.
POSE_NUMBERS = (
    "tilt_sigma_deg",
    "heading_sigma_deg",
)

# Fields of messages, by the names that they are published by.
WIRE = {
    "pose": {
        "q": "q",
        "position_m": "position",
        "normal": "normal",
        "tilt_sigma_deg": "tilt_sigma",
        "heading_sigma_deg": "heading_sigma",
        "flags": "pose_flags",
    },
    "stroke": {
        "stroke": "stroke",
        "end": "end",
        "windows": "windows",
        "displacement_m": "displacement",
        "displacement_sigma_m": "displacement_sigma",
        "path_m": "path",
        "path_sigma_m": "path_sigma",
        "flags": "stroke_flags",
    },
    "raw": {
        "temperature_c": "temperature",
        "acc_counts": "acc",
        "gyr_counts": "gyr",
        "mag_counts": "mag",
        "flags": "sample_flags",
    },
    "event": {
        "event": "event",
        "cause": "cause",
        "detail": "detail",
    },
}
