# SPDX-License-Identifier: MIT
"""The C: firmware/core/wire/messages.h and messages.c, core/params/records.h."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from textwrap import wrap

from generator.schema import (
    COLUMNS,
    HEADER_SIZE,
    TYPES,
    Field,
    Message,
    Record,
    Schema,
)

LAYOUT = Path(__file__).parent / "layout.c"

RESULTS = (
    ("MESSAGE_OK", 0, ""),
    ("MESSAGE_MISSING_FIELD", -1, ""),
    ("MESSAGE_DOUBLED_FIELD", -2, ""),
    ("MESSAGE_UNKNOWN_FIELD", -3, "a tag that is not of this message"),
    ("MESSAGE_OUT_OF_ORDER", -4, ""),
    ("MESSAGE_WRONG_LENGTH", -5, "the content ends in its header or in a value"),
    ("MESSAGE_WRONG_ID", -6, ""),
)
TAKEN = (
    *(name for name, _, _ in RESULTS),
    "MESSAGE_CONTENT_MAX",
    "PROTOCOL_VERSION",
    "SCHEMA_FINGERPRINT",
    "SCHEMA_SEED",
)


def clashes(schema: Schema) -> Iterator[tuple[str, str]]:
    """Names that are used twice in C: their places in the schema, and a message."""
    seen = dict.fromkeys(TAKEN, "frame.h or messages.h")
    for place, name in constants(schema):
        if name in seen:
            yield place, f"its C name {name} is taken by {seen[name]}"
        seen[name] = place


def constants(schema: Schema) -> Iterator[tuple[str, str]]:
    """Each constant of messages.h: its place in the schema, and its name."""
    for message in schema.messages:
        place = f"message {message.name}"
        yield place, id_name(message)
        yield place, size_name(message)
        for field in message.fields:
            if field.null is not None:
                yield f"{place}: field {field.name}", null_name(message, field)
    for record in schema.records:
        place = f"record {record.name}"
        yield place, record_name(record)
        yield place, f"{record_name(record)}_SIZE"
        for part in record.parts:
            if part.null is not None:
                yield f"{place}: part {part.name}", null_name(record, part)
    for kind, groups in (("enums", schema.enums), ("flags", schema.flags)):
        for group, members in groups.items():
            for name in members:
                yield f"{kind}.{group}", f"{group}_{name}".upper()


def id_name(message: Message) -> str:
    return f"MESSAGE_{message.name.upper()}"


def size_name(message: Message) -> str:
    return f"MESSAGE_{message.name.upper()}_SIZE"


def record_name(record: Record) -> str:
    return f"PARAMS_{record.name.upper()}"


def null_name(owner: Message | Record, field: Field) -> str:
    return f"{owner.name}_{field.name}_null".upper()


def records_header(schema: Schema) -> str:
    """The text of records.h."""
    lines = [
        "// SPDX-License-Identifier: MIT",
        "// The records of the params. Generated from schema.toml by",
        "// protocol/generate.py; what each part means is in PROTOCOL.md.",
        "#ifndef RECORDS_H",
        "#define RECORDS_H",
        "",
        "#include <stdint.h>",
        "",
        "// Tags.",
        "enum params_record {",
        *(f"    {record_name(r)} = {r.tag}," for r in schema.records),
        "};",
        "",
        "// Bytes of the parts.",
        "enum {",
        *(f"    {record_name(r)}_SIZE = {r.size}," for r in schema.records),
        "};",
        "",
        '// Numbers that say "not known", in every value of a part.',
    ]
    for record in schema.records:
        lines += nulls(record, record.parts)
    for record in schema.records:
        lines += ["", f"struct record_{record.name} {{"]
        lines += with_comments(map(member, record.parts))
        lines += ["};"]
    lines += ["", "#endif"]
    return "".join(f"{line}\n" for line in lines)


def nulls(owner: Message | Record, fields: Iterable[Field]) -> Iterator[str]:
    """A constant for each null."""
    for field in fields:
        if field.null is not None:
            null = number(field.null, field.type)
            yield f"#define {null_name(owner, field)} {null}"


def header(schema: Schema) -> str:
    """The text of messages.h."""
    lines = [
        *prologue("protocol/generate.py; what each field means is in PROTOCOL.md."),
        "#ifndef MESSAGES_H",
        "#define MESSAGES_H",
        "",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "",
        '#include "core/math/in_flash.h"',
        "",
        *header_constants(schema),
        "",
        "enum message_result {",
        *with_comments((f"{name} = {n},", note) for name, n, note in RESULTS),
        "};",
        "",
        "struct message_header {",
        "    uint8_t id;",
        "    uint32_t sequence;",
        "    uint32_t time_us;",
        "};",
        "",
        "// encode() writes to `content` (the message's size) and returns the length.",
        "// The message may be in the same buffer, behind the header and all tags.",
        "// decode() leaves `header` and `out` untouched unless MESSAGE_OK. take() is",
        "// as strict, says no more than true, and only then `out` is good. Its length",
        "// is not 0.",
        "//",
        "// message_fill() encodes a message of any layout, but for the two numbers of",
        "// its header: those lie at these offsets of the content.",
        "enum { MESSAGE_SEQUENCE_AT = 1, MESSAGE_TIME_AT = 5 };",
        "typedef const IN_FLASH uint8_t message_layout;",
        *wrapped(
            "uint8_t message_fill(",
            ["message_layout *layout", "const void *message", "uint8_t *content"],
            ");",
        ),
    ]
    for message in schema.messages:
        lines += ["", f"struct message_{message.name} {{"]
        lines += with_comments(map(member, message.fields))
        lines += ["};", "", *encode_head(message, ";"), *decode_head(message, ";")]
        lines += [*take_head(message, ";"), f"extern {layout_head(message)};"]
    lines += ["", "#endif"]
    return "".join(f"{line}\n" for line in lines)


def header_constants(schema: Schema) -> Iterator[str]:
    longest = max(message.size for message in schema.messages)
    yield f"#define SCHEMA_FINGERPRINT {schema.fingerprint:#010x}u"
    yield f"#define SCHEMA_SEED {schema.seed:#06x}u  // CRC of all messages but hello"
    yield from ("", "enum {")
    yield f"    PROTOCOL_VERSION = {schema.version},"
    yield f"    MESSAGE_CONTENT_MAX = {longest},  // the longest message"
    yield from ("};", "", "enum message_id {")
    yield from (f"    {id_name(m)} = {m.id:#04x}," for m in schema.messages)
    yield from ("};", "", "// Bytes of content.", "enum {")
    yield from (f"    {size_name(m)} = {m.size}," for m in schema.messages)
    yield "};"
    for group, members in schema.enums.items():
        yield from ("", f"enum {group} {{")
        for name, value in members.items():
            yield f"    {f'{group}_{name}'.upper()} = {value},"
        yield "};"
    for group, members in schema.flags.items():
        yield from ("", "enum {")
        for name, bit in members.items():
            yield f"    {f'{group}_{name}'.upper()} = 1u << {bit},"
        yield "};"
    yield from (
        "",
        '// Wire numbers that say "not available", in every value of a field.',
    )
    for message in schema.messages:
        yield from nulls(message, message.fields)


def source(schema: Schema) -> str:
    """The text of messages.c: layout.c, then each message's table and functions."""
    _, _, layout = LAYOUT.read_text("utf-8").partition("\n\n")
    lines = [*prologue("protocol/generate.py."), *layout.splitlines()]
    for message in schema.messages:
        lines += functions(message)
    return "".join(f"{line}\n" for line in lines)


