# SPDX-License-Identifier: MIT
"""Makes the C, the Python and the tables of PROTOCOL.md from schema.toml.

`python protocol/generate.py` writes those that are stale; with `--check` it writes
nothing, says which they are and exits 1.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from itertools import combinations
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SCHEMA = ROOT / "protocol" / "schema.toml"
C_HEADER = Path("firmware/core/wire/messages.h")
C_SOURCE = Path("firmware/core/wire/messages.c")
PYTHON = Path("host/imud/wire/schema.py")
DOCUMENT = Path("protocol/PROTOCOL.md")

HEADER_SIZE = 9  # id, sequence u32, time_us u32
CONTENT_MAX = 120  # FRAME_CONTENT_MAX of firmware/core/wire/frame.h
HELLO_SEED = 0xFFFF
COLUMNS = 88
DIFF_LINES = 20  # of a stale file, enough to see what it is about

# What any version must find in a hello, whatever its schema.
HELLO_ID = 0x03
HELLO_START = (("protocol_version", 1, "u8"), ("schema_fingerprint", 2, "u32"))

NAME = re.compile(r"[a-z][a-z0-9_]*")
BINARY_SCALE = re.compile(r"2\^-[1-9][0-9]?")


@dataclass(frozen=True, slots=True)
class Type:
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
        return TYPES[self.type].size * self.count


@dataclass(frozen=True, slots=True)
class Message:
    name: str
    id: int
    direction: str
    meaning: str
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        return HEADER_SIZE + sum(1 + field.size for field in self.fields)


@dataclass(frozen=True, slots=True)
class Schema:
    version: int
    enums: dict[str, dict[str, int]]
    flags: dict[str, dict[str, int]]
    messages: tuple[Message, ...]

    @property
    def canonical(self) -> str:
        """All that gives the bytes their meaning, and nothing else (PROTOCOL.md)."""
        lines = [f"version {self.version}"]
        for kind, groups in (("enum", self.enums), ("flags", self.flags)):
            for group in sorted(groups):
                members = sorted(groups[group].items(), key=lambda item: item[1])
                words = (f"{name}={value}" for name, value in members)
                lines.append(" ".join([kind, group, *words]))
        for message in sorted(self.messages, key=lambda message: message.id):
            lines.append(f"message {message.name} {message.id}")
            for field in message.fields:
                null = "-" if field.null is None else field.null
                lines.append(
                    f"field {field.name} {field.tag} {field.type} {field.count} "
                    f"{scale_text(field.scale)} {field.unit or '-'} {null} "
                    f"{field.enum or '-'} {field.flags or '-'}"
                )
        return "".join(f"{line}\n" for line in lines)

    @property
    def fingerprint(self) -> int:
        digest = hashlib.sha256(self.canonical.encode()).digest()
        return int.from_bytes(digest[:4], "little")

    @property
    def seed(self) -> int:
        return self.fingerprint & 0xFFFF


def scale_text(scale: Decimal | str) -> str:
    """One spelling a value: 0.01, 1e-2 and 10e-3 are all "1e-2"."""
    if isinstance(scale, str):
        return scale
    _, digits, exponent = scale.normalize().as_tuple()
    return f"{''.join(map(str, digits))}e{exponent}"


class SchemaError(Exception):
    """The schema can't be used; one line a problem, each naming its place."""


