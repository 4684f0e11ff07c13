# SPDX-License-Identifier: MIT
"""A frame decoder written from PROTOCOL.md alone, to hold the C against."""

from __future__ import annotations

import binascii

from imud.wire import schema

HELLO_ID = 0x03
CONTENT_MAX = 120


def cobs_decode(block: bytes) -> bytes | None:
    """The bytes of a frame without its delimiter, or None where a code is wrong."""
    out = b""
    while block:
        code, block = block[0], block[1:]
        if len(block) < code - 1:
            return None
        out += block[: code - 1]
        block = block[code - 1 :]
        if block and code < 255:
            out += b"\0"
    return out


def contents(data: bytes) -> list[bytes]:
    """The content of each good frame in a stream that begins at a frame."""
    found = []
    for block in data.split(b"\0")[:-1]:
        decoded = cobs_decode(block) if block else None
        if decoded is None or not 3 <= len(decoded) <= CONTENT_MAX + 2:
            continue
        content, crc = decoded[:-2], int.from_bytes(decoded[-2:], "little")
        seed = 0xFFFF if content[0] == HELLO_ID else schema.FINGERPRINT & 0xFFFF
        # binascii's is the same polynomial, most significant bit first, no final xor.
        if binascii.crc_hqx(content, seed) == crc:
            found.append(content)
    return found
