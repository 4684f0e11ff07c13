# SPDX-License-Identifier: MIT
"""The tables of PROTOCOL.md, written between its markers; the prose is left alone."""

from __future__ import annotations

from collections.abc import Iterable

from generator.schema import (
    HEADER_SIZE,
    HELLO_SEED,
    Field,
    Schema,
    SchemaError,
)

BEGIN, END = "<!-- begin generated: {} -->", "<!-- end generated -->"


def document(schema: Schema, text: str) -> str:
    """PROTOCOL.md's text with its tables replaced; SchemaError if a marker is gone."""
    for name, lines in (
        ("constants", constants(schema)),
        ("messages", messages(schema)),
        ("records", records(schema)),
        ("groups", groups(schema)),
    ):
        text = filled("protocol/PROTOCOL.md", text, name, lines)
    return text


def filled(place: str, text: str, name: str, lines: list[str]) -> str:
    """A document with these lines between its markers of that name."""
    begin = BEGIN.format(name)
    if text.count(begin) != 1 or END not in text.split(begin)[1]:
        raise SchemaError(f"{place}: needs one line {begin!r}, and {END!r} after it")
    before, rest = text.split(begin)
    after = rest.split(END, 1)[1]
    return "\n".join([before + begin, *lines, END + after])


def constants(schema: Schema) -> list[str]:
    return table(
        "| constant | value |",
        [
            ["protocol version", str(schema.version)],
            ["fingerprint of the schema", f"`{schema.fingerprint:#010x}`"],
            ["CRC seed of all messages but hello", f"`{schema.seed:#06x}`"],
            ["CRC seed of hello", f"`{HELLO_SEED:#06x}`"],
        ],
    )


def messages(schema: Schema) -> list[str]:
    lines: list[str] = []
    for message in schema.messages:
        sender = "the probe" if message.direction == "probe" else "the host"
        lines += [
            "",
            f"### {message.name}, `{message.id:#04x}`",
            "",
            f"{message.meaning} From {sender}; {message.size} bytes of content.",
            "",
        ]
        rows = []
        offset = HEADER_SIZE
        for field in message.fields:
            rows.append([str(offset), str(field.tag), *row(field)])
            offset += 1 + field.size
        lines += table("| at | tag | field | values | unit | null | meaning |", rows)
    return lines[1:]


def records(schema: Schema) -> list[str]:
    lines: list[str] = []
    for record in schema.records:
        lines += [
            "",
            f"### {record.name}, tag {record.tag}",
            "",
            f"{record.meaning} {record.size} bytes.",
            "",
        ]
        rows = []
        offset = 0
        for part in record.parts:
            rows.append([str(offset), *row(part)])
            offset += part.size
        lines += table("| at | part | values | unit | null | meaning |", rows)
    return lines[1:]


def row(field: Field) -> list[str]:
    """The cells of a field or part that do not tell its place."""
    unit = field.scaled_unit
    if field.enum:
        unit = f"enum {field.enum}"
    if field.flags:
        unit = f"flags {field.flags}"
    return [
        f"`{field.name}`",
        f"`{field.type}`" + (f" x {field.count}" if field.count > 1 else ""),
        unit,
        "" if field.null is None else str(field.null),
        field.meaning,
    ]


def groups(schema: Schema) -> list[str]:
    rows = [
        [f"enum {group}", ", ".join(f"{v} `{n}`" for n, v in members.items())]
        for group, members in schema.enums.items()
    ]
    rows += [
        [f"flags {group}", ", ".join(f"bit {v} `{n}`" for n, v in members.items())]
        for group, members in schema.flags.items()
    ]
    return table("| group | members |", rows)


def table(head: str, rows: Iterable[Iterable[str]]) -> list[str]:
    columns = head.count("|") - 1
    lines = [head, "|---" * columns + "|"]
    return lines + [f"| {' | '.join(cells)} |" for cells in rows]
