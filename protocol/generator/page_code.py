# SPDX-License-Identifier: MIT
"""The page's usb/wire.js: the wire as data for a page that reads a probe by itself, and
the commands, words and limits that the daemon has for what it reads.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from generator.published import Struct
from generator.schema import HELLO_SEED, Field, Schema
from imud.check import limits
from imud.commands import COMMANDS, ProbeCommand
from imud.probes import withheld

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
# Of tables whose keys TypeScript should not take for all that there are.
TYPES = {
    "MESSAGES": "Record<string, Kind>",
    "RECORDS": "Record<string, Kind>",
    "PUBLISHED": "Record<string, Record<string, string>>",
    "COMMANDS": "Record<string, Command>",
    "STROKE_ADVICE": "Record<string, string>",
    "SUPPLY_MV": "Record<string, number[]>",
}


def module(schema: Schema, structs: Iterable[Struct]) -> str:
    """The text of the page's usb/wire.js."""
    wired = {s.topic: {r.name: r.wire for r in s.rows if r.wire} for s in structs}
    messages = {m.id: _kind(m.name, m.fields, schema) for m in schema.messages}
    tables: dict[str, object] = {
        "FINGERPRINT": schema.fingerprint,
        "SEED": schema.seed,
        "HELLO_SEED": HELLO_SEED,
        "MESSAGES": messages,
        "RECORDS": {r.tag: _kind(r.name, r.parts, schema) for r in schema.records},
        "PUBLISHED": {topic: names for topic, names in wired.items() if names},
        "COMMANDS": {
            name: _command(COMMANDS[name], number)
            for name, number in schema.enums["command"].items()
            if name in COMMANDS and not COMMANDS[name].by_daemon
        },
        "STROKE_ADVICE": withheld.STROKE_ADVICE,
        "WITHHELD": {"tilt": withheld.OF_TILT, "heading": withheld.OF_HEADING},
        "NO_ERRORS": withheld.NO_ERRORS,
        "PASSING": sorted(withheld.PASSING),
        "SUPPLY_MV": limits.SUPPLY_MV,
        "WARM_DEGC": limits.WARM_DEGC,
        "SPECIFIED_DEGC": limits.SPECIFIED_DEGC,
    }
    return START + "".join(_table(name, value) for name, value in tables.items())


def _table(name: str, value: object) -> str:
    """A constant; an object with a line for each of its keys."""
    kind = f"/** @type {{{TYPES[name]}}} */\n" if name in TYPES else ""
    text = json.dumps(value)
    if isinstance(value, dict):
        rows = (f'  "{key}": {json.dumps(each)},\n' for key, each in value.items())
        text = f"{{\n{''.join(rows)}}}"
    return f"\n{kind}export const {name} = {text};\n"


def _kind(name: str, fields: Iterable[Field], schema: Schema) -> dict[str, Any]:
    return {"name": name, "fields": [_field(field, schema) for field in fields]}


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
