# SPDX-License-Identifier: MIT
"""The fields of a good message of each type, in SI units as messages.py has them."""

from __future__ import annotations

from typing import Any

from imud.wire import schema

HELLO: dict[str, Any] = {
    "protocol_version": schema.PROTOCOL_VERSION,
    "schema_fingerprint": schema.FINGERPRINT,
    "firmware": "0.1.0+fake",
    "board": "nano",
    "probe_id": bytes.fromhex("00112233445566aa"),
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 178, 166),
    "self_test": ("acc_passed", "gyr_passed"),
    "sample_rate": 200,
    "pose_rate": 100,
    "raw_rate": 0,
    "acc_lsb": 0.004788403,
    "gyr_lsb": 0.001065264,
    "mag_lsb": 0.15,
    "boot_count": 7,
    "reset_cause": ("power_on",),
    "filter": "fuse",
    "reset_address": 0,
    "params_digest": 0,
    "own_field": (0.0, 0.0, 0.0),
    "own_sigma": 0.0,
}
PARAMS: dict[str, Any] = {
    "set_digest": 0,
    "set_length": 0,
    "part_offset": 0,
    "part": bytes(28),
}
POSE: dict[str, Any] = {
    "q": (0.5, 0.5, -0.5, 0.5),
    "position": None,
    "normal": None,
    "tilt_sigma": 0.37,
    "heading_sigma": 1.25,
    "pose_flags": ("at_rest",),
}
RAW: dict[str, Any] = {
    "acc": (0, -16, 2048),
    "gyr": (1, -2, 3),
    "mag": (10, -20, 300),
    "temperature": 23.45,
    "sample_flags": (),
}
EVENT: dict[str, Any] = {"event": "stream_started", "cause": "button", "detail": 0}
STROKE: dict[str, Any] = {
    "stroke": 3,
    "end": "rest",
    "windows": 14,
    "displacement": (0.1, -0.002, 0.0),
    "displacement_sigma": (0.0021, 0.0018),
    "path": None,
    "path_sigma": None,
    "stroke_flags": (),
}
STATUS: dict[str, Any] = {
    "uptime": 5,
    "state": "streaming",
    "samples_ready": 1000,
    "samples_read": 1000,
    "samples_fused": 1000,
    "overruns": 0,
    "bus_faults": 0,
    "bus_recoveries": 0,
    "messages_sent": 500,
    "messages_dropped": 0,
    "commands_received": 0,
    "commands_bad": 0,
    "cycles_mean": 46000,
    "cycles_worst": 50000,
    "stack_free": 700,
    "supply": None,
    "receive_lost": 0,
    "temperature": 25.0,
}
EQUIPMENT: dict[str, Any] = {
    "clock": "crystal",
    "battery": 3900,
    "power": (),
    "radio": "none",
    "radio_resets": 0,
    "card": "logging",
    "card_block": 2,
    "card_blocks": 65536,
    "card_faults": 0,
    "card_busy": 3,
    "recording": 1,
    "messages_logged": 100,
    "messages_unlogged": 0,
}
SELF_TEST: dict[str, Any] = {
    "before": (-12, 340, 16384, 15, -9, 131),
    "stimulated": (6500, 6900, 22800, 8000, -7900, 8150),
    "after": (-11, 338, 16390, 14, -8, 130),
    "factory": (93, 95, 96, 112, 112, 113),
    "mag_response": (40, -60, -1900),
}
REPLY: dict[str, Any] = {
    "replied_command": "start",
    "replied_token": 1,
    "result": "ok",
    "value": (0, 0),
}
COMMAND: dict[str, Any] = {"command": "start", "token": 1, "arguments": (0, 0)}
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
