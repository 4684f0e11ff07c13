# SPDX-License-Identifier: MIT
"""Content of a frame to a message and back, as the schema says. SI past this point.

A message that is not exactly as the schema says is skew: data about the wire, to be
counted and never passed on. It is returned, not raised.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from enum import IntEnum, IntFlag
from typing import Any, Literal

import msgspec

from imud.wire import schema

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


class Message(msgspec.Struct, frozen=True):
    """One message: quantities in SI, enums and flags by name, None: not available."""

    name: str
    sequence: int
    time_us: int
    fields: Mapping[str, Value]

    @property
    def is_from_probe(self) -> bool:
        return _BY_NAME[self.name].direction == "probe"


class Skew(msgspec.Struct, frozen=True):
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


# The numbers of a field on the wire, or its bytes as the only one, to what they say.
Parse = Callable[[tuple[Any, ...]], Value]


def _enum_parser(name: str, enum: type[IntEnum]) -> Parse:
    names = _enum_names(enum)

    def parse(wire: tuple[int, ...]) -> str:
        try:
            return names[wire[0]]
        except KeyError:
            raise _Impossible(f"{name} is {wire[0]}") from None

    return parse


def _flags_parser(name: str, flags: type[IntFlag]) -> Parse:
    bits = _flag_names(flags)
    known = sum(bit for bit, _ in bits)
    seen: dict[int, tuple[str, ...]] = {}  # of what is possible, a few are in use

    def parse(wire: tuple[int, ...]) -> tuple[str, ...]:
        number = wire[0]
        names = seen.get(number)
        if names is None:
            if number & ~known:
                raise _Impossible(f"{name} is {number:#x}")
            names = tuple(name for bit, name in bits if number & bit)
            seen[number] = names
        return names

    return parse


# Wire numbers to quantities.
Scale = Callable[[tuple[int, ...]], tuple[float, ...]]


def _divider(count: int, by: float) -> Scale:
    # Written out where it is done hundreds of times a second: half the time of a loop.
    if count == 1:
        return lambda wire: (wire[0] / by,)
    if count == 3:
        return lambda wire: (wire[0] / by, wire[1] / by, wire[2] / by)
    if count == 4:
        return lambda wire: (wire[0] / by, wire[1] / by, wire[2] / by, wire[3] / by)
    return lambda wire: tuple([number / by for number in wire])


def _multiplier(by: float) -> Scale:
    return lambda wire: tuple([number * by for number in wire])


def _number_parser(
    name: str, count: int, null: int | None, scale: Scale | None
) -> Parse:
    """Of wire numbers; `scale` makes quantities of them, None leaves them alone."""

    nulls = (null,) * count

    def parse_one(wire: tuple[int, ...]) -> Value:
        if wire[0] == null:
            return None
        return wire[0] if scale is None else scale(wire)[0]

    def parse_more(wire: tuple[int, ...]) -> Value:
        if null in wire:
            if wire != nulls:
                raise _Impossible(f"{name} is available in part")
            return None
        return wire if scale is None else scale(wire)

    def parse_unit(wire: tuple[int, ...]) -> Value:
        values = parse_more(wire)
        if isinstance(values, tuple):
            norm = math.hypot(*values)
            if abs(norm - 1) > NORM_TOLERANCE:
                raise _Impossible(f"{name} has the norm {norm:.4f}")
        return values

    if scale is not None and name in UNIT_FIELDS:
        return parse_unit
    return parse_one if count == 1 else parse_more


def _text_parser(name: str) -> Parse:
    def parse(wire: tuple[bytes, ...]) -> str:
        text = wire[0].rstrip(b"\0")
        if not text.isascii() or not text.decode("latin-1").isprintable():
            raise _Impossible(f"{name} is {wire[0]!r}")
        return text.decode("ascii")

    return parse


class _Field:
    """One field of the schema, made ready to convert values."""

    def __init__(self, field: schema.Field) -> None:
        self.name = field.name
        self.tag = field.tag
        self.size = struct.calcsize("<" + field.code)
        self.code = field.code
        # How many values struct makes of it.
        self.values = 1 if field.type in ("text", "bytes") else field.count
        # Wire numbers are divided by a whole number where the scale is 1/n: that gives
        # the double nearest to the decimal, 0.07 and not 0.07000000000000001.
        inverse = round(1 / field.scale)
        self._is_inverse = math.isclose(inverse * field.scale, 1.0, rel_tol=1e-12)
        self._factor = inverse if self._is_inverse else field.scale
        self.parse = self._parser(field)
        self._field = field

    def _parser(self, field: schema.Field) -> Parse:
        if field.type == "bytes":
            return lambda wire: wire[0]
        if field.type == "text":
            return _text_parser(field.name)
        if field.enum is not None:
            return _enum_parser(field.name, field.enum)
        if field.flags is not None:
            return _flags_parser(field.name, field.flags)
        scale = None
        if field.scale != 1.0 and self._is_inverse:
            scale = _divider(field.count, self._factor)
        elif field.scale != 1.0:
            scale = _multiplier(self._factor)
        return _number_parser(field.name, field.count, field.null, scale)

    def unpack(self, content: bytes, offset: int) -> Value:
        return self.parse(struct.unpack_from("<" + self.code, content, offset))

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
        # The whole content at once: its tags, and all that is not a tag.
        gap, tags = _HEADER.size, "<"
        for field in self.fields:
            tags += f"{gap}xB"
            gap = field.size
        self._find_tags = struct.Struct(f"{tags}{gap}x").unpack
        self._tags_in_order = tuple(field.tag for field in self.fields)
        values = "".join("x" + field.code for field in self.fields)
        self._unpack = struct.Struct(schema.HEADER + values).unpack
        self._places: list[tuple[str, Parse, int, int]] = []
        begin = 3  # after id, sequence and time
        for field in self.fields:
            end = begin + field.values
            self._places.append((field.name, field.parse, begin, end))
            begin = end

    def read(self, content: bytes) -> Message | None:
        """Content that is in all as the schema says; None: it takes a closer look."""
        if len(content) != self.size or self._find_tags(content) != self._tags_in_order:
            return None
        wire = self._unpack(content)
        fields = {}
        try:
            for name, parse, begin, end in self._places:
                fields[name] = parse(wire[begin:end])
        except _Impossible:
            return None
        return Message(self.name, wire[1], wire[2], fields)

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
        """Names what stopped the walk, by the rules of core/wire/messages.c."""
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
    codec = _BY_ID.get(content[0]) if content else None
    message = codec.read(content) if codec is not None else None
    return message if message is not None else _examine(content)


def _examine(content: bytes) -> Message | Skew:
    """The same, field by field: what is wrong, and where."""
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
