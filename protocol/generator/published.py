# SPDX-License-Identifier: MIT
"""What is published: host/imud/published.py, the page's published.js and the tables of
docs/pose.md, from published.toml and the schema.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from generator.schema import Field, Schema, SchemaError
from generator.tables import filled, table

PYTHON_START = '''\
# SPDX-License-Identifier: MIT
"""What the daemon publishes, as types: docs/pose.md. None: not known.

Generated from published.toml by protocol/generate.py.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
'''

SCRIPT_START = """\
// SPDX-License-Identifier: MIT
// @ts-check
// What the daemon publishes, as types: docs/pose.md. null: not known.
// Generated from published.toml by protocol/generate.py.

/** @typedef {[number, number, number]} Vector */
/** @typedef {[number, number, number, number]} Quaternion */
"""

# Each type in Python and in JavaScript.
TYPES = {
    "text": ("str", "string"),
    "count": ("int", "number"),
    "number": ("float", "number"),
    "boolean": ("bool", "boolean"),
    "vector": ("Vector", "Vector"),
    "quaternion": ("Quaternion", "Quaternion"),
    "counts": ("tuple[int, int, int]", "Vector"),
    "texts": ("tuple[str, ...]", "string[]"),
    "places": ("tuple[Vector, ...]", "Vector[]"),
    "object": ("dict[str, Any]", "object"),
}
OPTIONS = "frozen=True, kw_only=True"
NOTE = "  # noqa: N815 - the unit's own spelling"
SCRIPTED = ("SinceOrigin", "PoseFields", "Aim")  # what the page has types for
UNITS = {"degC": "c"}  # in a name, where that is not the unit itself


@dataclass(frozen=True, slots=True)
class Row:
    """A field that is published."""

    name: str
    type: str  # as in published.toml, without its "?"
    may_be_null: bool
    may_be_absent: bool
    meaning: str
    wire: str  # "": the daemon's own

    def code(self, language: int) -> str:
        """Its type in Python (0) or JavaScript (1)."""
        words = TYPES.get(self.type, (self.type, self.type))[language]
        if "|" in self.type:
            words = " | ".join(f'"{word}"' for word in self.type.split("|"))
            if language == 0:
                words = f"Literal[{words.replace(' |', ',')}]"
        null = (" | None", " | null")[language]
        return words + null if self.may_be_null else words


@dataclass(frozen=True, slots=True)
class Struct:
    name: str
    topic: str
    base: str
    meaning: str
    rows: tuple[Row, ...]


def load(path: Path, schema: Schema) -> list[Struct]:
    """The structs of published.toml. SchemaError where they leave out a field of a
    message.
    """
    raw = tomllib.loads(path.read_text("utf-8"))
    structs = []
    for each in raw["struct"]:
        of = each.get("message")
        fields = {f.name: f for m in schema.messages if m.name == of for f in m.fields}
        rows = tuple(_row(row, fields) for row in each.get("fields", ()))
        if left_out := fields.keys() - {row.wire for row in rows}:
            raise SchemaError(
                f"{path.name}: {each['name']}: needs a row for {sorted(left_out)}"
            )
        topic, base = each.get("topic", ""), each.get("base", "")
        structs.append(Struct(each["name"], topic, base, each["meaning"], rows))
    return structs


def _row(raw: dict[str, Any], fields: dict[str, Field]) -> Row:
    wire = raw.get("wire", "")
    name, kind = raw.get("name", ""), raw.get("type", "")
    if wire:
        if wire not in fields:
            raise SchemaError(f"published.toml: no field {wire!r} in the schema")
        name, of_wire = _of_wire(fields[wire])
        kind = kind or of_wire
    is_absent = raw.get("absent", False)
    plain = kind.removesuffix("?")
    return Row(name, plain, kind != plain, is_absent, raw.get("meaning", ""), wire)


def _of_wire(field: Field) -> tuple[str, str]:
    """Name and type of a field of the schema, as they are published."""
    if field.flags:
        return "flags", "texts"
    if field.enum:
        return field.name, "text"
    kinds = {1: "number", 3: "vector", 4: "quaternion"}
    if field.scale == 1:
        kinds |= {1: "count", 3: "counts"}
    kind = kinds.get(field.count, "")
    unit = UNITS.get(field.unit, field.unit.replace("/", "_"))
    null = "" if field.null is None else "?"
    return f"{field.name}_{unit}" if unit else field.name, kind + null


def python(structs: list[Struct]) -> str:
    """The text of host/imud/published.py."""
    lines = PYTHON_START.splitlines()
    for struct in structs:
        base = struct.base or "msgspec.Struct"
        # Only the errors of a pose are made by position.
        options = "frozen=True" if struct.name == "SinceOrigin" else OPTIONS
        lines += ["", "", f"class {struct.name}({base}, {options}):"]
        lines += [f'    """{struct.meaning}"""', ""]
        for row in struct.rows:
            default = " = None" if row.may_be_absent else ""
            note = NOTE if row.name.endswith("uT") else ""
            lines.append(f"    {row.name}: {row.code(0)}{default}{note}")
        if not struct.rows:
            lines.pop()
    lines += ["", "", "TOPICS: dict[str, type[msgspec.Struct]] = {"]
    lines += [f'    "{s.topic}": {s.name},' for s in structs if s.topic]
    lines += ["}", "", "# The numbers of a pose.", "POSE_NUMBERS = ("]
    lines += [f'    "{number}",' for number in _numbers(structs)]
    lines += [")", "", "# Fields of messages, by the names that they are published by."]
    lines.append("WIRE = {")
    for struct in structs:
        if wired := [row for row in struct.rows if row.wire]:
            lines.append(f'    "{struct.topic}": {{')
            lines += [f'        "{row.name}": "{row.wire}",' for row in wired]
            lines.append("    },")
    return "".join(f"{line}\n" for line in [*lines, "}"])


def script(structs: list[Struct]) -> str:
    """The text of the page's published.js."""
    by_name = {struct.name: struct for struct in structs}
    lines = SCRIPT_START.splitlines()
    for name in SCRIPTED:
        struct = by_name[name]
        lines += ["", "/**", f" * @typedef {{object}} {name} {struct.meaning}"]
        for row in _all_rows(struct, by_name):
            lines.append(f" * @property {{{row.code(1)}}} {row.name}")
        lines.append(" */")
    lines += ["", "// The numbers of a pose.", "export const POSE_NUMBERS = ["]
    lines += [f'  "{number}",' for number in _numbers(structs)]
    return "".join(f"{line}\n" for line in [*lines, "];"])


def _numbers(structs: list[Struct]) -> list[str]:
    poses = next(struct for struct in structs if struct.name == "PoseFields")
    return [row.name for row in poses.rows if row.type == "number"]


def document(structs: list[Struct], text: str) -> str:
    """The text of docs/pose.md with its tables replaced."""
    by_name = {struct.name: struct for struct in structs}
    for struct in structs:
        if struct.topic and any(row.meaning for row in struct.rows):
            # What all messages begin with is in the table of a pose.
            is_first = struct.name == "PoseFields"
            rows = [*_all_rows(struct, by_name)] if is_first else [*struct.rows]
            lines = table("| key | meaning |", _grouped(rows))
            text = filled("docs/pose.md", text, struct.topic, lines)
    return text


def _all_rows(struct: Struct, by_name: dict[str, Struct]) -> Iterator[Row]:
    if struct.base:
        yield from by_name[struct.base].rows
    yield from struct.rows


def _grouped(rows: list[Row]) -> list[list[str]]:
    """The cells of a table: rows without a meaning stand beside the one before."""
    cells: list[list[str]] = []
    for row in rows:
        if row.meaning:
            cells.append([f"`{row.name}`", row.meaning])
        elif cells:
            cells[-1][0] += f", `{row.name}`"
    return cells
