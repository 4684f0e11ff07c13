# SPDX-License-Identifier: MIT
"""Converts the content of a frame to a message in SI units and back.

Content that does not match the schema exactly becomes a Skew, which is returned, not
raised. It is counted and never passed on.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Literal

import msgspec

from imud import _core
from imud.wire import schema
from imud.wire.fields import FieldCodec, Impossible, Parse
from imud.wire.fields import Value as Value  # what the fields of a Message hold

SkewKind = Literal[
    "missing",
    "doubled",
    "unknown",
    "out_of_order",
    "wrong_length",
    "unknown_message",
    "impossible_value",
]

# A hello that lacks one of these can't be used, whatever its version.
HELLO_NEEDS = frozenset({"schema_fingerprint", "firmware", "probe_id"})

_HEADER = struct.Struct(schema.HEADER)
# The content after its id, sequence number and time.
FIELDS_OF = slice(_HEADER.size, None)


class Message(msgspec.Struct, frozen=True):
    """One message: quantities in SI, enums and flags by name, None: not available.

    `time_us`: device time, modulo 2**32, as `sequence`.
    """

    name: str
    sequence: int
    time_us: int
    fields: Mapping[str, Value]


class Skew(msgspec.Struct, frozen=True):
    """Content that passed its CRC but must not be used, and why.

    `sequence` and `time_us` are None where the content is too short to hold them.
    """

    kind: SkewKind
    detail: str
    sequence: int | None
    time_us: int | None


class Codec:
    """Converts one message of the schema."""

    def __init__(self, message: schema.MessageType) -> None:
        self.name = message.name
        self.id = message.id
        self.direction = message.direction
        self.fields = [FieldCodec(field) for field in message.fields]
        self._tags = {field.tag for field in self.fields}
        self.size = _HEADER.size + sum(1 + field.size for field in self.fields)
        # Two structs over the whole content: one for the tags, one for the rest.
        gap, tags = _HEADER.size, "<"
        for field in self.fields:
            tags += f"{gap}xB"
            gap = field.size
        self._find_tags = struct.Struct(f"{tags}{gap}x").unpack
        self._tags_in_order = tuple(field.tag for field in self.fields)
        values = "".join("x" + field.code for field in self.fields)
        self._unpack = struct.Struct(schema.HEADER + values).unpack
        plain = tuple(each for f in self.fields if (each := f.plain()) is not None)
        # A quick reader of what is plainly right; None: the message has text.
        self._reader = _core.Reader(plain) if len(plain) == len(self.fields) else None
        self._places: list[tuple[str, Parse, int, int]] = []
        begin = 3  # after id, sequence and time
        for field in self.fields:
            end = begin + field.values
            self._places.append((field.name, field.parse, begin, end))
            begin = end

    def read(self, content: bytes) -> Message | None:
        """The message, if its content matches the schema; None: see `_examine`."""
        if self._reader is not None:
            found = self._reader.read(content)
            if found is not None:
                sequence, time_us, plain = found
                return Message(self.name, sequence, time_us, plain)
        if len(content) != self.size or self._find_tags(content) != self._tags_in_order:
            return None
        wire = self._unpack(content)
        fields = {}
        try:
            for name, parse, begin, end in self._places:
                fields[name] = parse(wire[begin:end])
        except Impossible:
            return None
        return Message(self.name, wire[1], wire[2], fields)

    def walk(self, content: bytes) -> tuple[int, int]:
        """How many fields are in their place, and the offset of the next."""
        offset = _HEADER.size
        for index, field in enumerate(self.fields):
            end = offset + 1 + field.size
            if end > len(content) or content[offset] != field.tag:
                return index, offset
            offset = end
        return len(self.fields), offset

    def fault(self, content: bytes, index: int, offset: int) -> tuple[SkewKind, str]:
        """Why the walk stopped, by the rules of core/wire/messages.c."""
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
            return "wrong_length", f"{expected.name} is truncated"
        if len(content) < self.size:
            return "missing", f"{expected.name} is missing"
        return "out_of_order", f"{self._field_name(tag)} comes before {expected.name}"

    def _field_name(self, tag: int) -> str:
        return next(field.name for field in self.fields if field.tag == tag)


# Names of the messages that a probe does not send.
FROM_HOST = frozenset(
    message.name for message in schema.MESSAGES if message.direction != "probe"
)

CODECS = {message.id: Codec(message) for message in schema.MESSAGES}
_BY_NAME = {codec.name: codec for codec in CODECS.values()}
_HELLO = _BY_NAME["hello"]
HELLO_ID = _HELLO.id


def decode(content: bytes) -> Message | Skew:
    """Content that passed its CRC, as a Message, or as a Skew if it can't be used."""
    codec = CODECS.get(content[0]) if content else None
    message = codec.read(content) if codec is not None else None
    return message if message is not None else _examine(content)


