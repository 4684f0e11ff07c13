# SPDX-License-Identifier: MIT
"""Content of a frame to a message and back, as the schema says. SI past this point.

A message that is not exactly as the schema says is skew: data about the wire, to be
counted and never passed on. It is returned, not raised.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

from imud import schema

SkewKind = Literal[
    "missing",
    "doubled",
    "unknown",
    "out_of_order",
    "wrong_length",
    "unknown_message",
    "impossible_value",
]

Scalar = int | float | str | bytes
Value = Scalar | tuple[int, ...] | tuple[float, ...] | tuple[str, ...] | None

# A unit quaternion or normal may be off by its rounding and no more; the fusion
# normalises to a few parts in a million, damage that passes a CRC would not.
NORM_TOLERANCE = 1e-3

# Fields that hold a unit vector or quaternion.
UNIT_FIELDS = frozenset({"q", "normal"})

# A hello that lacks one of these can't be used, whatever its version.
HELLO_NEEDS = frozenset({"schema_fingerprint", "firmware", "probe_id"})

_HEADER = struct.Struct(schema.HEADER)


@dataclass(frozen=True, slots=True)
class Message:
    """One message: quantities in SI, enums and flags by name, None: not available."""

    name: str
    sequence: int
    time_us: int
    fields: Mapping[str, Value]

    @property
    def is_from_probe(self) -> bool:
        return _BY_NAME[self.name].direction == "probe"


@dataclass(frozen=True, slots=True)
class Skew:
    """Content that passed its CRC and is not to be used, and why.

    `sequence` and `time_us` are None where the content is too short to hold them.
    """

    kind: SkewKind
    detail: str
    sequence: int | None
    time_us: int | None


class _Impossible(Exception):
    """A value that the schema excludes."""


def _enum_names(enum: type[IntEnum]) -> dict[int, str]:
    return {member.value: member.name.lower() for member in enum}


def _flag_names(flags: type[IntFlag]) -> list[tuple[int, str]]:
    return [(member.value, str(member.name).lower()) for member in flags]


class _Field:
    """One field of the schema, made ready to convert values."""

    def __init__(self, field: schema.Field) -> None:
        self.name = field.name
        self.tag = field.tag
        self.size = struct.calcsize("<" + field.code)
        self.code = field.code
        # Wire numbers are divided by a whole number where the scale is 1/n: that gives
        # the double nearest to the decimal, 0.07 and not 0.07000000000000001.
        inverse = round(1 / field.scale)
        self._is_inverse = math.isclose(inverse * field.scale, 1.0, rel_tol=1e-12)
        self._factor = inverse if self._is_inverse else field.scale
        self.parse = self._parser(field)
        self._field = field

    def _parser(self, field: schema.Field) -> Callable[[tuple[int, ...]], Value]:
        if field.enum is not None:
            names = _enum_names(field.enum)
            return lambda wire: self._name(names, wire[0])
        if field.flags is not None:
            bits = _flag_names(field.flags)
            return lambda wire: self._names(bits, wire[0])
        if field.scale != 1.0:
            return self._quantity
        return self._number

    def _name(self, names: dict[int, str], wire: int) -> str:
        try:
            return names[wire]
        except KeyError:
            raise _Impossible(f"{self.name} is {wire}") from None

    def _names(self, bits: list[tuple[int, str]], wire: int) -> tuple[str, ...]:
        found = tuple(name for bit, name in bits if wire & bit)
        if wire & ~sum(bit for bit, _ in bits):
            raise _Impossible(f"{self.name} is {wire:#x}")
        return found

    def _number(self, wire: tuple[int, ...]) -> Value:
        if self._is_null(wire):
            return None
        return wire[0] if len(wire) == 1 else wire

    def _quantity(self, wire: tuple[int, ...]) -> Value:
        if self._is_null(wire):
            return None
        factor = self._factor
        if self._is_inverse:
            values = tuple(number / factor for number in wire)
        else:
            values = tuple(number * factor for number in wire)
        if self.name in UNIT_FIELDS and abs(math.hypot(*values) - 1) > NORM_TOLERANCE:
            raise _Impossible(f"{self.name} has the norm {math.hypot(*values):.4f}")
        return values[0] if len(values) == 1 else values

    def _is_null(self, wire: tuple[int, ...]) -> bool:
        null = self._field.null
        if null is None or null not in wire:
            return False
        if any(number != null for number in wire):
            raise _Impossible(f"{self.name} is available in part")
        return True

    def parse_bytes(self, wire: bytes) -> Value:
        if self._field.type == "bytes":
            return wire
        text = wire.rstrip(b"\0")
        if not text.isascii() or not text.decode("latin-1").isprintable():
            raise _Impossible(f"{self.name} is {wire!r}")
        return text.decode("ascii")

    def unpack(self, content: bytes, offset: int) -> Value:
        values = struct.unpack_from("<" + self.code, content, offset)
        if self._field.type in ("text", "bytes"):
            return self.parse_bytes(values[0])
        return self.parse(values)

    def pack(self, value: object) -> bytes:
        """The wire bytes of a value; ValueError where it doesn't fit."""
        field = self._field
        try:
            if field.type in ("text", "bytes"):
                raw = value.encode("ascii") if isinstance(value, str) else value
                if not isinstance(raw, bytes) or len(raw) > field.count:
                    raise ValueError(f"at most {field.count} bytes")  # noqa: TRY301
                return struct.pack("<" + self.code, raw)
            return struct.pack("<" + self.code, *self._wire(value))
        except (KeyError, TypeError, ValueError, struct.error) as error:
            raise ValueError(f"{self.name} can't be {value!r}: {error}") from error

    def _wire(self, value: object) -> list[int]:
        field = self._field
        if value is None:
            if field.null is None:
                raise ValueError("it is always available")
            return [field.null] * field.count
        if field.enum is not None:
            return [field.enum[str(value).upper()]]
        if field.flags is not None:
            names = value if isinstance(value, list | tuple | set) else ()
            return [sum(field.flags[str(name).upper()] for name in set(names))]
        numbers = _numbers(value)
        if len(numbers) != field.count:
            raise ValueError(f"{field.count} numbers are needed")
        if field.scale == 1.0:
            return [int(number) for number in numbers]
        if self._is_inverse:
            return [round(number * self._factor) for number in numbers]
        return [round(number / self._factor) for number in numbers]


