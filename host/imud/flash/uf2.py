# SPDX-License-Identifier: MIT
"""Images in UF2 (UF2 File Format, Microsoft): blocks of 512 bytes, each with where its
bytes of flash go and the chip that they are for. The boot loader of a Pico takes them.
"""

from __future__ import annotations

import struct
from pathlib import Path

from imud.errors import FlashError

MARK = b"UF2\n"
FAMILIES = {"rp2040": 0xE48BFF56, "rp2350": 0xE48BFF59}  # by the format's own list

_SECOND, _END = 0x9E5D5157, 0x0AB16F30
_HAS_FAMILY = 0x2000
_PAYLOAD, _PAYLOAD_MAX, _BLOCK = 256, 476, 512
_HEAD = struct.Struct("<4s7I")
_END_AT = _BLOCK - 4


def encoded(image: bytes, start: int, family: int) -> bytes:
    """The blocks of an image that begins at an address."""
    pieces = [image[at : at + _PAYLOAD] for at in range(0, len(image), _PAYLOAD)]
    made = bytearray()
    for number, piece in enumerate(pieces):
        address = start + number * _PAYLOAD
        size = (_PAYLOAD, number, len(pieces), family)
        head = _HEAD.pack(MARK, _SECOND, _HAS_FAMILY, address, *size)
        made += (head + piece).ljust(_END_AT, b"\0") + struct.pack("<I", _END)
    return bytes(made)


def decoded(path: Path, raw: bytes) -> dict[int, int]:
    """Bytes by their addresses. FlashError if it is damaged, or for another chip than a
    Pico's.
    """
    code: dict[int, int] = {}
    if len(raw) % _BLOCK:
        raise FlashError(f"{path} is a truncated UF2 file; get it again")
    for at in range(0, len(raw), _BLOCK):
        mark, second, flags, address, size, number, count, family = _HEAD.unpack_from(
            raw, at
        )
        (end,) = struct.unpack_from("<I", raw, at + _END_AT)
        is_whole = (mark, second, end) == (MARK, _SECOND, _END)
        is_in_order = number == at // _BLOCK and count == len(raw) // _BLOCK
        is_new = address not in code and address + size - 1 not in code
        if not (is_whole and is_in_order and is_new and 0 < size <= _PAYLOAD_MAX):
            raise FlashError(f"{path} is a damaged UF2 file; get it again")
        if not flags & _HAS_FAMILY or family != FAMILIES["rp2040"]:
            raise FlashError(f"{path} is not for a Pico's RP2040")
        piece = raw[at + _HEAD.size : at + _HEAD.size + size]
        code.update(enumerate(piece, start=address))
    return code
