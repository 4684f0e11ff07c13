# SPDX-License-Identifier: MIT
"""A probe made of frames: hellos and poses with known sequence numbers and times."""

from __future__ import annotations

import struct
from typing import Any

from imud.wire import messages, schema
from imud.wire.frame import encode_frame

RATE_HZ = 200
PERIOD_US = 1_000_000 // RATE_HZ

_HEAD = struct.Struct(schema.HEADER)
_IDS = {message.name: message.id for message in schema.MESSAGES}
_POSE: dict[str, Any] = {
    "q": (0.5, 0.5, -0.5, 0.5),
    "position": (0.1, -0.2, 0.3),
    "normal": None,
    "tilt_sigma": 0.37,
    "heading_sigma": 1.25,
    "pose_flags": (),
}
_HELLO: dict[str, Any] = {
    "protocol_version": schema.PROTOCOL_VERSION,
    "schema_fingerprint": schema.FINGERPRINT,
    "firmware": "soak",
    "board": "nano",
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 178, 166),
    "self_test": (),
    "sample_rate": RATE_HZ,
    "pose_rate": RATE_HZ,
    "raw_rate": 0,
    "acc_lsb": 0.004788403,
    "gyr_lsb": 0.001065264,
    "mag_lsb": 0.15,
    "reset_cause": ("power_on",),
    "filter": "fuse",
    "reset_address": 0,
    "params_digest": 0,
    "own_field": (0, 0, 0),
    "own_sigma": 0,
}


class Source:
    """A streaming probe: a hello each second, poses in between.

    Its clock is fast by `fast_ppm`; times are microseconds.
    """

    def __init__(
        self,
        number: int,
        fast_ppm: float = 0.0,
        hello_every: int = RATE_HZ,
        pose_flags: tuple[str, ...] = (),
    ) -> None:
        self._pose_flags = pose_flags
        self.hello_every = hello_every  # messages
        self._pace = 1.0 + fast_ppm * 1e-6
        self.id = bytes([0xF0, 0, 0, 0, 0, 0]) + number.to_bytes(2, "big")
        self.name = self.id.hex()
        self.boot_count = 1
        self.sequence = 0
        self.sent = 0
        self._began_us = 0
        self._bodies: set[tuple[bool, bytes]] = set()
        self._prepare()

    def _prepare(self) -> None:
        # Different in each boot, so that messages of two boots never look the same.
        position = (0.1, -0.2, self.boot_count / 1000)
        pose = _POSE | {"position": position, "pose_flags": self._pose_flags}
        self._pose = messages.encode("pose", pose, 0, 0)[_HEAD.size :]
        hello = _HELLO | {"probe_id": self.id, "boot_count": self.boot_count}
        self._hello = messages.encode("hello", hello, 0, 0)[_HEAD.size :]
        self._bodies |= {(False, self._pose), (True, self._hello)}

    def has_sent(self, content: bytes) -> bool:
        """Whether the probe sent exactly this content in some boot."""
        ident, sequence, time_us = _HEAD.unpack_from(content)
        is_hello = sequence % self.hello_every == 0
        return (
            ident == _IDS["hello" if is_hello else "pose"]
            and time_us == self._device_us(sequence * PERIOD_US) & 0xFFFFFFFF
            and (is_hello, content[_HEAD.size :]) in self._bodies
        )

    def _device_us(self, since_us: int) -> int:
        return int(since_us * self._pace)

    def true_us(self, device_us: int) -> float:
        """True time of a device time in the current boot."""
        return self._began_us + device_us / self._pace

    def reset(self, now_us: int) -> None:
        self.boot_count += 1
        self.sequence = 0
        self._began_us = now_us
        self._prepare()

    def say(self, now_us: int) -> bytes:
        name = "pose" if self.sequence % self.hello_every else "hello"
        body = self._pose if name == "pose" else self._hello
        time_us = self._device_us(now_us - self._began_us) & 0xFFFFFFFF
        content = _HEAD.pack(_IDS[name], self.sequence, time_us) + body
        self.sequence += 1
        self.sent += 1
        return encode_frame(content)
