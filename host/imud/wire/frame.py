# SPDX-License-Identifier: MIT
"""Converts bytes to the content of frames and back, with the firmware's own C."""

from __future__ import annotations

from dataclasses import dataclass

from imud import _core
from imud.wire import schema

HELLO_ID = next(message.id for message in schema.MESSAGES if message.name == "hello")


@dataclass(frozen=True, slots=True)
class FrameStats:
    """Counts of frames: good ones, and bad ones by what was wrong."""

    ok: int = 0
    bad_cobs: int = 0
    bad_crc: int = 0
    too_long: int = 0
    too_short: int = 0

    @property
    def bad(self) -> dict[str, int]:
        """Bad frames by kind."""
        kinds = ("bad_cobs", "bad_crc", "too_long", "too_short")
        return {kind: getattr(self, kind) for kind in kinds}


class FrameDecoder:
    """Turns received bytes into the content of frames, in chunks of any size."""

    def __init__(self) -> None:
        self._decoder = _core.FrameDecoder(schema.SEED, HELLO_ID)

    def feed(self, data: bytes) -> list[bytes]:
        """The content of each good frame that these bytes complete, without its CRC."""
        return self._decoder.feed(data)

    @property
    def bad(self) -> int:
        """The number of bad frames of all kinds."""
        return self._decoder.bad()

    @property
    def stats(self) -> FrameStats:
        return FrameStats(**self._decoder.stats())


def encode_frame(content: bytes) -> bytes:
    """The frame of a message's content, with the delimiter at its end."""
    is_hello = content[:1] == bytes([HELLO_ID])
    return _core.encode_frame(schema.HELLO_SEED if is_hello else schema.SEED, content)
