# SPDX-License-Identifier: MIT
"""JSON Schemas of the topics in a log, which MCAP stores beside the data."""

from __future__ import annotations

from typing import Any

_NUMBER: dict[str, Any] = {"type": "number"}
_COUNT: dict[str, Any] = {"type": "integer"}
_OPTIONAL_COUNT: dict[str, Any] = {"type": ["integer", "null"]}
_HEAD = {
    "type": {"type": "string"},
    "probe": {"type": "string"},
    "seq": _COUNT,
    "number": _COUNT,
    "missing": _COUNT,
    "t_device_us": _COUNT,
    "t_ns": _OPTIONAL_COUNT,
    "t_bound_us": _OPTIONAL_COUNT,
    "age_us": _OPTIONAL_COUNT,
    "utc_host": {"type": "string"},
    "utc_bound_us": _OPTIONAL_COUNT,
}


def _vector(size: int, *, is_optional: bool = True) -> dict[str, Any]:
    kind = ["array", "null"] if is_optional else "array"
    return {"type": kind, "items": _NUMBER, "minItems": size, "maxItems": size}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _whole(**properties: Any) -> dict[str, Any]:
    """An object with all of these properties."""
    return _object(**properties) | {"required": [*properties]}


_TEXT = {"type": "string"}
_ABOUT = {"type": _TEXT, "probe": _TEXT, "t_ns": _COUNT}
_FLAGS = {"type": "array", "items": {"type": "string"}}
_OPTIONAL = {"type": ["number", "null"]}

_TIME = _whole(
    sec=_COUNT | {"minimum": 0}, nsec=_COUNT | {"minimum": 0, "maximum": 10**9 - 1}
)
_XYZ = {axis: _NUMBER for axis in "xyz"}

# Errors of a pose since a moment; `void`: why they are no longer known.
_SINCE = _whole(
    heading_sigma_deg=_OPTIONAL,
    tilt_sigma_deg=_OPTIONAL,
    age_s=_OPTIONAL,
    void={"type": ["string", "null"]},
) | {"type": ["object", "null"]}

_PLACES = {"type": "array", "items": _vector(3, is_optional=False)}

JSON_SCHEMAS: dict[str, dict[str, Any]] = {
    "pose": _object(
        **_HEAD,
        q=_vector(4, is_optional=False),
        position_m=_vector(3),
        normal=_vector(3),
        tilt_sigma_deg=_OPTIONAL,
        heading_sigma_deg=_OPTIONAL,
        flags=_FLAGS,
        since_origin=_SINCE,
    ),
    "raw": _object(
        **_HEAD,
        acc_m_s2=_vector(3),
        gyr_rad_s=_vector(3),
        mag_uT=_vector(3),
        params_digest=_OPTIONAL_COUNT,
        temperature_c=_OPTIONAL,
        acc_counts=_vector(3, is_optional=False),
        gyr_counts=_vector(3, is_optional=False),
        mag_counts=_vector(3),
        flags=_FLAGS,
    ),
    "aim": _object(
        **_ABOUT | {"t_ns": _OPTIONAL_COUNT},
        number=_COUNT,
        t_device_us=_COUNT,
        target=_TEXT,
        target_q=_vector(4, is_optional=False),
        axis={"enum": ["x", "y", "z", "all"]},
        tolerance_deg=_NUMBER,
        hold_s=_NUMBER,
        error_deg=_NUMBER,
        sigma_deg=_OPTIONAL,
        since={"enum": ["origin", "capture", None]},
        void={"type": ["string", "null"]},
        state={"enum": ["off", "unsure", "sure"]},
        difference_deg=_vector(3, is_optional=False),
        held_s=_NUMBER,
        bound_deg=_OPTIONAL,
        is_reached={"type": "boolean"},
    ),
    "event": _object(
        **_HEAD, event={"type": "string"}, cause={"type": "string"}, detail=_COUNT
    ),
    "stroke": _object(
        **_HEAD,
        stroke=_COUNT,
        end=_TEXT,
        windows=_COUNT,
        displacement_m=_vector(3),
        displacement_sigma_m=_vector(3),
        path_m=_vector(3),
        path_sigma_m=_vector(3),
        flags=_FLAGS,
        advice={"type": ["string", "null"]},
    ),
    "path": _object(
        **_ABOUT,
        by={"enum": ["button", "command"]},
        strokes=_COUNT,
        off_m=_vector(3, is_optional=False),
        off_sigma_m=_vector(3, is_optional=False),
        is_explained={"type": "boolean"},
        path_m=_PLACES,
        closed_m=_PLACES,
    ),
    "command": _object(
        **_ABOUT, command=_TEXT, parameters={"type": "object"}, by=_TEXT
    ),
    "mark": _object(
        **_ABOUT,
        value=_OPTIONAL,
        text=_TEXT,
        number=_OPTIONAL_COUNT,
        t_device_us=_OPTIONAL_COUNT,
        t_pose_ns=_OPTIONAL_COUNT,
        q=_vector(4),
        position_m=_vector(3),
        position_sigma_m=_OPTIONAL,
        normal=_vector(3),
        tilt_sigma_deg=_OPTIONAL,
        heading_sigma_deg=_OPTIONAL,
        flags={"type": ["array", "null"], "items": {"type": "string"}},
        since_origin=_SINCE,
    ),
    "twin": _object(
        **_HEAD,
        state={"type": "string"},
        compared=_COUNT,
        differed=_COUNT,
        lost={"type": ["object", "null"]},
        first_difference={"type": ["object", "null"]},
    ),
    "learn": _object(
        **_ABOUT,
        state={"type": "string"},
        heading_deg=_OPTIONAL,
        sigma_uT=_OPTIONAL,
        digest={"type": ["string", "null"]},
        records={"type": ["string", "null"]},
    ),
    "status": _object(**_ABOUT),
    "clock": _object(**_ABOUT, step_ns=_COUNT, timeline=_COUNT, reason=_TEXT),
    "params": _object(
        **_ABOUT,
        probe_id=_TEXT,
        digest={"type": ["string", "null"]},
        error={"type": ["string", "null"]},
        bytes=_TEXT,
        records={"type": "object"},
    ),
    # Of `imud record`: numbers between `after` and `before` did not arrive.
    "gap": _object(
        **_ABOUT,
        topic=_TEXT,
        after=_OPTIONAL_COUNT,
        before=_COUNT,
        network=_COUNT,
        wire=_COUNT,
        daemon_restarts=_COUNT,
    ),
    "log": _object(
        **_ABOUT,
        state={"enum": ["on", "paused", "off"]},
        reason={"type": ["string", "null"]},
        dropped=_COUNT,
    ),
}

# The schema of Foxglove's by that name, as far as a pose fills it.
FOXGLOVE_SCHEMA = {
    "title": "foxglove.PoseInFrame",
    **_whole(
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_whole(position=_whole(**_XYZ), orientation=_whole(**_XYZ, w=_NUMBER)),
    ),
}

# Topics with a schema: its name and what it says.
SCHEMAS = {name: (f"imud.{name}", body) for name, body in JSON_SCHEMAS.items()} | {
    "pose_in_frame": ("foxglove.PoseInFrame", FOXGLOVE_SCHEMA)
}


def schema_of(topic: str) -> tuple[str, dict[str, Any]]:
    """Name and body of a topic's schema; any other says whose it is and when."""
    return SCHEMAS.get(topic) or (f"imud.{topic}", _object(**_ABOUT))
