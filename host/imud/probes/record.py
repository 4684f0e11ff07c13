# SPDX-License-Identifier: MIT
"""Records: what flows through the hub to the sinks. A message becomes the same object
for subscribers, logs and `imud decode`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from imud import published
from imud.probes.north import North
from imud.probes.references import References
from imud.probes.scales import Scales
from imud.probes.self_test import Responses, verdicts_of
from imud.probes.withheld import STROKE_ADVICE
from imud.wire.messages import Message, Value, decode

# Messages published as JSON under their own names; others only as frames.
JSON_TOPICS = frozenset(published.WIRE)

# Keys of the daemon's own records, and what the messages of that name are called.
TOPICS = {"status": "counters", "params": "params_part"}

# Each object begins with these; without the last two where no host dated it.
HEAD = ("type", *published.Numbered.__struct_fields__)

# Of a message: the names that its fields are published by, and the fields.
_PUBLISHED = {topic: (*names.items(),) for topic, names in published.WIRE.items()}

_ENCODER = msgspec.json.Encoder()


class Stamp(msgspec.Struct, frozen=True):
    """The number of a message and its times."""

    number: int  # counts messages of its kind since imud heard the probe; no gaps
    missing: int  # messages of the probe lost since the last one of its kind
    t_device_us: int  # unrolled beyond 32 bits
    t_ns: int | None = None  # UTC of its sample; None: not known
    t_bound_ns: int | None = None  # t_ns is right to this in 99 % of cases
    t_received_ns: int | None = None  # UTC at which its last byte was read
    # The host whose UTC these are, and how far that may be off in us (None: not known).
    whose: tuple[str, int | None] | None = None
    boot: int = 0  # counts the probe's boots since imud heard it


class Record(msgspec.Struct, frozen=True):
    """One message of a probe or about it, prepared once for all sinks."""

    probe: str  # its name in keys
    topic: str  # last part of its key: pose, raw, event, status...
    payload: bytes  # JSON; empty: published as frame only
    content: bytes  # content of the frame; empty: the daemon's own record
    sequence: int
    t_ns: int  # UTC of what it tells
    t_received_ns: int  # UTC
    hello: bytes = b""  # content of the latest hello, which scales raw counts
    params: bytes | None = None  # records in force; None: not known, or not a message
    values: Mapping[str, Any] = {}  # the object in `payload`, of messages


class Presence(msgspec.Struct, frozen=True):
    """A probe appeared or left; or is forgotten, since it has been gone for long."""

    probe: str
    is_alive: bool
    is_forgotten: bool = False


def record_of(
    message: Message,
    content: bytes,
    probe: str,
    stamp: Stamp,
    scales: Scales,
    north: North | None = None,
    flags: tuple[str, ...] = (),
    references: References | None = None,
    *,
    is_frame_only: bool = False,
) -> Record:
    """The record of a good message; poses refer to true north with `north`, and get
    these flags beside their own. `references` follows the messages of the probe.
    `is_frame_only`: it is not published as an object, nor followed.
    """
    values: dict[str, Any] = {}
    payload = b""
    if message.name in JSON_TOPICS and not is_frame_only:
        values = describe(message, content, probe, stamp, scales, references)
        if north is not None and message.name in ("pose", "stroke"):
            values = north.turned(values)
        if flags and message.name == "pose":
            values["flags"] = (*values["flags"], *flags)
        payload = _ENCODER.encode(values)
    topic = TOPICS.get(message.name, message.name)
    received_ns = stamp.t_received_ns or 0
    t_ns = received_ns if stamp.t_ns is None else stamp.t_ns
    return Record(
        probe,
        topic,
        payload,
        content,
        message.sequence,
        t_ns,
        received_ns,
        scales.hello,
        scales.params,
        values,
    )


def describe(
    message: Message,
    content: bytes,
    probe: str,
    stamp: Stamp,
    scales: Scales,
    references: References | None = None,
) -> dict[str, Any]:
    """A message as plain values for JSON, with units in the names. Poses and events
    have to come in their order, for `references`.
    """
    fields = message.fields
    t_ns, received_ns, bound_ns = stamp.t_ns, stamp.t_received_ns, stamp.t_bound_ns
    age_us = None
    if t_ns is not None and received_ns is not None and bound_ns is not None:
        age_us = round((received_ns - t_ns) / 1000)
    head: dict[str, Any] = {
        "type": message.name,
        "probe": probe,
        "seq": message.sequence,
        "number": stamp.number,
        "missing": stamp.missing,
        "t_device_us": stamp.t_device_us,
        "t_ns": t_ns,
        "t_bound_us": None if bound_ns is None else round(bound_ns / 1000),
        "age_us": age_us,
    }
    if stamp.whose is not None:
        head["utc_host"], head["utc_bound_us"] = stamp.whose
    published_fields = _PUBLISHED.get(message.name)
    if published_fields is None:
        head |= {name: plain(value) for name, value in fields.items()}
        if message.name == "self_test":
            head["verdicts"] = _verdicts(message, scales)
        return head
    if message.name == "raw":
        head["acc_m_s2"], head["gyr_rad_s"], head["mag_uT"] = scales.measure(content)
        head["params_digest"] = scales.digest
    for name, field in published_fields:
        head[name] = fields[field]
    if references is not None:
        references.follow(stamp.boot, scales.params)
    if message.name == "pose":
        if references is not None:
            head["since_origin"] = references.on_pose(head)
    elif message.name == "stroke":
        head |= _of_a_stroke(fields)
    elif message.name == "event" and references is not None:
        references.on_event(fields, stamp.t_device_us)
    return head


def _verdicts(message: Message, scales: Scales) -> dict[str, str]:
    """On what a message `self_test` says, by the hello before it."""
    hello = decode(scales.hello)
    if not isinstance(hello, Message):
        return {}
    verdicts = verdicts_of(hello.fields, Responses.of(message.fields))
    return {verdict.sensor: verdict.result for verdict in verdicts}


def _of_a_stroke(fields: Mapping[str, Value]) -> dict[str, Any]:
    """Its sigmas for each axis of the world, and what to do where it has no length."""
    return {
        "displacement_sigma_m": _of_axes(fields["displacement_sigma"]),
        "path_sigma_m": _of_axes(fields["path_sigma"]),
        "advice": STROKE_ADVICE.get(str(fields["end"])),
    }


def _of_axes(sigma: Value) -> tuple[float, float, float] | None:
    if not isinstance(sigma, tuple):
        return None
    horizontal, vertical = map(float, sigma)
    return horizontal, horizontal, vertical


def equipment_of(fields: Mapping[str, Value]) -> dict[str, Any]:
    """Equipment of a board beside its sensor; None for a part that it lacks."""
    battery_mv = fields["battery"]
    has_radio, has_card = fields["radio"] != "none", fields["card"] != "none"
    radio = {"state": fields["radio"], "resets": fields["radio_resets"]}
    card = {
        "state": fields["card"],
        "recording": fields["recording"],
        "block": fields["card_block"],
        "blocks": fields["card_blocks"],
        "faults": fields["card_faults"],
        "busy_ms": fields["card_busy"],
        "logged": fields["messages_logged"],
        "unlogged": fields["messages_unlogged"],
    }
    return {
        "clock": fields["clock"],
        "battery_v": battery_mv / 1000 if isinstance(battery_mv, int) else None,
        "power": fields["power"],
        "radio": radio if has_radio else None,
        "card": card if has_card else None,
    }


def plain(value: Value) -> Any:
    """Bytes as hexadecimal digits, other values unchanged."""
    return value.hex() if isinstance(value, bytes) else value
