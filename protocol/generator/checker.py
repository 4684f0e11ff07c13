# SPDX-License-Identifier: MIT
"""Reads and checks schema.toml; reports each problem on a line."""

from __future__ import annotations

import re
import tomllib
from decimal import Decimal
from itertools import combinations
from pathlib import Path
from typing import Any

from generator import c_code
from generator.schema import (
    CONTENT_MAX,
    HELLO_SEED,
    RECORD_MAX,
    TYPES,
    Field,
    Message,
    Record,
    Schema,
    SchemaError,
)

NAME = re.compile(r"[a-z][a-z0-9_]*")
BINARY_SCALE = re.compile(r"2\^-[1-9][0-9]?")

# What every version must find in a hello, whatever its schema.
HELLO_ID = 0x03
HELLO_START = (("protocol_version", 1, "u8"), ("schema_fingerprint", 2, "u32"))


def load(path: Path) -> Schema:
    """Read the schema from a TOML file; raises SchemaError with all its problems."""
    try:
        raw = tomllib.loads(path.read_text("utf-8"), parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise SchemaError(f"{path.name}: {error}") from error
    return Checker(raw, path.name).schema()


class Checker:
    """Turns the tables of the schema into a Schema and collects what is wrong."""

    def __init__(self, raw: dict[str, Any], file: str) -> None:
        self.raw = raw
        self.file = file
        self.problems: list[str] = []
        self.enums = self.groups("enums", 255)
        self.flags = self.groups("flags", 31)

    def schema(self) -> Schema:
        """The whole schema; raises SchemaError with one line for each problem."""
        self.keys(
            "schema", self.raw, {"protocol", "enums", "flags", "message"}, "record"
        )
        protocol = self.table("protocol", self.raw.get("protocol"))
        self.keys("protocol", protocol, {"version"})
        version = self.number("protocol: version", protocol.get("version"), 1, 255)
        tables = self.tables("message", self.raw.get("message"))
        messages = tuple(self.message(i, table) for i, table in enumerate(tables))
        self.check_ids(messages)
        self.check_fields(messages)
        self.check_hello(messages)
        tables = (
            self.tables("record", self.raw["record"]) if "record" in self.raw else []
        )
        records = tuple(self.record(i, table) for i, table in enumerate(tables))
        self.check_records(records)
        schema = Schema(version, self.enums, self.flags, messages, records)
        if not self.problems:
            for place, problem in c_code.clashes(schema):
                self.say(place, problem)
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
        self.problems.append(f"{self.file}: {place}: {problem}")

    # Values. Each method returns something usable even where it reports a problem.

    def table(self, place: str, value: object) -> dict[str, Any]:
        if isinstance(value, dict):
            return value
        self.say(place, "must be a table")
        return {}

    def tables(self, place: str, value: object) -> list[object]:
        if isinstance(value, list) and value:
            return value
        self.say(place, "there is none")
        return []

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

    # Groups, messages, fields.

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

    def message(self, index: int, table: object) -> Message:
        raw = self.table(f"message {index}", table)
        name = self.name(f"message {index}", raw.get("name"))
        place = f"message {name or index}"
        self.keys(place, raw, {"name", "id", "direction", "meaning", "fields"})
        direction = raw.get("direction")
        if direction not in {"probe", "host"}:
            self.say(place, f"direction {direction!r} is neither probe nor host")
        tables = self.tables(f"{place}: fields", raw.get("fields"))
        return Message(
            name,
            self.number(f"{place}: id", raw.get("id"), 1, 255),
            str(direction),
            self.text(f"{place}: meaning", raw.get("meaning")),
            tuple(self.field(place, table) for table in tables),
        )

    def record(self, index: int, table: object) -> Record:
        raw = self.table(f"record {index}", table)
        name = self.name(f"record {index}", raw.get("name"))
        place = f"record {name or index}"
        self.keys(place, raw, {"name", "tag", "meaning", "parts"})
        tables = self.tables(f"{place}: parts", raw.get("parts"))
        return Record(
            name,
            # 255 is what an erased byte of memory reads as.
            self.number(f"{place}: tag", raw.get("tag"), 1, 254),
            self.text(f"{place}: meaning", raw.get("meaning")),
            tuple(self.field(place, table, "part") for table in tables),
        )

    def field(self, place: str, table: object, kind_of: str = "field") -> Field:
        """A field of a message; a part of a record is one without a tag."""
        raw = self.table(f"{place}: {kind_of}s", table)
        name = self.name(f"{place}: {kind_of}s", raw.get("name"))
        place = f"{place}: {kind_of} {name}"
        needed = {"name", "type", "meaning"}
        tag = 0
        if kind_of == "field":
            needed.add("tag")
            tag = self.number(f"{place}: tag", raw.get("tag"), 1, 255)
        self.keys(place, raw, needed, "count scale unit null enum flags format")
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
        for key, groups in (("enum", self.enums), ("flags", self.flags)):
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

    # All messages together.

    def check_ids(self, messages: tuple[Message, ...]) -> None:
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

    def check_fields(self, messages: tuple[Message, ...]) -> None:
        owner: dict[int, str] = {}
        for message in messages:
            previous = 0
            names: set[str] = set()
            for field in message.fields:
                place = f"message {message.name}: field {field.name}"
                if field.tag in owner:
                    self.say(place, f"tag {field.tag} is taken by {owner[field.tag]}")
                elif field.tag < previous:
                    self.say(place, "tags must ascend")
                if field.name in names:
                    self.say(place, "its name is taken")
                previous = field.tag
                names.add(field.name)
                owner[field.tag] = f"{message.name}.{field.name}"
            if message.size > CONTENT_MAX:
                self.say(
                    f"message {message.name}",
                    f"{message.size} bytes of content, {CONTENT_MAX} at most",
                )

    def check_records(self, records: tuple[Record, ...]) -> None:
        for one, other in combinations(records, 2):
            for what in ("name", "tag"):
                if getattr(one, what) == getattr(other, what):
                    self.say(f"record {other.name}", f"its {what} is taken")
        for record in records:
            names = [part.name for part in record.parts]
            for name in sorted({name for name in names if names.count(name) > 1}):
                self.say(f"record {record.name}: part {name}", "its name is taken")
            if record.size > RECORD_MAX:
                self.say(
                    f"record {record.name}",
                    f"{record.size} bytes, {RECORD_MAX} at most",
                )

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
