# SPDX-License-Identifier: MIT
"""OpenIGTLink messages as bytes: protocol version 3, big endian.

Source: Documents/Protocol/ of openigtlink/OpenIGTLink. The CRC is that of ECMA-182
over the body, so that a body can be sent again under another time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from struct import Struct
from typing import NamedTuple

_HEADER = Struct(">H12s20sQQQ")
_VERSION = 2  # of the header: with an extended header and metadata in the body

_EXTENDED = Struct(">HHII")
_COUNT = Struct(">H")
_ENTRY = Struct(">HHI")
_MATRIX = Struct(">12f")
_STRING = Struct(">HH")
_US_ASCII = 3  # MIBenum of IANA

# by this, PLUS accepts a transform as valid.
_GOOD = {"TransformStatus": "OK"}

Vector = Sequence[float]

_POLYNOMIAL = 0x42F0E1EBA9EA3693
_64_BITS = (1 << 64) - 1


def _table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = (crc << 1 ^ (_POLYNOMIAL if crc >> 63 else 0)) & _64_BITS
        table.append(crc)
    return table


_TABLE = _table()


def crc64(data: bytes) -> int:
    """The CRC of ECMA-182: from 0, highest bit first, nothing inverted."""
    crc = 0
    for byte in data:
        crc = _TABLE[crc >> 56 ^ byte] ^ (crc << 8 & _64_BITS)
    return crc


class MessageBody(NamedTuple):
    """The body of a message with its type and CRC."""

    kind: bytes
    data: bytes
    crc: int


def transform(rows: Sequence[Vector], translation_m: Vector) -> MessageBody:
    """TRANSFORM: the rows of a rotation matrix, and a translation, sent in mm."""
    columns = [value for column in zip(*rows, strict=True) for value in column]
    content = _MATRIX.pack(*columns, *(1000.0 * each for each in translation_m))
    return _body(b"TRANSFORM", content, _GOOD)


def string(text: str) -> MessageBody:
    """STRING, in ASCII: a question mark for any other character."""
    data = text.encode("ascii", "replace")
    return _body(b"STRING", _STRING.pack(_US_ASCII, len(data)) + data, {})


def message(name: str, t_ns: int, body: MessageBody) -> bytes:
    """A message by its device name, of at most 20 ASCII characters; UTC in ns."""
    stamp = (t_ns << 32) // 10**9  # seconds, 32 bits of them below the point
    head = (body.kind, name.encode("ascii"), stamp, len(body.data), body.crc)
    return _HEADER.pack(_VERSION, *head) + body.data


def _body(kind: bytes, content: bytes, metadata: Mapping[str, str]) -> MessageBody:
    index, texts = _COUNT.pack(len(metadata)), b""
    for key, value in metadata.items():
        index += _ENTRY.pack(len(key), _US_ASCII, len(value))
        texts += key.encode("ascii") + value.encode("ascii")
    extended = _EXTENDED.pack(_EXTENDED.size, len(index), len(texts), 0)
    data = extended + content + index + texts
    return MessageBody(kind, data, crc64(data))