def _numbers(value: object) -> list[int | float]:
    values = list(value) if isinstance(value, list | tuple) else [value]
    numbers = [number for number in values if isinstance(number, int | float)]
    if len(numbers) != len(values):
        raise TypeError("it is not made of numbers")
    return numbers


class _Codec:
    """One message of the schema, made ready to convert."""

    def __init__(self, message: schema.MessageType) -> None:
        self.name = message.name
        self.id = message.id
        self.direction = message.direction
        self.fields = [_Field(field) for field in message.fields]
        self._tags = {field.tag for field in self.fields}
        self.size = _HEADER.size + sum(1 + field.size for field in self.fields)

    def walk(self, content: bytes) -> tuple[int, int]:
        """How many fields are in their place, and where the first other starts."""
        offset = _HEADER.size
        for index, field in enumerate(self.fields):
            end = offset + 1 + field.size
            if end > len(content) or content[offset] != field.tag:
                return index, offset
            offset = end
        return len(self.fields), offset

    def fault(self, content: bytes, index: int, offset: int) -> tuple[SkewKind, str]:
        """Names what stopped the walk; firmware/core/messages.c has the same rules."""
        is_whole = index == len(self.fields)
        expected = None if is_whole else self.fields[index]
        if offset == len(content):
            return "missing", f"{expected.name if expected else ''} is missing"
        tag = content[offset]
        if tag not in self._tags:
            return "unknown", f"tag {tag} is not of this message"
        if expected is None or tag < expected.tag:
            return "doubled", f"{self._field_name(tag)} comes twice"
        if tag == expected.tag:
            return "wrong_length", f"{expected.name} is cut off"
        if len(content) < self.size:
            return "missing", f"{expected.name} is missing"
        return "out_of_order", f"{self._field_name(tag)} comes before {expected.name}"

    def _field_name(self, tag: int) -> str:
        return next(field.name for field in self.fields if field.tag == tag)


