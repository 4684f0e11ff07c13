# SPDX-License-Identifier: MIT
"""The fields of a good message of each type, in SI units as messages.py has them."""

from __future__ import annotations

from typing import Any

from imud.wire import schema
from imud.wire.schema import Field


def _quiet(field: Field) -> Any:
    """Not available, else nothing or zero, else the first of its words."""
    if field.null is not None:
        return None
    if field.enum is not None:
        return next(iter(field.enum)).name.lower()
    if field.flags is not None:
        return ()
    if field.type in ("text", "bytes"):
        return "" if field.type == "text" else bytes(field.count)
    zero = 0 if field.scale == 1 else 0.0
    return zero if field.count == 1 else (zero,) * field.count


def _example(name: str, **values: Any) -> dict[str, Any]:
    """A message with these values; its other fields are quiet."""
    (fields,) = (each.fields for each in schema.MESSAGES if each.name == name)
    return {field.name: _quiet(field) for field in fields} | values


HELLO = _example(
    "hello",
    protocol_version=schema.PROTOCOL_VERSION,
    schema_fingerprint=schema.FINGERPRINT,
    firmware="0.1.0+fake",
    probe_id=bytes.fromhex("00112233445566aa"),
    sensor="mpu9250",
    who_am_i=(0x71, 0x48),
    mag_adjust=(176, 178, 166),
    self_test=("acc_passed", "gyr_passed"),
    sample_rate=200,
    pose_rate=100,
    acc_lsb=0.004788403,
    gyr_lsb=0.001065264,
    mag_lsb=0.15,
    boot_count=7,
    reset_cause=("power_on",),
    filter="fuse",
)
PARAMS = _example("params")
RAW = _example(
    "raw", acc=(0, -16, 2048), gyr=(1, -2, 3), mag=(10, -20, 300), temperature=23.45
)
POSE = _example(
    "pose",
    q=(0.5, 0.5, -0.5, 0.5),
    tilt_sigma=0.37,
    heading_sigma=1.25,
    pose_flags=("at_rest",),
)
EVENT = _example("event", event="stream_started", cause="button")
STROKE = _example(
    "stroke",
    stroke=3,
    end="rest",
    windows=14,
    displacement=(0.1, -0.002, 0.0),
    displacement_sigma=(0.0021, 0.0018),
)
STATUS = _example(
    "status",
    uptime=5,
    state="streaming",
    samples_ready=1000,
    samples_read=1000,
    samples_fused=1000,
    messages_sent=500,
    cycles_mean=46000,
    cycles_worst=50000,
    stack_free=700,
    temperature=25.0,
)
EQUIPMENT = _example(
    "equipment",
    clock="crystal",
    battery=3900,
    card="logging",
    card_block=2,
    card_blocks=65536,
    card_busy=3,
    recording=1,
    messages_logged=100,
)
SELF_TEST = _example(
    "self_test",
    before=(-12, 340, 16384, 15, -9, 131),
    stimulated=(6500, 6900, 22800, 8000, -7900, 8150),
    after=(-11, 338, 16390, 14, -8, 130),
    factory=(93, 95, 96, 112, 112, 113),
    mag_response=(40, -60, -1900),
)
REPLY = _example("reply", replied_command="start", replied_token=1, result="ok")
COMMAND = _example("command", command="start", token=1)
EXAMPLES: dict[str, dict[str, Any]] = {
    "hello": HELLO,
    "params": PARAMS,
    "raw": RAW,
    "pose": POSE,
    "event": EVENT,
    "stroke": STROKE,
    "status": STATUS,
    "equipment": EQUIPMENT,
    "self_test": SELF_TEST,
    "command": COMMAND,
    "reply": REPLY,
}
