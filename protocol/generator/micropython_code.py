# SPDX-License-Identifier: MIT
"""The MicroPython: firmware/micropython/probe/wire.py."""

from __future__ import annotations

import struct
import textwrap

from generator.schema import COLUMNS, HEADER_SIZE, HELLO_SEED, Field, Message, Schema

START = '''\
# SPDX-License-Identifier: MIT
"""The wire as numbers, for a probe without the C module. Of each message the content,
with its id, its tags and what is not available in place; of each field where its value
begins, counted from the id.

Generated from schema.toml by protocol/generate.py.
"""

from micropython import const

'''

# Messages and commands of a probe without the module.
SENT = ("hello", "raw", "event", "status", "equipment", "params", "reply")
MESSAGES = (*SENT, "command")
ENUMS = ("command", "event", "cause", "result", "state", "sensor", "board")
FLAGS = ("sample", "stream", "power")
CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
ROW = 16  # bytes in a line


def value_of(field: Field, schema: Schema) -> bytes:
    """The value of a field before it is filled in."""
    if field.name == "protocol_version":
        return bytes([schema.version])
    if field.name == "schema_fingerprint":
        return schema.fingerprint.to_bytes(4, "little")
    if field.null is None:
        return bytes(field.size)
    return struct.pack(
        f"<{field.count}{CODES[field.type]}", *[field.null] * field.count
    )


def lines_of(message: Message, schema: Schema) -> list[str]:
    content = bytes([message.id]) + bytes(HEADER_SIZE - 1)
    places = []
    for field in message.fields:
        content += bytes([field.tag])
        name = f"{message.name}_{field.name}".upper()
        places.append(f"{name} = const({len(content)})")
        content += value_of(field, schema)
    fields = ", ".join(field.name for field in message.fields)
    head = textwrap.wrap(fields, COLUMNS - 2)
    about = [f"# {line}" for line in head]
    return ["", *about, *literal(message.name.upper(), content), *places]


def literal(name: str, content: bytes) -> list[str]:
    """An assignment of bytes, in one line where it fits."""
    rows = [content[at : at + ROW] for at in range(0, len(content), ROW)]
    text = ["".join(f"\\x{byte:02x}" for byte in row) for row in rows]
    whole = f'{name} = b"{"".join(text)}"'
    if len(whole) <= COLUMNS:
        return [whole]
    return [f"{name} = (", *(f'    b"{row}"' for row in text), ")"]


def module(schema: Schema) -> str:
    """The text of firmware/micropython/probe/wire.py."""
    lines = [
        f"SEED = const(0x{schema.seed:04X})  # of the CRC of all messages but hello",
        f"HELLO_SEED = const(0x{HELLO_SEED:04X})",
    ]
    for message in schema.messages:
        if message.name in MESSAGES:
            lines += lines_of(message, schema)
    for group in ENUMS:
        lines.append("")
        for name, value in schema.enums[group].items():
            lines.append(f"{group.upper()}_{name.upper()} = const({value})")
    for group in FLAGS:
        lines.append("")
        for name, bit in schema.flags[group].items():
            lines.append(f"{group.upper()}_{name.upper()} = const({1 << bit})")
    return START + "\n".join(lines) + "\n"