class Checker:
    """Turns the tables of the schema into a Schema and collects what is wrong."""

    def __init__(self, raw: dict[str, Any]) -> None:
        self.raw = raw
        self.problems: list[str] = []

    def schema(self) -> Schema:
        self.keys("schema", self.raw, {"protocol", "enums", "flags", "message"})
        protocol = self.table("protocol", self.raw.get("protocol"))
        self.keys("protocol", protocol, {"version"})
        version = self.number("protocol: version", protocol.get("version"), 1, 255)
        enums = self.groups("enums", 255)
        flags = self.groups("flags", 31)
        tables = self.raw.get("message")
        if not isinstance(tables, list) or not tables:
            self.say("message", "there is none")
            tables = []
        messages = tuple(
            self.message(index, table, enums, flags)
            for index, table in enumerate(tables)
        )
        self.check_together(messages)
        schema = Schema(version, enums, flags, messages)
        if not self.problems:
            self.check_c_names(schema)
            if schema.seed == HELLO_SEED:
                self.say(
                    "schema",
                    f"the low half of its fingerprint {schema.fingerprint:#010x} is "
                    "hello's own seed; reword a name",
                )
        if self.problems:
            raise SchemaError("\n".join(self.problems))
        return schema

    def say(self, place: str, problem: str) -> None:
        self.problems.append(f"{SCHEMA.name}: {place}: {problem}")

    def table(self, place: str, value: object) -> dict[str, Any]:
        if isinstance(value, dict):
            return value
        self.say(place, "must be a table")
        return {}

    def keys(
        self, place: str, table: dict[str, Any], needed: set[str], more: str = ""
    ) -> None:
        for key in sorted(needed - table.keys()):
            self.say(place, f"{key} is missing")
        for key in sorted(table.keys() - needed - set(more.split())):
            self.say(place, f"unknown key {key}")

    def number(self, place: str, value: object, low: int, high: int) -> int:
        if isinstance(value, int) and not isinstance(value, bool):
            if low <= value <= high:
                return value
            self.say(place, f"{value} is outside {low}..{high}")
        elif value is not None:
            self.say(place, f"{value!r} is not a whole number")
        return low

    def text(self, place: str, value: object) -> str:
        if value is None or (
            isinstance(value, str) and value and value.isascii() and "|" not in value
        ):
            return value or ""
        self.say(place, f"{value!r} must be ASCII text without '|'")
        return ""

    def name(self, place: str, value: object) -> str:
        if isinstance(value, str) and NAME.fullmatch(value):
            return value
        self.say(place, f"name {value!r} must be lower case letters, digits and '_'")
        return ""

    def groups(self, kind: str, high: int) -> dict[str, dict[str, int]]:
        result: dict[str, dict[str, int]] = {}
        for group, members in self.table(kind, self.raw.get(kind)).items():
            place = f"{kind}.{group}"
            self.name(place, group)
            result[group] = {}
            for name, value in self.table(place, members).items():
                self.name(place, name)
                number = self.number(f"{place}: {name}", value, 0, high)
                if number in result[group].values():
                    self.say(place, f"{name} has the value {number} of another")
                result[group][name] = number
        return result

    def message(
        self,
        index: int,
        table: object,
        enums: dict[str, dict[str, int]],
        flags: dict[str, dict[str, int]],
    ) -> Message:
        raw = self.table(f"message {index}", table)
        name = self.name(f"message {index}", raw.get("name"))
        place = f"message {name or index}"
        self.keys(place, raw, {"name", "id", "direction", "meaning", "fields"})
        direction = raw.get("direction")
        if direction not in {"probe", "host"}:
            self.say(place, f"direction {direction!r} is neither probe nor host")
        tables = raw.get("fields")
        if not isinstance(tables, list) or not tables:
            self.say(place, "fields: there is none")
            tables = []
        return Message(
            name,
            self.number(f"{place}: id", raw.get("id"), 1, 255),
            str(direction),
            self.text(f"{place}: meaning", raw.get("meaning")),
            tuple(self.field(place, table, enums, flags) for table in tables),
        )

    def field(
        self,
        place: str,
        table: object,
        enums: dict[str, dict[str, int]],
        flags: dict[str, dict[str, int]],
    ) -> Field:
        raw = self.table(f"{place}: fields", table)
        name = self.name(f"{place}: fields", raw.get("name"))
        place = f"{place}: field {name}"
        self.keys(
            place,
            raw,
            {"name", "tag", "type", "meaning"},
            "count scale unit null enum flags format",
        )
        tag = self.number(f"{place}: tag", raw.get("tag"), 1, 255)
        kind = raw.get("type")
        if kind not in TYPES:
            self.say(place, f"unknown type {kind!r}, known are {', '.join(TYPES)}")
            kind = "u8"
        count = self.number(f"{place}: count", raw.get("count", 1), 1, CONTENT_MAX)
        limits = TYPES[kind].range
        if limits is None:
            for key in sorted({"scale", "unit", "null", "enum", "flags"} & raw.keys()):
                self.say(place, f"{key} means nothing for {kind}")
            limits = (0, 0)
        null = None
        if "null" in raw:
            null = self.number(f"{place}: null", raw["null"], *limits)
        for key, groups in (("enum", enums), ("flags", flags)):
            if key in raw:
                self.check_group(place, key, raw, limits, count, groups)
        if raw.get("format", "hex") != "hex":
            self.say(place, f"unknown format {raw['format']!r}, known is hex")
        return Field(
            name,
            tag,
            kind,
            self.text(f"{place}: meaning", raw.get("meaning")),
            count,
            self.scale(place, raw.get("scale", 1)),
            self.unit(place, raw.get("unit")),
            null,
            str(raw.get("enum", "")),
            str(raw.get("flags", "")),
            str(raw.get("format", "")),
        )

    def check_group(
        self,
        place: str,
        key: str,
        raw: dict[str, Any],
        limits: tuple[int, int],
        count: int,
        groups: dict[str, dict[str, int]],
    ) -> None:
        group = raw[key]
        if group not in groups:
            self.say(place, f"there is no {key} {group!r}")
            return
        if limits[0] < 0 or count != 1 or raw.keys() & {"scale", "unit", "null"}:
            self.say(place, f"{key} needs one unsigned number, plain")
        if key == "enum" and "flags" in raw:
            self.say(place, "enum and flags exclude each other")
        top = max(groups[group].values(), default=0)
        if (1 << top if key == "flags" else top) > limits[1]:
            self.say(place, f"{key} {group!r} does not fit {raw['type']}")

    def scale(self, place: str, value: object) -> Decimal | str:
        if isinstance(value, str) and BINARY_SCALE.fullmatch(value):
            return value
        if isinstance(value, int | Decimal) and not isinstance(value, bool):
            scale = Decimal(value)
            if scale.is_finite() and scale > 0:
                return scale
        self.say(place, f"scale {value!r} is neither a number above 0 nor 2^-N")
        return Decimal(1)

    def unit(self, place: str, value: object) -> str:
        unit = self.text(f"{place}: unit", value)
        if re.search(r"\s", unit) or unit == "-":
            self.say(place, f"unit {unit!r} must be one word")
        return unit

    def check_together(self, messages: tuple[Message, ...]) -> None:
        for one, other in combinations(messages, 2):
            place = f"message {other.name}"
            if one.name == other.name:
                self.say(place, "its name is taken")
            if (one.id ^ other.id).bit_count() < 2:
                self.say(
                    place,
                    f"id {other.id:#04x} is less than two bits from {one.name}'s "
                    f"{one.id:#04x}",
                )
        owner: dict[int, str] = {}
        for message in messages:
            place = f"message {message.name}"
            previous = 0
            names: set[str] = set()
            for field in message.fields:
                if field.tag in owner:
                    self.say(
                        f"{place}: field {field.name}",
                        f"tag {field.tag} is taken by {owner[field.tag]}",
                    )
                elif field.tag < previous:
                    self.say(f"{place}: field {field.name}", "tags must ascend")
                if field.name in names:
                    self.say(f"{place}: field {field.name}", "its name is taken")
                previous = field.tag
                names.add(field.name)
                owner[field.tag] = f"{message.name}.{field.name}"
            if message.size > CONTENT_MAX:
                self.say(
                    place, f"{message.size} bytes of content, {CONTENT_MAX} at most"
                )
        self.check_hello(messages)

    def check_hello(self, messages: tuple[Message, ...]) -> None:
        hello = next((m for m in messages if m.name == "hello"), None)
        if hello is None:
            self.say("message", "there is no hello")
            return
        start = tuple((f.name, f.tag, f.type) for f in hello.fields)
        if hello.id != HELLO_ID or start[: len(HELLO_START)] != HELLO_START:
            self.say(
                "message hello",
                f"its id {HELLO_ID:#04x} and first fields (protocol_version, "
                "schema_fingerprint) are the same in every version",
            )

    def check_c_names(self, schema: Schema) -> None:
        seen: dict[str, str] = {name: "frame.h or messages.h" for name in C_TAKEN}
        for place, name in c_constants(schema):
            if name in seen:
                self.say(place, f"its C name {name} is taken by {seen[name]}")
            seen[name] = place