def _examine(content: bytes) -> Message | Skew:
    """Decodes field by field, to find what is wrong and where."""
    if len(content) < _HEADER.size:
        detail = f"{len(content)} bytes are shorter than a header"
        return Skew("wrong_length", detail, None, None)
    ident, sequence, time_us = _HEADER.unpack_from(content)
    codec = CODECS.get(ident)
    if codec is None:
        detail = f"no message has the id {ident:#04x}"
        return Skew("unknown_message", detail, sequence, time_us)
    count, offset = codec.walk(content)
    kind: SkewKind
    if count < len(codec.fields) or offset < len(content):
        kind, detail = codec.fault(content, count, offset)
        if codec is not _HELLO or not _is_other_hello(codec, content, count, kind):
            return Skew(kind, f"{codec.name}: {detail}", sequence, time_us)
    fields: dict[str, Value] = {}
    offset = _HEADER.size
    for field in codec.fields[:count]:
        try:
            fields[field.name] = field.unpack(content, offset + 1)
        except Impossible as impossible:
            if codec is not _HELLO or _fingerprint(content) == schema.FINGERPRINT:
                detail = f"{codec.name}: {impossible}"
                return Skew("impossible_value", detail, sequence, time_us)
            fields[field.name] = None
        offset += 1 + field.size
    return Message(codec.name, sequence, time_us, fields)


def _fingerprint(content: bytes) -> int | None:
    place = place_of("hello", "schema_fingerprint")
    if _HELLO.walk(content)[1] < place.stop:
        return None
    return int.from_bytes(content[place], "little")


def _is_other_hello(codec: Codec, content: bytes, count: int, kind: SkewKind) -> bool:
    """Whether a hello that does not match is one of an older or a later schema.

    Hellos only grow at their end: an older one stops early, a later one continues with
    tags that we don't know.
    """
    if kind == "unknown" and count == len(codec.fields):
        return True
    names = {field.name for field in codec.fields[:count]}
    is_other = names >= HELLO_NEEDS and _fingerprint(content) != schema.FINGERPRINT
    return is_other and kind in ("missing", "unknown")


def place_of(name: str, field: str) -> slice:
    """Where the value of a field is in the content of a message, behind its tag."""
    offset = _HEADER.size
    for each in _BY_NAME[name].fields:
        if each.name == field:
            return slice(offset + 1, offset + 1 + each.size)
        offset += 1 + each.size
    raise ValueError(f"{name} has no field {field}")


def hello_of(**fields: object) -> bytes:
    """The content of a hello of our schema: encode() without the fields that are not
    known, or zeros.
    """
    ours = {
        "protocol_version": schema.PROTOCOL_VERSION,
        "schema_fingerprint": schema.FINGERPRINT,
    }
    return encode("hello", ours | fields, 0, 0, is_whole=False)


def encode(
    name: str,
    fields: Mapping[str, object],
    sequence: int,
    time_us: int,
    *,
    is_whole: bool = True,
) -> bytes:
    """The content of a message, of values as Message has them; one that is not whole
    has blanks for the other fields.

    Raises ValueError if a field is missing, unknown, or does not fit.
    """
    codec = _BY_NAME[name]
    names = {field.name for field in codec.fields}
    if odd := fields.keys() ^ names if is_whole else fields.keys() - names:
        raise ValueError(f"{name}: unknown or missing fields {sorted(odd)}")
    parts = [_HEADER.pack(codec.id, sequence & 0xFFFFFFFF, time_us & 0xFFFFFFFF)]
    for field in codec.fields:
        is_known = field.name in fields
        value = field.pack(fields[field.name]) if is_known else field.blank()
        parts += (bytes([field.tag]), value)
    return b"".join(parts)