_CODECS = [_Codec(message) for message in schema.MESSAGES]
_BY_ID = {codec.id: codec for codec in _CODECS}
_BY_NAME = {codec.name: codec for codec in _CODECS}

HELLO_ID = _BY_NAME["hello"].id


def decode(content: bytes) -> Message | Skew:
    """Content that passed its CRC to what it says, or to why it is not to be used."""
    if len(content) < _HEADER.size:
        detail = f"{len(content)} bytes are less than a header"
        return Skew("wrong_length", detail, None, None)
    ident, sequence, time_us = _HEADER.unpack_from(content)
    codec = _BY_ID.get(ident)
    if codec is None:
        detail = f"no message has the id {ident:#04x}"
        return Skew("unknown_message", detail, sequence, time_us)
    count, offset = codec.walk(content)
    kind: SkewKind
    if count < len(codec.fields) or offset < len(content):
        kind, detail = codec.fault(content, count, offset)
        if codec.id != HELLO_ID or not _is_other_hello(codec, content, count, kind):
            return Skew(kind, f"{codec.name}: {detail}", sequence, time_us)
    fields: dict[str, Value] = {}
    offset = _HEADER.size
    for field in codec.fields[:count]:
        try:
            fields[field.name] = field.unpack(content, offset + 1)
        except _Impossible as impossible:
            if codec.id != HELLO_ID or _fingerprint(content) == schema.FINGERPRINT:
                detail = f"{codec.name}: {impossible}"
                return Skew("impossible_value", detail, sequence, time_us)
            fields[field.name] = None
        offset += 1 + field.size
    return Message(codec.name, sequence, time_us, fields)


def _fingerprint(content: bytes) -> int | None:
    count, _ = _BY_ID[HELLO_ID].walk(content)
    offset = _HEADER.size
    for field in _BY_ID[HELLO_ID].fields[:count]:
        if field.name == "schema_fingerprint":
            value = field.unpack(content, offset + 1)
            return value if isinstance(value, int) else None
        offset += 1 + field.size
    return None


def _is_other_hello(codec: _Codec, content: bytes, count: int, kind: SkewKind) -> bool:
    """Whether a hello that is not ours is one of an older or a later schema.

    It only ever grows at its end: an older one stops early, a later one goes on with
    tags that are not ours.
    """
    if kind == "unknown" and count == len(codec.fields):
        return True
    names = {field.name for field in codec.fields[:count]}
    is_other = names >= HELLO_NEEDS and _fingerprint(content) != schema.FINGERPRINT
    return is_other and kind in ("missing", "unknown")


def encode(
    name: str, fields: Mapping[str, object], sequence: int, time_us: int
) -> bytes:
    """The content of a message; ValueError where a field is missing or can't be."""
    codec = _BY_NAME[name]
    unknown = fields.keys() - {field.name for field in codec.fields}
    missing = {field.name for field in codec.fields} - fields.keys()
    if unknown or missing:
        raise ValueError(f"{name}: fields {sorted(unknown | missing)} don't belong")
    parts = [_HEADER.pack(codec.id, sequence & 0xFFFFFFFF, time_us & 0xFFFFFFFF)]
    for field in codec.fields:
        parts.append(bytes([field.tag]))
        parts.append(field.pack(fields[field.name]))
    return b"".join(parts)