def load(path: Path) -> Schema:
    try:
        raw = tomllib.loads(path.read_text("utf-8"), parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise SchemaError(f"{path.name}: {error}") from error
    return Checker(raw).schema()


# C

C_RESULTS = (
    ("MESSAGE_OK", 0, ""),
    ("MESSAGE_MISSING_FIELD", -1, ""),
    ("MESSAGE_DOUBLED_FIELD", -2, ""),
    ("MESSAGE_UNKNOWN_FIELD", -3, "a tag that is not of this message"),
    ("MESSAGE_OUT_OF_ORDER", -4, ""),
    ("MESSAGE_WRONG_LENGTH", -5, "the content ends in its header or in a value"),
    ("MESSAGE_WRONG_ID", -6, ""),
)
C_TAKEN = (
    *(name for name, _, _ in C_RESULTS),
    "MESSAGE_CONTENT_MAX",
    "PROTOCOL_VERSION",
    "SCHEMA_FINGERPRINT",
    "SCHEMA_SEED",
)


def c_constants(schema: Schema) -> Iterator[tuple[str, str]]:
    """Where each constant of messages.h comes from, and its name."""
    for message in schema.messages:
        yield f"message {message.name}", f"MESSAGE_{message.name.upper()}"
        yield f"message {message.name}", c_size(message)
        for field in message.fields:
            if field.null is not None:
                place = f"message {message.name}: field {field.name}"
                yield place, c_null(message, field)
    for kind, groups in (("enums", schema.enums), ("flags", schema.flags)):
        for group, members in groups.items():
            for name in members:
                yield f"{kind}.{group}", f"{group}_{name}".upper()


def c_size(message: Message) -> str:
    return f"MESSAGE_{message.name.upper()}_SIZE"


def c_null(message: Message, field: Field) -> str:
    return f"{message.name}_{field.name}_null".upper()


def c_number(value: int, kind: str) -> str:
    """The value as C writes it, limits by their names from <stdint.h>."""
    limits = TYPES[kind].range or (0, 0)
    signedness, bits = ("INT" if kind[0] == "i" else "UINT"), kind[1:]
    if value == limits[1]:
        return f"{signedness}{bits}_MAX"
    if value == limits[0] and value < 0:
        return f"{signedness}{bits}_MIN"
    return f"{signedness}{bits}_C({value})"


def c_wrap(start: str, items: Iterable[str], end: str) -> list[str]:
    """`start` item, item... `end`, filled to the columns as clang-format does."""
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


def c_comments(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Indented lines of code with their comments in one column, run by run."""
    run: list[tuple[str, str]] = []

    def flush() -> Iterator[str]:
        width = max((len(code) for code, _ in run), default=0)
        for code, comment in run:
            yield f"    {code:<{width}}  // {comment}"
        run.clear()

    for code, comment in rows:
        if comment:
            run.append((code, comment))
        else:
            yield from flush()
            yield f"    {code}"
    yield from flush()


def c_prologue(words: Iterable[str]) -> Iterator[str]:
    yield "// SPDX-License-Identifier: MIT"
    yield from (f"// {line}" for line in words)


def c_declaration(message: Message, end: str) -> tuple[list[str], list[str]]:
    """The two functions of a message; `end` is a semicolon, or opens their bodies."""
    encode = c_wrap(
        f"uint8_t message_{message.name}_encode(",
        [
            f"const struct message_{message.name} *message",
            "uint32_t sequence",
            "uint32_t time_us",
            "uint8_t *content",
        ],
        f"){end}",
    )
    decode = c_wrap(
        f"enum message_result message_{message.name}_decode(",
        [
            "const uint8_t *content",
            "uint8_t length",
            "struct message_header *header",
            f"struct message_{message.name} *out",
        ],
        f"){end}",
    )
    return encode, decode


def c_field(field: Field) -> tuple[str, str]:
    array = f"[{field.count}]" if field.count > 1 else ""
    scale = "" if field.scale == 1 else scale_words(field.scale)
    note = " ".join(word for word in (scale, field.unit) if word)
    if field.enum:
        note = f"enum {field.enum}"
    if field.flags:
        note = f"{field.flags.upper()}_ flags"
    return f"{TYPES[field.type].c} {field.name}{array};", note


def render_c_header(schema: Schema) -> str:
    longest = max(message.size for message in schema.messages)
    lines = [
        *c_prologue(
            [
                "Messages to content bytes and back. Generated from schema.toml by",
                "protocol/generate.py; what each field means is in PROTOCOL.md.",
            ]
        ),
        "#ifndef MESSAGES_H",
        "#define MESSAGES_H",
        "",
        "#include <stdint.h>",
        "",
        f"#define SCHEMA_FINGERPRINT {schema.fingerprint:#010x}u",
        f"#define SCHEMA_SEED {schema.seed:#06x}u  // CRC of all messages but hello",
        "",
        "enum {",
        f"    PROTOCOL_VERSION = {schema.version},",
        f"    MESSAGE_CONTENT_MAX = {longest},  // the longest message",
        "};",
        "",
        "enum message_id {",
        *(f"    MESSAGE_{m.name.upper()} = {m.id:#04x}," for m in schema.messages),
        "};",
        "",
        "// Bytes of content.",
        "enum {",
        *(f"    {c_size(m)} = {m.size}," for m in schema.messages),
        "};",
    ]
    for group, members in schema.enums.items():
        lines += ["", f"enum {group} {{"]
        lines += [f"    {group}_{n}".upper() + f" = {v}," for n, v in members.items()]
        lines += ["};"]
    for group, members in schema.flags.items():
        lines += ["", "enum {"]
        lines += [
            f"    {group}_{n}".upper() + f" = 1u << {v}," for n, v in members.items()
        ]
        lines += ["};"]
    lines += [
        "",
        '// Wire numbers that say "not available", in every value of a field.',
    ]
    lines += [
        f"#define {c_null(m, f)} {c_number(f.null, f.type)}"
        for m in schema.messages
        for f in m.fields
        if f.null is not None
    ]
    lines += ["", "enum message_result {"]
    lines += c_comments((f"{name} = {n},", note) for name, n, note in C_RESULTS)
    lines += [
        "};",
        "",
        "struct message_header {",
        "    uint8_t id;",
        "    uint32_t sequence;",
        "    uint32_t time_us;",
        "};",
        "",
        "// encode() writes to `content` (the message's size) and returns the length.",
        "// decode() leaves `header` and `out` untouched unless MESSAGE_OK.",
    ]
    for message in schema.messages:
        encode, decode = c_declaration(message, ";")
        lines += ["", f"struct message_{message.name} {{"]
        lines += c_comments(map(c_field, message.fields))
        lines += ["};", "", *encode, *decode]
    lines += ["", "#endif"]
    return "".join(f"{line}\n" for line in lines)


C_HELPERS = """\
#include "core/wire/messages.h"

#include <stdbool.h>
#include <string.h>

#include "core/wire/frame.h"

// Values go to the wire as they lie in memory.
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the wire is little endian");
_Static_assert((int)MESSAGE_CONTENT_MAX <= (int)FRAME_CONTENT_MAX, "fits a frame");

enum { HEADER_SIZE = 9 };

// Constants take RAM on the AVR where nothing says that they stay in flash (ISO/IEC TR
// 18037, 5.1: named address spaces).
#ifdef __FLASH
#define FLASH __flash
#else
#define FLASH
#endif

// A message's id, then for each field its tag and its values: how many, of how many
// bytes. 0 ends it.
typedef const FLASH uint8_t layout;
#define FIELD(tag, count, size) tag, (count)*8 + (size)

// A field that a walk over the layout has come to, and where it lies in memory.
struct field {
    uint8_t tag, length, offset;
};

static struct field field_first(layout *at, uint8_t end) {
    const uint8_t size = at[1] % 8;
    const uint8_t unit = size == 4   ? _Alignof(uint32_t)
                         : size == 2 ? _Alignof(uint16_t)
                                     : 1;
    return (struct field){at[0], (uint8_t)(at[1] / 8 * size),
                          (uint8_t)((end + unit - 1) / unit * unit)};
}

static uint8_t encode(layout *at, const void *message, uint32_t sequence,
                      uint32_t time_us, uint8_t *content) {
    uint8_t *to = content + HEADER_SIZE;
    content[0] = *at++;
    memcpy(content + 1, &sequence, sizeof sequence);
    memcpy(content + 5, &time_us, sizeof time_us);
    for (uint8_t end = 0; *at != 0; at += 2) {
        const struct field field = field_first(at, end);
        *to++ = field.tag;
        memcpy(to, (const uint8_t *)message + field.offset, field.length);
        to += field.length;
        end = (uint8_t)(field.offset + field.length);
    }
    return (uint8_t)(to - content);
}

// Names what stands at `at` where the `expected` field does not, or 0 where none is
// left to come.
static enum message_result misplaced(layout *fields, const uint8_t *at, uint8_t left,
                                     uint8_t expected) {
    if (left == 0) {
        return MESSAGE_MISSING_FIELD;
    }
    bool is_ours = false;
    for (; *fields != 0; fields += 2) {
        is_ours |= *fields == *at;
    }
    if (!is_ours) {
        return MESSAGE_UNKNOWN_FIELD;
    }
    if (expected == 0 || *at < expected) {
        return MESSAGE_DOUBLED_FIELD;
    }
    return *at == expected ? MESSAGE_WRONG_LENGTH : MESSAGE_OUT_OF_ORDER;
}

static enum message_result decode(layout *fields, const uint8_t *content,
                                  uint8_t length, uint8_t size,
                                  struct message_header *header, void *out) {
    const uint8_t id = *fields++;
    if (length < HEADER_SIZE) {
        return MESSAGE_WRONG_LENGTH;
    }
    if (content[0] != id) {
        return MESSAGE_WRONG_ID;
    }
    const uint8_t *from = content + HEADER_SIZE;
    uint8_t left = (uint8_t)(length - HEADER_SIZE);
    layout *at = fields;
    for (; *at != 0; at += 2) {
        const struct field field = field_first(at, 0);
        if (left <= field.length || *from != field.tag) {
            break;
        }
        from += 1 + field.length;
        left = (uint8_t)(left - 1 - field.length);
    }
    if (*at != 0 || left > 0) {
        const enum message_result result = misplaced(fields, from, left, *at);
        // A hello may have at its end what later versions add.
        if (id != MESSAGE_HELLO || *at != 0 || result != MESSAGE_UNKNOWN_FIELD) {
            return result == MESSAGE_OUT_OF_ORDER && length < size
                       ? MESSAGE_MISSING_FIELD
                       : result;
        }
    }
    header->id = id;
    memcpy(&header->sequence, content + 1, sizeof header->sequence);
    memcpy(&header->time_us, content + 5, sizeof header->time_us);
    from = content + HEADER_SIZE;
    uint8_t end = 0;
    for (at = fields; *at != 0; at += 2) {
        const struct field field = field_first(at, end);
        memcpy((uint8_t *)out + field.offset, from + 1, field.length);
        from += 1 + field.length;
        end = (uint8_t)(field.offset + field.length);
    }
    return MESSAGE_OK;
}
"""


def scale_words(scale: Decimal | str) -> str:
    """The scale as people, C comments and Python read it: 0.01, 1e-9, 2^-30."""
    if isinstance(scale, str):
        return scale
    plain = f"{scale.normalize():f}"
    return plain if len(plain) <= len("0.001") else scale_text(scale)


def c_functions(message: Message) -> Iterator[str]:
    """A message's layout, its encoder and its decoder."""
    encode, decode = c_declaration(message, " {")
    name = message.name.upper()
    yield ""
    yield f"static layout {name}[] = {{"
    yield f"    MESSAGE_{name},"
    yield from c_comments(
        (
            f"FIELD({field.tag}, {field.count}, {TYPES[field.type].size}),",
            field.name,
        )
        for field in message.fields
    )
    yield "    0,"
    yield "};"
    yield ""
    yield from encode
    yield f"    return encode({name}, message, sequence, time_us, content);"
    yield "}"
    yield ""
    yield from decode
    yield f"    return decode({name}, content, length, {c_size(message)}, header, out);"
    yield "}"


def render_c_source(schema: Schema) -> str:
    lines = [
        *c_prologue(
            [
                "Messages to content bytes and back. Generated from schema.toml by",
                "protocol/generate.py.",
            ]
        ),
        *C_HELPERS.splitlines(),
    ]
    for message in schema.messages:
        lines += c_functions(message)
    return "".join(f"{line}\n" for line in lines)


# Python

PYTHON_START = """\
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

PYTHON_TYPES = """

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
"""


def python_hex(value: int, digits: int) -> str:
    return f"0x{value:0{digits}X}"


def python_class(group: str, suffix: str = "") -> str:
    return "".join(word.capitalize() for word in group.split("_")) + suffix


def python_scale(scale: Decimal | str) -> str:
    words = scale_words(scale)
    return f"2.0**{words[2:]}" if isinstance(scale, str) else words


def python_field(field: Field) -> list[str]:
    parts = [f'"{field.name}"', str(field.tag), f'"{field.type}"']
    if field.count > 1:
        parts.append(str(field.count))
    if field.scale != 1:
        parts.append(f"scale={python_scale(field.scale)}")
    if field.unit:
        parts.append(f'unit="{field.unit}"')
    if field.null is not None:
        parts.append(f"null={field.null}")
    if field.enum:
        parts.append(f"enum={python_class(field.enum)}")
    if field.flags:
        parts.append(f"flags={python_class(field.flags, 'Flags')}")
    if field.format:
        parts.append(f'format="{field.format}"')
    indent = " " * 12
    line = f"{indent}Field({', '.join(parts)}),"
    if len(line) <= COLUMNS:
        return [line]
    return [f"{indent}Field(", f"{indent}    {', '.join(parts)}", f"{indent}),"]


def render_python(schema: Schema) -> str:
    lines = PYTHON_START.format(
        version=schema.version,
        fingerprint=python_hex(schema.fingerprint, 8),
        seed=python_hex(schema.seed, 4),
        hello_seed=python_hex(HELLO_SEED, 4),
    ).splitlines()
    for group, members in schema.enums.items():
        lines += ["", "", f"class {python_class(group)}(IntEnum):"]
        lines += [f"    {name.upper()} = {value}" for name, value in members.items()]
    for group, members in schema.flags.items():
        lines += ["", "", f"class {python_class(group, 'Flags')}(IntFlag):"]
        lines += [f"    {name.upper()} = 1 << {bit}" for name, bit in members.items()]
    lines += PYTHON_TYPES.splitlines()
    lines += ["", "", "MESSAGES = ("]
    for message in schema.messages:
        lines += [
            "    MessageType(",
            f'        "{message.name}",',
            f"        {python_hex(message.id, 2)},",
            f'        "{message.direction}",',
            "        (",
        ]
        for field in message.fields:
            lines += python_field(field)
        lines += ["        ),", "    ),"]
    lines += [")"]
    return "".join(f"{line}\n" for line in lines)


# Tables

BEGIN, END = "<!-- begin generated: {} -->", "<!-- end generated -->"


def table(head: str, rows: Iterable[Iterable[str]]) -> list[str]:
    columns = head.count("|") - 1
    lines = [head, "|---" * columns + "|"]
    return lines + [f"| {' | '.join(row)} |" for row in rows]


def document_constants(schema: Schema) -> list[str]:
    return table(
        "| constant | value |",
        [
            ["protocol version", str(schema.version)],
            ["fingerprint of the schema", f"`{schema.fingerprint:#010x}`"],
            ["CRC seed of all messages but hello", f"`{schema.seed:#06x}`"],
            ["CRC seed of hello", f"`{HELLO_SEED:#06x}`"],
        ],
    )


def document_messages(schema: Schema) -> list[str]:
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
            scale = "" if field.scale == 1 else scale_words(field.scale)
            values = f"`{field.type}`"
            if field.count > 1:
                values += f" x {field.count}"
            unit = " ".join(word for word in (scale, field.unit) if word)
            if field.enum:
                unit = f"enum {field.enum}"
            if field.flags:
                unit = f"flags {field.flags}"
            null = "" if field.null is None else str(field.null)
            rows.append(
                [
                    str(offset),
                    str(field.tag),
                    f"`{field.name}`",
                    values,
                    unit,
                    null,
                    field.meaning,
                ]
            )
            offset += 1 + field.size
        lines += table("| at | tag | field | values | unit | null | meaning |", rows)
    return lines[1:]


def document_groups(schema: Schema) -> list[str]:
    rows = [
        [f"enum {group}", ", ".join(f"{v} `{n}`" for n, v in members.items())]
        for group, members in schema.enums.items()
    ]
    rows += [
        [f"flags {group}", ", ".join(f"bit {v} `{n}`" for n, v in members.items())]
        for group, members in schema.flags.items()
    ]
    return table("| group | members |", rows)


def render_document(schema: Schema, text: str) -> str:
    for name, lines in (
        ("constants", document_constants(schema)),
        ("messages", document_messages(schema)),
        ("groups", document_groups(schema)),
    ):
        begin = BEGIN.format(name)
        if text.count(begin) != 1 or END not in text.split(begin)[1]:
            raise SchemaError(
                f"{DOCUMENT}: needs one line {begin!r}, and {END!r} after it"
            )
        before, rest = text.split(begin)
        after = rest.split(END, 1)[1]
        text = "\n".join([before + begin, *lines, END + after])
    return text


def outputs(schema: Schema) -> dict[Path, str]:
    document = (ROOT / DOCUMENT).read_text("utf-8")
    return {
        C_HEADER: render_c_header(schema),
        C_SOURCE: render_c_source(schema),
        PYTHON: render_python(schema),
        DOCUMENT: render_document(schema, document),
    }


def stale(path: Path, text: str) -> list[str]:
    """Nothing when the file holds the text, else what to say about it."""
    file = ROOT / path
    found = file.read_text("utf-8") if file.exists() else ""
    if found == text:
        return []
    diff = difflib.unified_diff(
        found.splitlines(),
        text.splitlines(),
        str(path),
        f"{path} generated",
        lineterm="",
    )
    return [
        f"{path} is stale; run python protocol/generate.py",
        *list(diff)[:DIFF_LINES],
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="Makes C, Python and tables from protocol/schema.toml."
    )
    parser.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if a file is stale"
    )
    parser.add_argument(
        "--canonical", action="store_true", help="print what the fingerprint is of"
    )
    asked = parser.parse_args(arguments)
    try:
        schema = load(SCHEMA)
        if asked.canonical:
            sys.stdout.write(schema.canonical)
            return 0
        files = outputs(schema)
    except (SchemaError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    reports = {path: stale(path, text) for path, text in files.items()}
    if asked.check:
        lines = [line for report in reports.values() for line in report]
        sys.stdout.write("".join(f"{line}\n" for line in lines))
        return 1 if lines else 0
    for path, report in reports.items():
        if report:  # an untouched file makes nobody rebuild
            (ROOT / path).write_text(files[path], "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
