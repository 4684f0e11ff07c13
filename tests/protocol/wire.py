# SPDX-License-Identifier: MIT
"""The firmware's frame.c and messages.c with Python types, and the vectors as data."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import native
from protocol import derived

ROOT = Path(__file__).resolve().parents[2]


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / "protocol" / name).read_text("utf-8"))


# Those that are worked out by hand, and what follows from them.
BY_HAND: dict[str, list[dict[str, Any]]] = _read("vectors.toml")
SCHEMA = _read("schema.toml")
VECTORS = BY_HAND | {
    "good": BY_HAND["good"] + [*derived.good(BY_HAND["good"], SCHEMA)],
    "skew": [*derived.skewed(BY_HAND["good"])],
}

ffi, lib = native.load()

HELLO_ID = lib.MESSAGE_HELLO
HEADER_SIZE = 9
FRAME_FAULTS = {
    lib.FRAME_BAD_COBS: "bad_cobs",
    lib.FRAME_BAD_CRC: "bad_crc",
    lib.FRAME_TOO_LONG: "too_long",
    lib.FRAME_TOO_SHORT: "too_short",
}
RESULTS = {
    lib.MESSAGE_OK: "ok",
    lib.MESSAGE_MISSING_FIELD: "missing",
    lib.MESSAGE_DOUBLED_FIELD: "doubled",
    lib.MESSAGE_UNKNOWN_FIELD: "unknown",
    lib.MESSAGE_OUT_OF_ORDER: "out_of_order",
    lib.MESSAGE_WRONG_LENGTH: "wrong_length",
    lib.MESSAGE_WRONG_ID: "wrong_id",
}
IDS = {
    name: getattr(lib, f"MESSAGE_{name.upper()}")
    for name in (message["name"] for message in SCHEMA["message"])
}

# Guard bytes after a buffer, which the C must not touch.
GUARD = b"\xa5" * 8


def unhex(text: str) -> bytes:
    return bytes.fromhex(text)


def seed_of(content: bytes, seed: int) -> int:
    """The seed of this content's frame, where `seed` is the schema's."""
    return lib.FRAME_HELLO_SEED if content[0] == HELLO_ID else seed


def crc(seed: int, data: bytes) -> int:
    return int(lib.frame_crc(seed, data, len(data)))


def encode_frame(seed: int, content: bytes) -> bytes:
    size = len(content) + lib.FRAME_AROUND
    room = ffi.new("uint8_t[]", list(b"\xa5" + content + bytes(3) + GUARD))
    length = lib.frame_encode(seed, room, len(content))
    assert bytes(room[size : len(room)]) == GUARD
    return bytes(room[0:length])


class Decoder:
    """frame_decode() over chunks: contents as bytes, faults by name."""

    def __init__(self, seed: int) -> None:
        self.c = ffi.new("struct frame_decoder *")
        self._length = ffi.new("uint8_t *")
        self._bytes = ffi.new("uint8_t[]", lib.FRAME_CONTENT_MAX + lib.FRAME_CRC)
        lib.frame_decoder_init(self.c, seed, HELLO_ID, self._bytes, len(self._bytes))

    def feed(self, data: Iterable[int]) -> list[bytes | str]:
        found: list[bytes | str] = []
        for byte in data:
            result = lib.frame_decode(self.c, byte, self._length)
            if result == lib.FRAME_OK:
                found.append(bytes(self.c.bytes[0 : self._length[0]]))
            elif result != lib.FRAME_PENDING:
                found.append(FRAME_FAULTS[result])
        return found


def good(found: Iterable[bytes | str]) -> list[bytes]:
    return [item for item in found if isinstance(item, bytes)]


def field_types(name: str) -> list[tuple[str, Any]]:
    return [
        (field, entry.type)
        for field, entry in ffi.typeof(f"struct message_{name}").fields
    ]


def is_characters(kind: Any) -> bool:
    return kind.kind == "array" and kind.item.cname == "char"


def encode_message(
    name: str, fields: Mapping[str, Any], sequence: int, time_us: int
) -> bytes:
    """Encode by the C; fields are wire numbers, text as str, bytes as hex."""
    message = ffi.new(f"struct message_{name} *")
    for field, kind in field_types(name):
        value = fields[field]
        if is_characters(kind):
            value = value.encode("ascii").ljust(kind.length, b"\0")
        elif isinstance(value, str):
            value = list(bytes.fromhex(value))
        setattr(message, field, value)
    room = ffi.new("uint8_t[]", lib.MESSAGE_CONTENT_MAX + len(GUARD))
    ffi.memmove(room + lib.MESSAGE_CONTENT_MAX, GUARD, len(GUARD))
    encode = getattr(lib, f"message_{name}_encode")
    length = encode(message, sequence, time_us, room)
    assert bytes(room[lib.MESSAGE_CONTENT_MAX : len(room)]) == GUARD
    return bytes(room[0:length])


def assert_taken_alike(
    name: str, data: Any, length: int, result: str, decoded: Any
) -> None:
    """The short decoder judges as the long one does, and finds the same."""
    taken = ffi.new(f"struct message_{name} *")
    ffi.memmove(taken, b"\xa5" * ffi.sizeof(taken[0]), ffi.sizeof(taken[0]))
    if getattr(lib, f"message_{name}_take")(data, length, taken):
        assert result == "ok"
        assert bytes(ffi.buffer(taken)) == bytes(ffi.buffer(decoded))
    else:  # only a hello may have more at its end
        assert result != "ok" or name == "hello"


def decode_message(
    name: str, content: bytes, behind: bytes = GUARD
) -> tuple[str, tuple[int, int, int], dict[str, Any]]:
    """Decode by the C: result, header and fields as wire numbers, text stripped.

    `behind` are bytes that follow in memory and must not be read.
    """
    header = ffi.new("struct message_header *")
    message = ffi.new(f"struct message_{name} *")
    ffi.memmove(header, b"\xa5" * ffi.sizeof(header[0]), ffi.sizeof(header[0]))
    ffi.memmove(message, b"\xa5" * ffi.sizeof(message[0]), ffi.sizeof(message[0]))
    decode = getattr(lib, f"message_{name}_decode")
    data = ffi.new("uint8_t[]", content + behind)
    result = RESULTS[decode(data, len(content), header, message)]
    if content:
        assert_taken_alike(name, data, len(content), result, message)
    if result != "ok":
        assert bytes(ffi.buffer(header)) == b"\xa5" * ffi.sizeof(header[0])
        assert bytes(ffi.buffer(message)) == b"\xa5" * ffi.sizeof(message[0])
    fields = fields_of(name, message)
    return result, (header.id, header.sequence, header.time_us), fields


def fields_of(name: str, message: Any) -> dict[str, Any]:
    """The wire numbers in a struct of that message, of any library of ours."""
    fields: dict[str, Any] = {}
    for field, kind in field_types(name):
        value = getattr(message, field)
        if is_characters(kind):
            text = bytes(value[i][0] for i in range(len(value)))
            fields[field] = text.rstrip(b"\0").decode("latin-1")
        else:
            fields[field] = list(value) if kind.kind == "array" else value
    return fields


def as_bytes_hex(fields: dict[str, Any], like: dict[str, Any]) -> dict[str, Any]:
    """Arrays that the vector writes as hex, so that both can be compared."""
    return {
        name: bytes(value).hex()
        if isinstance(like[name], str) and isinstance(value, list)
        else value
        for name, value in fields.items()
    }
