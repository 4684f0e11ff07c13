# SPDX-License-Identifier: MIT
"""Frames that one core decodes in a second: with our C, Python, and pymavlink."""

from __future__ import annotations

import binascii
import time
from collections.abc import Callable
from typing import Any

from benchmarks.common.source import RATE_HZ, Source
from imud.wire import messages, schema
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message

READ_BYTES = 4096

DECODE_TARGET = 2e6  # frames/s


class PlainDecoder:
    """FrameDecoder with the standard library alone, to compare with."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        *frames, self._rest = (self._rest + data).split(b"\0")
        return [content for frame in frames if (content := self._content(frame))]

    def _content(self, frame: bytes) -> bytes | None:
        out = bytearray()
        at = 0
        while at < len(frame):
            code = frame[at]
            out += frame[at + 1 : at + code]
            at += code
            if at < len(frame):
                out.append(0)
        if at != len(frame) or len(out) < 3:
            return None
        content, crc = bytes(out[:-2]), int.from_bytes(out[-2:], "little")
        is_hello = content[0] == HELLO_ID
        seed = schema.HELLO_SEED if is_hello else schema.SEED
        return content if binascii.crc_hqx(content, seed) == crc else None


HELLO_ID = next(message.id for message in schema.MESSAGES if message.name == "hello")


def rate_of(feed: Callable[[bytes], int], data: bytes, seconds: float) -> float:
    """Frames per second of CPU time, the best run within this many seconds: other
    programs slow down the rest.
    """
    reads = [data[i : i + READ_BYTES] for i in range(0, len(data), READ_BYTES)]
    best, until = 0.0, time.monotonic() + seconds
    while time.monotonic() < until or best == 0.0:
        begin = time.process_time()
        count = sum(map(feed, reads))
        best = max(best, count / (time.process_time() - begin))
    return best


def decoding(frames: int, seconds: float) -> dict[str, Any]:
    """Frames/s of each decoder, with poses and a MAVLink message of their size."""
    source = Source(0)
    source.sequence = 1
    poses = [source.say(i * 5000) for i in range(RATE_HZ - 1)]
    many = b"".join(poses) * (frames // len(poses) + 1)
    few = many[: len(many) // 20]
    ours, whole, plain = FrameDecoder(), FrameDecoder(), PlainDecoder()
    decode = messages.decode

    def to_messages(data: bytes) -> int:
        decoded = [decode(content) for content in whole.feed(data)]
        return sum(isinstance(each, Message) for each in decoded)

    size, mavlink = mavlink_rate(frames // 20, seconds)
    return {
        "frame_bytes": len(poses[0]),
        "mavlink_bytes": size,
        "read_bytes": READ_BYTES,
        "frames_a_second": {
            "frames, C": rate_of(lambda data: len(ours.feed(data)), many, seconds),
            "frames, Python": rate_of(lambda data: len(plain.feed(data)), few, seconds),
            "messages, C + Python": rate_of(to_messages, few, seconds),
            "messages, pymavlink": mavlink,
        },
    }


def mavlink_rate(frames: int, seconds: float) -> tuple[int, float]:
    """Bytes and frames/s of ATTITUDE_QUATERNION with its offset, much like a pose."""
    from pymavlink.dialects.v20 import common

    parser = common.MAVLink(None)
    frame = common.MAVLink_attitude_quaternion_message(
        1, 0.5, 0.5, -0.5, 0.5, 0.1, 0.2, 0.3, (1.0, 0.1, 0.1, 0.1)
    ).pack(parser)

    def feed(data: bytes) -> int:
        return len(parser.parse_buffer(data) or ())

    return len(frame), rate_of(feed, bytes(frame) * frames, seconds)


def tell_decoding(found: dict[str, Any]) -> None:
    print(
        f"one core, reads of {found['read_bytes']} bytes, frames of "
        f"{found['frame_bytes']} bytes (MAVLink: {found['mavlink_bytes']})"
    )
    for name, rate in found["frames_a_second"].items():
        note = ""
        if name == "frames, C":
            is_met = rate >= DECODE_TARGET
            note = f"  target {DECODE_TARGET:,.0f}: " + ("met" if is_met else "NOT met")
        print(f"  {name:22}{rate:14,.0f} frames/s{note}")
