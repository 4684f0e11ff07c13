# SPDX-License-Identifier: MIT
"""The schema as data: messages, records, enums and flags, and their fingerprint."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from decimal import Decimal

HEADER_SIZE = 9  # id, sequence u32, time_us u32
CONTENT_MAX = 120  # FRAME_CONTENT_MAX of firmware/core/wire/frame.h
RECORD_MAX = 255  # bytes; its length is told in one
HELLO_SEED = 0xFFFF
COLUMNS = 88  # of a generated line


class SchemaError(Exception):
    """The schema cannot be used. One line for each problem, with its place."""


@dataclass(frozen=True, slots=True)
class Type:
    """A type of value on the wire; `size` in bytes."""

    size: int
    c: str
    range: tuple[int, int] | None  # None: not a number


TYPES = {
    "u8": Type(1, "uint8_t", (0, 2**8 - 1)),
    "i8": Type(1, "int8_t", (-(2**7), 2**7 - 1)),
    "u16": Type(2, "uint16_t", (0, 2**16 - 1)),
    "i16": Type(2, "int16_t", (-(2**15), 2**15 - 1)),
    "u32": Type(4, "uint32_t", (0, 2**32 - 1)),
    "i32": Type(4, "int32_t", (-(2**31), 2**31 - 1)),
    "text": Type(1, "char", None),
    "bytes": Type(1, "uint8_t", None),
}


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a message, or a part of a record, whose tag is 0; a wire number times
    `scale` is in `unit`.
    """

    name: str
    tag: int
    type: str
    meaning: str
    count: int = 1
    scale: Decimal | str = Decimal(1)  # str: a power of two, "2^-30"
    unit: str = ""
    null: int | None = None
    enum: str = ""
    flags: str = ""
    format: str = ""

    @property
    def size(self) -> int:
        """Bytes of its values, without its tag."""
        return TYPES[self.type].size * self.count

    @property
    def scaled_unit(self) -> str:
        """Scale and unit as people read them: "0.01 m/s2", "2^-30", "uT"."""
        scale = "" if self.scale == 1 else scale_words(self.scale)
        return " ".join(word for word in (scale, self.unit) if word)


@dataclass(frozen=True, slots=True)
class Message:
    """A message; `direction` names its sender, "probe" or "host"."""

    name: str
    id: int
    direction: str
    meaning: str
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        """Bytes of content: the header, then a tag and its values for each field."""
        return HEADER_SIZE + sum(1 + field.size for field in self.fields)


@dataclass(frozen=True, slots=True)
class Record:
    """A record of the params."""

    name: str
    tag: int
    meaning: str
    parts: tuple[Field, ...]

    @property
    def size(self) -> int:
        """Bytes of its parts, without its tag and length."""
        return sum(part.size for part in self.parts)


@dataclass(frozen=True, slots=True)
class Schema:
    """All messages and records. Enums map names to values, flags map names to bits."""

    version: int
    enums: dict[str, dict[str, int]]
    flags: dict[str, dict[str, int]]
    messages: tuple[Message, ...]
    records: tuple[Record, ...]

    @property
    def canonical(self) -> str:
        """All that gives the bytes of messages their meaning, and nothing else
        (PROTOCOL.md).
        """
        lines = [f"version {self.version}"]
        fields = [field for message in self.messages for field in message.fields]
        parts = {part.enum for record in self.records for part in record.parts}
        only_parts = parts - {field.enum for field in fields}
        for kind, groups in (("enum", self.enums), ("flags", self.flags)):
            for group in sorted(groups.keys() - only_parts):
                members = sorted(groups[group].items(), key=lambda item: item[1])
                words = (f"{name}={value}" for name, value in members)
                lines.append(" ".join([kind, group, *words]))
        for message in sorted(self.messages, key=lambda message: message.id):
            lines.append(f"message {message.name} {message.id}")
            lines += map(canonical_field, message.fields)
        return "".join(f"{line}\n" for line in lines)

    @property
    def fingerprint(self) -> int:
        """The first 32 bits of the canonical text's SHA-256, little endian."""
        digest = hashlib.sha256(self.canonical.encode()).digest()
        return int.from_bytes(digest[:4], "little")

    @property
    def seed(self) -> int:
        """Start of the CRC-16 of all messages but hello."""
        return self.fingerprint & 0xFFFF


def canonical_field(field: Field) -> str:
    null = "-" if field.null is None else field.null
    return (
        f"field {field.name} {field.tag} {field.type} {field.count} "
        f"{scale_text(field.scale)} {field.unit or '-'} {null} "
        f"{field.enum or '-'} {field.flags or '-'}"
    )


def scale_text(scale: Decimal | str) -> str:
    """One spelling for each value: 0.01, 1e-2 and 10e-3 are all "1e-2"."""
    if isinstance(scale, str):
        return scale
    _, digits, exponent = scale.normalize().as_tuple()
    return f"{''.join(map(str, digits))}e{exponent}"


def scale_words(scale: Decimal | str) -> str:
    """The scale as people, C comments and Python read it: 0.01, 1e-9, 2^-30."""
    if isinstance(scale, str):
        return scale
    plain = f"{scale.normalize():f}"
    return plain if len(plain) <= len("0.001") else scale_text(scale)
