# SPDX-License-Identifier: MIT
"""A probe made of frames: hellos and poses with known sequence numbers and times."""

from __future__ import annotations

import struct
from typing import Any

from imud import published
from imud.wire import messages, schema
from imud.wire.frame import encode_frame

RATE_HZ = 200

_HEAD = struct.Struct(schema.HEADER)
_IDS = {message.name: message.id for message in schema.MESSAGES}
_POSE: dict[str, Any] = dict.fromkeys(published.WIRE["pose"].values()) | {
    "q": (0.5, 0.5, -0.5, 0.5),
    "position": (0.1, -0.2, 0.001),
    "tilt_sigma": 0.37,
    "heading_sigma": 1.25,
    "pose_flags": (),
}
_HELLO: dict[str, Any] = {
    "firmware": "made",
    "board": "nano",
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 178, 166),
    "sample_rate": RATE_HZ,
    "pose_rate": RATE_HZ,
    "boot_count": 1,
    "acc_lsb": 0.004788403,
    "gyr_lsb": 0.001065264,
    "mag_lsb": 0.15,
    "reset_cause": ("power_on",),
    "filter": "fuse",
}


class Source:
    """A streaming probe: a hello each second, poses in between; times are us."""

    def __init__(self, number: int, hello_every: int = RATE_HZ) -> None:
        self.hello_every = hello_every  # messages
        hello = _HELLO | {"probe_id": bytes([0xF0, *bytes(5)]) + number.to_bytes(2)}
        self.sequence = 0
        self.sent = 0
        self._pose = messages.encode("pose", _POSE, 0, 0)[_HEAD.size :]
        self._hello = messages.hello_of(**hello)[_HEAD.size :]

    def say(self, now_us: int) -> bytes:
        name = "pose" if self.sequence % self.hello_every else "hello"
        body = self._pose if name == "pose" else self._hello
        content = _HEAD.pack(_IDS[name], self.sequence, now_us & 0xFFFFFFFF) + body
        self.sequence += 1
        self.sent += 1
        return encode_frame(content)