def functions(message: Message) -> Iterator[str]:
    """A message's layout, its encoder and its decoder."""
    name = f"message_{message.name}_layout"
    yield from ("", f"{layout_head(message)} = {{", f"    {id_name(message)},")
    yield from with_comments(
        (f"FIELD({field.tag}, {field.count}, {TYPES[field.type].size}),", field.name)
        for field in message.fields
    )
    yield from ("    0,", "};", "", *encode_head(message, " {"))
    yield f"    return encode({name}, message, sequence, time_us, content);"
    yield from ("}", "", *decode_head(message, " {"))
    size = size_name(message)
    decoded = [name, "content", "length", size, "header", "out"]
    yield from wrapped("    return decode(", decoded, ");")
    yield from ("}", "", *take_head(message, " {"))
    yield from take_body(message)


def take_body(message: Message) -> Iterator[str]:
    """The short decoder without a walk over the layout, which takes more of the AVR."""
    wrong = [f"length != {size_name(message)}", f"content[0] != {id_name(message)}"]
    copies = []
    at = HEADER_SIZE
    for field in message.fields:
        wrong.append(f"content[{at}] != {field.tag}")
        target = f"out->{field.name}" if field.count > 1 else f"&out->{field.name}"
        copies.append(f"    memcpy({target}, content + {at + 1}, {field.size});")
        at += 1 + field.size
    # A condition stays in one line, with what follows it.
    test = "\0|| ".join(wrong).replace(" != ", "\0!=\0")
    test = f"if ({test})\0{{"
    for line in wrap(test, COLUMNS, initial_indent=" " * 4, subsequent_indent=" " * 8):
        yield line.replace("\0", " ")
    yield from ("        return false;", "    }", *copies, "    return true;", "}")


