# SPDX-License-Identifier: MIT
"""JSON Schemas of the topics in a log, which MCAP stores beside the data."""

from __future__ import annotations

from typing import Any

import msgspec

from imud import published

Schema = dict[str, Any]

_NUMBER: Schema = {"type": "number"}
_COUNT: Schema = {"type": "integer"}


def _whole(**properties: Any) -> Schema:
    """An object with all of these properties."""
    return {"type": "object", "properties": properties, "required": [*properties]}


def _of(kind: type[msgspec.Struct]) -> Schema:
    """Of an object, any of whose properties an older or a newer log may lack."""
    others = msgspec.json.schema(kind, ref_template="{name}")["$defs"]
    properties = _plain(others[kind.__name__], others)["properties"]
    return {"type": "object", "properties": {"type": {"type": "string"}} | properties}


def _plain(schema: Schema, others: dict[str, Schema]) -> Schema:
    """With a type of its own: viewers of logs know neither references nor choices."""
    if "$ref" in schema:
        return _plain(others[schema["$ref"]], others)
    if "anyOf" in schema:
        (kind,) = (each for each in schema["anyOf"] if each != {"type": "null"})
        found = _plain(kind, others)
        if "enum" in found:
            return {"enum": [*found["enum"], None]}
        return found | {"type": [found["type"], "null"]}
    if "properties" in schema:
        parts = schema["properties"].items()
        return _whole(**{name: _plain(part, others) for name, part in parts})
    if parts := schema.get("prefixItems"):  # all of one kind
        size = len(parts)
        return {"type": "array", "items": parts[0], "minItems": size, "maxItems": size}
    if "items" in schema:
        return {"type": "array", "items": _plain(schema["items"], others)}
    return {key: schema[key] for key in ("type", "enum") if key in schema}


JSON_SCHEMAS = {topic: _of(kind) for topic, kind in published.TOPICS.items()}

_TIME = _whole(
    sec=_COUNT | {"minimum": 0}, nsec=_COUNT | {"minimum": 0, "maximum": 10**9 - 1}
)
_XYZ = {axis: _NUMBER for axis in "xyz"}

# The schema of Foxglove's by that name, as far as a pose fills it.
FOXGLOVE_SCHEMA = {
    "title": "foxglove.PoseInFrame",
    **_whole(
        timestamp=_TIME,
        frame_id={"type": "string"},
        pose=_whole(position=_whole(**_XYZ), orientation=_whole(**_XYZ, w=_NUMBER)),
    ),
}

# Topics with a schema: its name and what it says.
SCHEMAS = {name: (f"imud.{name}", body) for name, body in JSON_SCHEMAS.items()} | {
    "pose_in_frame": ("foxglove.PoseInFrame", FOXGLOVE_SCHEMA)
}


def schema_of(topic: str) -> tuple[str, dict[str, Any]]:
    """Name and body of a topic's schema; any other says whose it is and when."""
    return SCHEMAS.get(topic) or (f"imud.{topic}", JSON_SCHEMAS["status"])
