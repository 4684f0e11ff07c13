# SPDX-License-Identifier: MIT
"""The Python: host/imud/wire/schema.py."""

from __future__ import annotations

from decimal import Decimal

from generator.schema import COLUMNS, HELLO_SEED, Field, Schema, scale_words

START = """\
# SPDX-License-Identifier: MIT
\"\"\"The wire as data: what schema.toml says, for messages.py to work from.

Generated from schema.toml by protocol/generate.py.
\"\"\"

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

PROTOCOL_VERSION = {version}
FINGERPRINT = {fingerprint}
SEED = {seed}  # of the CRC of all messages but hello
HELLO_SEED = {hello_seed}
HEADER = "<BII"  # id, sequence, time_us
"""

FIELD_TYPES = """

# Field has a member `type`, inside which the builtin is out of reach.
Enums = type[IntEnum]
Flags = type[IntFlag]

# The struct code of one value.
CODES = {
    "u8": "B",
    "i8": "b",
    "u16": "H",
    "i16": "h",
    "u32": "I",
    "i32": "i",
    "text": "s",
    "bytes": "s",
}


@dataclass(frozen=True, slots=True)
class Field:
    \"\"\"A field; a wire number times `scale` is in `unit`.\"\"\"

    name: str
    tag: int
    type: str
    count: int = 1
    scale: float = 1.0
    unit: str = ""
    null: int | None = None  # the wire number, in all values, for "not available"
    enum: Enums | None = None
    flags: Flags | None = None
    format: Literal["", "hex"] = ""

    @property
    def code(self) -> str:
        \"\"\"The struct code of all its values, such as "3h" or "16s".\"\"\"
        return f"{self.count}{CODES[self.type]}"


@dataclass(frozen=True, slots=True)
class MessageType:
    name: str
    id: int
    direction: Literal["probe", "host"]
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class RecordType:
    \"\"\"A record of the params; its parts are fields without a tag (0).\"\"\"

    name: str
    tag: int
    parts: tuple[Field, ...]
"""


def hexadecimal(value: int, digits: int) -> str:
    return f"0x{value:0{digits}X}"


def class_name(group: str, suffix: str = "") -> str:
    return "".join(word.capitalize() for word in group.split("_")) + suffix


def scale_code(scale: Decimal | str) -> str:
    words = scale_words(scale)
    return f"2.0**{words[2:]}" if isinstance(scale, str) else words


def field_lines(field: Field) -> list[str]:
    """The call of Field() that describes a field, broken if it is too long."""
    parts = [f'"{field.name}"', str(field.tag), f'"{field.type}"']
    if field.count > 1:
        parts.append(str(field.count))
    if field.scale != 1:
        parts.append(f"scale={scale_code(field.scale)}")
    if field.unit:
        parts.append(f'unit="{field.unit}"')
    if field.null is not None:
        parts.append(f"null={field.null}")
    if field.enum:
        parts.append(f"enum={class_name(field.enum)}")
    if field.flags:
        parts.append(f"flags={class_name(field.flags, 'Flags')}")
    if field.format:
        parts.append(f'format="{field.format}"')
    indent = " " * 12
    line = f"{indent}Field({', '.join(parts)}),"
    if len(line) <= COLUMNS:
        return [line]
    return [f"{indent}Field(", f"{indent}    {', '.join(parts)}", f"{indent}),"]


def module(schema: Schema) -> str:
    """The text of host/imud/wire/schema.py."""
    lines = START.format(
        version=schema.version,
        fingerprint=hexadecimal(schema.fingerprint, 8),
        seed=hexadecimal(schema.seed, 4),
        hello_seed=hexadecimal(HELLO_SEED, 4),
    ).splitlines()
    for group, members in schema.enums.items():
        lines += ["", "", f"class {class_name(group)}(IntEnum):"]
        lines += [f"    {name.upper()} = {value}" for name, value in members.items()]
    for group, members in schema.flags.items():
        lines += ["", "", f"class {class_name(group, 'Flags')}(IntFlag):"]
        lines += [f"    {name.upper()} = 1 << {bit}" for name, bit in members.items()]
    lines += FIELD_TYPES.splitlines()
    lines += ["", "", "MESSAGES = ("]
    for message in schema.messages:
        lines += [
            "    MessageType(",
            f'        "{message.name}",',
            f"        {hexadecimal(message.id, 2)},",
            f'        "{message.direction}",',
            "        (",
        ]
        for field in message.fields:
            lines += field_lines(field)
        lines += ["        ),", "    ),"]
    lines += [")", "", "RECORDS = ("]
    for record in schema.records:
        lines += [
            "    RecordType(",
            f'        "{record.name}",',
            f"        {record.tag},",
        ]
        parts = [line for part in record.parts for line in field_lines(part)]
        if len(parts) == 1:  # as the formatter has it
            lines += [f"        ({parts[0].strip()}),", "    ),"]
        else:
            lines += ["        (", *parts, "        ),", "    ),"]
    lines += [")"]
    return "".join(f"{line}\n" for line in lines)