def prologue(last: str) -> tuple[str, ...]:
    return (
        "// SPDX-License-Identifier: MIT",
        "// Messages to content bytes and back. Generated from schema.toml by",
        f"// {last}",
    )


def layout_head(message: Message) -> str:
    """The declaration of a message's layout."""
    length = 1 + 2 * len(message.fields) + 1
    return f"message_layout message_{message.name}_layout[{length}]"


def encode_head(message: Message, end: str) -> list[str]:
    """The encoder up to `end`: a semicolon, or what opens its body."""
    return wrapped(
        f"uint8_t message_{message.name}_encode(",
        [
            f"const struct message_{message.name} *message",
            "uint32_t sequence",
            "uint32_t time_us",
            "uint8_t *content",
        ],
        f"){end}",
    )


def take_head(message: Message, end: str) -> list[str]:
    """The short decoder up to `end`: a semicolon, or what opens its body."""
    return wrapped(
        f"bool message_{message.name}_take(",
        [
            "const uint8_t *content",
            "uint8_t length",
            f"struct message_{message.name} *out",
        ],
        f"){end}",
    )


def decode_head(message: Message, end: str) -> list[str]:
    """The decoder up to `end`: a semicolon, or what opens its body."""
    return wrapped(
        f"enum message_result message_{message.name}_decode(",
        [
            "const uint8_t *content",
            "uint8_t length",
            "struct message_header *header",
            f"struct message_{message.name} *out",
        ],
        f"){end}",
    )


def member(field: Field) -> tuple[str, str]:
    """A field as a member of its message's struct, and its comment."""
    array = f"[{field.count}]" if field.count > 1 else ""
    note = field.scaled_unit
    if field.enum:
        note = f"enum {field.enum}"
    if field.flags:
        note = f"{field.flags.upper()}_ flags"
    return f"{TYPES[field.type].c} {field.name}{array};", note


def number(value: int, kind: str) -> str:
    """The value as C writes it, limits by their names from <stdint.h>."""
    limits = TYPES[kind].range or (0, 0)
    signedness, bits = ("INT" if kind[0] == "i" else "UINT"), kind[1:]
    if value == limits[1]:
        return f"{signedness}{bits}_MAX"
    if value == limits[0] and value < 0:
        return f"{signedness}{bits}_MIN"
    return f"{signedness}{bits}_C({value})"


def wrapped(start: str, items: Iterable[str], end: str) -> list[str]:
    """`start` item, item... `end`, broken into lines as by clang-format."""
    lines, hang = [start], " " * len(start)
    words = list(items)
    for index, word in enumerate(words):
        piece = word + ("," if index + 1 < len(words) else end)
        gap = "" if lines[-1].endswith("(") or lines[-1] == hang else " "
        if len(lines[-1]) + len(gap) + len(piece) > COLUMNS:
            lines.append(hang + piece)
        else:
            lines[-1] += gap + piece
    return lines


def with_comments(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Indented code; comments of successive lines are aligned."""
    for has_comment, run in groupby(rows, key=lambda row: bool(row[1])):
        lines = list(run)
        width = max(len(code) for code, _ in lines)
        for code, comment in lines:
            yield f"    {code:<{width}}  // {comment}" if has_comment else f"    {code}"
