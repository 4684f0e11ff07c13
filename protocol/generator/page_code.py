# SPDX-License-Identifier: MIT
"""The page's usb/wire.js: the wire as data for a page that reads a probe by itself, and
the commands, words and limits that the daemon has for what it reads.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from generator.published import Struct
from generator.schema import HELLO_SEED, Field, Schema
from imud.check import limits
from imud.commands import COMMANDS, ProbeCommand
from imud.probes import withheld

IMUD = Path(__file__).resolve().parents[2] / "host" / "imud"

START = """\
// SPDX-License-Identifier: MIT
// @ts-check
// The wire as data, and the daemon's words and limits for what it reads there.
// Generated from schema.toml by protocol/generate.py.

/**
 * @typedef {object} Field a wire number by `divide`, or times `times`, is in its unit
 * @property {string} name
 * @property {number} tag
 * @property {string} type
 * @property {number} count
 * @property {number} [divide]
 * @property {number} [times]
 * @property {number} [null] in all values: not available
 * @property {Record<string, string>} [names] of an enum
 * @property {[number, string][]} [bits] of flags
 */
/** @typedef {{ name: string, fields: Field[] }} Kind */
/**
 * @typedef {object} Argument
 * @property {string} name
 * @property {string} type
 * @property {Record<string, number>} choices
 * @property {boolean} isOptional
 */
/** @typedef {{ number: number, usage: string, arguments: Argument[] }} Command */
"""


def module(schema: Schema, structs: Iterable[Struct]) -> str:
    """The text of the page's usb/wire.js."""
    words: dict[str, object] = {
        "STROKE_ADVICE": _constant("probes/record.py", "STROKE_ADVICE"),
        "WITHHELD": {"tilt": withheld.OF_TILT, "heading": withheld.OF_HEADING},
        "NO_ERRORS": withheld.NO_ERRORS,
        "PASSING": sorted(withheld.PASSING),
        "SUPPLY_MV": limits.SUPPLY_MV,
        "WARM_DEGC": limits.WARM_DEGC,
        "SPECIFIED_DEGC": limits.SPECIFIED_DEGC,
    }
    messages = [(each.id, each.name, each.fields) for each in schema.messages]
    records = [(each.tag, each.name, each.parts) for each in schema.records]
    lines = [
        START,
        f"export const FINGERPRINT = {schema.fingerprint};",
        f"export const SEED = {schema.seed};",
        f"export const HELLO_SEED = {HELLO_SEED};",
        "",
        "/** @type {Record<number, Kind>} */",
        *_kinds("MESSAGES", messages, schema),
        "",
        "/** @type {Record<number, Kind>} */",
        *_kinds("RECORDS", records, schema),
        "",
        "/** Fields of messages, by the names that they are published by. */",
        "/** @type {Record<string, Record<string, string>>} */",
        "export const PUBLISHED = {",
        *(
            f"  {struct.topic}: {_js({row.name: row.wire for row in wired})},"
            for struct in structs
            if (wired := [row for row in struct.rows if row.wire])
        ),
        "};",
        "",
        "/** Commands that a probe carries out by itself. */",
        "/** @type {Record<string, Command>} */",
        "export const COMMANDS = {",
        *(
            f"  {name}: {_js(_command(COMMANDS[name], number))},"
            for name, number in schema.enums["command"].items()
            if name in COMMANDS and not COMMANDS[name].by_daemon
        ),
        "};",
        "",
        *(f"export const {name} = {_js(value)};" for name, value in words.items()),
    ]
    return "".join(f"{line}\n" for line in lines)


def _kinds(
    name: str, rows: Iterable[tuple[int, str, Iterable[Field]]], schema: Schema
) -> Iterable[str]:
    yield f"export const {name} = {{"
    for key, called, fields in rows:
        yield f'  {key}: {{ name: "{called}", fields: ['
        yield from (f"    {_js(_field(field, schema))}," for field in fields)
        yield "  ] },"
    yield "};"


def _field(field: Field, schema: Schema) -> dict[str, Any]:
    found: dict[str, Any] = {"name": field.name, "tag": field.tag}
    found |= {"type": field.type, "count": field.count}
    if field.scale != 1:
        # As wire/fields.py: the double nearest to the decimal.
        of = field.scale
        scale = 2.0 ** int(of[2:]) if isinstance(of, str) else float(of)
        inverse = round(1 / scale)
        is_inverse = abs(inverse * scale - 1.0) < 1e-12
        found |= {"divide": inverse} if is_inverse else {"times": scale}
    if field.null is not None:
        found["null"] = field.null
    if field.enum:
        names = schema.enums[field.enum]
        found["names"] = {str(value): name for name, value in names.items()}
    if field.flags:
        bits = schema.flags[field.flags]
        found["bits"] = [[1 << bit, name] for name, bit in bits.items()]
    return found


def _command(command: ProbeCommand, number: int) -> dict[str, Any]:
    arguments = [
        {
            "name": each.name,
            "type": each.type,
            "choices": dict(each.choices),
            "isOptional": each.is_optional,
        }
        for each in command.arguments
    ]
    return {"number": number, "usage": command.usage, "arguments": arguments}


def _constant(file: str, name: str) -> Mapping[str, str]:
    """A literal of a module that can't be imported before the C is built."""
    for node in ast.parse((IMUD / file).read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == name:
            found: Mapping[str, str] = ast.literal_eval(node.value)
            return found
    raise LookupError(f"{file} has no {name}")


def _js(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)
