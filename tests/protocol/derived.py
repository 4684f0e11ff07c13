# SPDX-License-Identifier: MIT
"""What follows from the vector of a message: its extremes, what a host refuses of it,
and content that is not the message. Of schema.toml, without the code under test.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

Vector = dict[str, Any]
Field = dict[str, Any]

CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
UNIT_VECTORS = ("q", "normal")  # a host refuses another length
STRANGE = bytes([0xC8, 0x01])  # a field that no message has


def good(vectors: list[Vector], schema: dict[str, Any]) -> Iterator[Vector]:
    """Contents that the probe takes. `impossible`: a host refuses the values; `grown`:
    of a later version, with bytes after those that this one knows.
    """
    fields = {message["name"]: message["fields"] for message in schema["message"]}
    groups = {"enum": schema["enums"], "flags": schema["flags"]}
    for vector in vectors:
        own = fields[vector["message"]]
        typical = vector["fields"]
        highest = {f["name"]: _bound(f, groups, typical, -1) for f in own}
        yield _made(vector, "highest", own, highest)
        lowest = {f["name"]: _bound(f, groups, typical, 0) for f in own}
        yield _made(vector, "lowest", own, lowest)
        nulls = {f["name"]: _alike(f, f["null"]) for f in own if "null" in f}
        if nulls:
            yield _made(vector, "without what may be null", own, typical | nulls)
        for name, value in _impossible(own, groups, typical):
            changed = typical | {name: value}
            words = f"with an impossible {name}"
            yield _made(vector, words, own, changed) | {"impossible": True}
        if vector["message"] == "hello":
            # Of another schema, which a host does not judge.
            later = typical | {"protocol_version": 2, "schema_fingerprint": 0x99887766}
            made = _made(vector, "of a later version", own, later)
            yield made | {"content": f"{made['content']}c801020304", "grown": True}


def _alike(field: Field, number: int) -> Any:
    count = field.get("count", 1)
    return number if count == 1 else [number] * count


def range_of(kind: str) -> tuple[int, int]:
    """The least and the greatest number of a type."""
    bits = 8 * struct.calcsize(CODES[kind])
    is_signed = kind.startswith("i")
    return (
        (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)
    )


def _bound(field: Field, groups: Any, typical: Vector, end: int) -> Any:
    """The least (0) or the greatest (-1) value that a host takes."""
    count = field.get("count", 1)
    if field["type"] == "text":
        return ("", "~" * count)[end]
    if field["type"] == "bytes":
        return ("00" * count, "ff" * count)[end]
    if field["name"] in UNIT_VECTORS:
        return typical[field["name"]]
    if "enum" in field:
        return sorted(groups["enum"][field["enum"]].values())[end]
    if "flags" in field:
        return (0, _all_flags(field, groups))[end]
    number = range_of(field["type"])[end]
    if number == field.get("null"):
        number += (1, -1)[end]
    return _alike(field, number)


def _all_flags(field: Field, groups: Any) -> int:
    return sum(1 << bit for bit in groups["flags"][field["flags"]].values())


def _impossible(
    fields: list[Field], groups: Any, typical: Vector
) -> Iterator[tuple[str, Any]]:
    """Values that fit their field and that the schema excludes."""
    for field in fields:
        name = field["name"]
        highest = range_of(field["type"])[1] if field["type"] in CODES else 0
        if name in UNIT_VECTORS:
            yield name, _alike(field, highest)
        if "enum" in field or (
            "flags" in field and _all_flags(field, groups) < highest
        ):
            yield name, highest
        if "null" in field and field.get("count", 1) > 1:
            yield name, [field["null"], *(v + 1 for v in typical[name][1:])]


def _made(vector: Vector, what: str, fields: list[Field], values: Vector) -> Vector:
    """Like a vector, with other values."""
    message_id = bytes.fromhex(vector["content"])[:1]
    header = {key: vector[key] for key in ("sequence", "time_us")}
    if what == "highest":
        header = dict.fromkeys(header, 2**32 - 1)
    content = message_id + struct.pack("<2I", *header.values())
    for field in fields:
        value, kind = values[field["name"]], field["type"]
        if kind == "text":
            value = value.encode("ascii").ljust(field["count"], b"\0")
        elif kind == "bytes":
            value = bytes.fromhex(value)
        else:
            numbers = value if isinstance(value, list) else [value]
            value = struct.pack(f"<{len(numbers)}{CODES[kind]}", *numbers)
        content += bytes([field["tag"]]) + value
    made = header | {"message": vector["message"], "name": f"{vector['name']}, {what}"}
    return made | {"content": content.hex(), "fields": values}


def skewed(vectors: list[Vector]) -> Iterator[Vector]:
    """Contents that are not the message, with the decoder's `result`."""
    for vector in vectors:
        head, *fields = map(bytes.fromhex, vector["content"].splitlines())
        for what, result, content in _damaged(head, fields, vector["message"]):
            name = f"{vector['name']} {what}"
            common = {"name": name, "message": vector["message"], "result": result}
            yield common | {"content": content.hex()}


def _damaged(
    head: bytes, fields: list[bytes], message: str
) -> Iterator[tuple[str, str, bytes]]:
    middle = len(fields) // 2
    before, one, after = fields[:middle], fields[middle], fields[middle + 1 :]
    whole = b"".join([head, *fields])
    other = bytes([40, 1]) if message != "event" else bytes([50, 1])
    parts = {
        ("without its first field", "missing"): fields[1:],
        ("without a field in its middle", "missing"): before + after,
        ("without its last field", "missing"): fields[:-1],
        ("without any field", "missing"): [],
        ("without one, a strange byte behind", "missing"): [
            *before,
            *after,
            b"\xc8",
        ],
        ("with a field twice in a row", "doubled"): [*before, one, one, *after],
        ("with its first again at its end", "doubled"): [*fields, fields[0]],
        ("with its last field twice", "doubled"): [*fields, fields[-1]],
        ("with one twice, another missing", "doubled"): [*before, before[-1], *after],
        ("with a field of another", "unknown"): [*before, other, one, *after],
        ("with an unknown field", "unknown"): [*before, STRANGE, one, *after],
        ("with two exchanged", "out_of_order"): [*before[:-1], one, before[-1], *after],
        ("with its last first", "out_of_order"): [fields[-1], *fields[:-1]],
    }
    if message != "hello":  # which may grow at its end
        parts["with a field of another at its end", "unknown"] = [*fields, other]
        parts["with a tag of zero at its end", "unknown"] = [*fields, b"\0"]
    for (what, result), those in parts.items():
        yield what, result, b"".join([head, *those])
    yield "cut in a value", "wrong_length", whole[:-1]
    yield "cut behind a tag", "wrong_length", whole[: 1 - len(fields[-1])]
    yield "cut in its header", "wrong_length", head[:-1]
    yield "of its id alone", "wrong_length", head[:1]
    yield "with an id that no schema knows", "wrong_id", b"\x18" + whole[1:]
