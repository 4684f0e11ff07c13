# SPDX-License-Identifier: MIT
"""Params as a file that people read and write: TOML, a table for each record.

Nothing is lost: records and parts that this imud does not know are there in hex, and
each decimal is read as the number on the wire that it was written from.
"""

from __future__ import annotations

import datetime
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from imud.errors import FileError, ParamsError
from imud.params.parts import KINDS, NAMES, Kind, Part
from imud.params.value import Params, ParamsRecord

# Longer files are none of ours: 248 bytes of records are about 3 kB of text.
SIZE_MAX = 100_000
SHOWN_MAX = 60  # characters of a value that a message repeats

HEAD = (
    "# Params of an imu-probe: what turns its raw readings into poses (docs/params.md)."
)
ABOUT = {
    "acc": "Accelerometer: force = matrix * (counts - bias) * the value of a count",
    "gyr": "Gyroscope: rate = matrix * (counts - bias) * the value of a count",
    "mag": "Magnetometer: field = matrix * (counts - bias) * the value of a count",
    "tip": "Tip: its offset from the sensor and the probe's axis, in the body frame",
    "options": "How the probe behaves",
    "name": "What the probe is called",
    "noise": "White noise of an axis when it was calibrated, in the root of a Hz",
    "unknown": "Records of other firmware by their tags, kept as they are",
}
# Beside its own keys a table may have these, where a record is of other firmware.
PARTS = "parts"  # how many of the parts it has
TAIL = "tail"  # the bytes behind them

_DIGEST = re.compile(r"[0-9a-f]{8}")
_ID = re.compile(r"[0-9a-f]{16}")
_HEX = re.compile(r"([0-9a-f]{2})*")


class ParamsFile(msgspec.Struct, frozen=True):
    """The content of a file: the params, and for which probe they are, if given."""

    params: Params
    probe_id: str | None = None


def written(params: Params, probe_id: str | None = None) -> str:
    """The text of a file. Reading it gives the same bytes of records."""
    lines = [HEAD]
    if probe_id is not None:
        lines.append(f'probe = "{probe_id}"')
    lines.append(f'digest = "{params.digest:08x}"')
    tags = [record.tag for record in params.records]
    if tags != sorted(tags):
        lines.append(f"order = {tags}  # of the records on the probe, by tag")
    for record in sorted(params.records, key=lambda each: each.tag):
        if record.kind is not None:
            lines += ["", *_table(record.kind, record.body)]
    if params.unknown:
        lines += ["", f"# {ABOUT['unknown']}.", "[unknown]"]
        lines += [
            f'{tag} = "{body.hex()}"' for tag, body in sorted(params.unknown.items())
        ]
    return "\n".join(lines) + "\n"


def _table(kind: Kind, body: bytes) -> Iterator[str]:
    yield f"# {ABOUT[kind.name]}."
    yield f"[{kind.name}]"
    wire, tail = kind.split(body)
    texts = [(part, wire[part.name]) for part in kind.parts if part.is_text and wire]
    if any(part.is_torn(text) for part, text in texts):
        wire, tail = {}, body
    for part in kind.parts[: len(wire)]:
        if wire[part.name] != part.null:
            yield from _key(part, wire[part.name])
    if len(wire) < len(kind.parts):
        yield f"{PARTS} = {len(wire)}  # an older record ends here"
    if tail:
        yield f'{TAIL} = "{tail.hex()}"  # of later firmware'


def _key(part: Part, wire: tuple[int, ...]) -> Iterator[str]:
    if part.is_matrix:
        decimals = part.decimals(wire)
        width = max(map(len, decimals))
        yield f"{part.key} = ["
        for row in range(0, 9, 3):
            cells = ", ".join(text.rjust(width) for text in decimals[row : row + 3])
            yield f"    [{cells}],"
        yield "]"
    elif part.is_text:
        text = "".join(
            c
            if c.isascii() and c.isprintable() and c not in '"\\'
            else f"\\U{ord(c):08x}"
            for c in str(part.plain(wire))
        )
        yield f'{part.key} = "{text}"'
    elif part.is_day or part.words:
        plain = part.plain(wire)
        yield f"{part.key} = {json.dumps(plain) if part.words else plain}"
    else:
        decimals = part.decimals(wire)
        text = f"[{', '.join(decimals)}]" if part.count > 1 else decimals[0]
        yield f"{part.key} = {text}"


def parse(text: str) -> ParamsFile:
    """The params in the text of a file; ParamsError with the first mistake."""
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise ParamsError("it is nested too deep") from None
    except ValueError as error:  # of tomllib; or thousands of digits, a 30 February
        words = str(error).partition(";")[0]
        raise ParamsError(f"it is not TOML: {words}") from None
    unknown = table.keys() - {*NAMES, "probe", "digest", "order", "unknown"}
    if unknown:
        what = min(unknown, key=list(table).index)
        raise ParamsError(
            f"there is no {_shown(what)} in params, only {', '.join(NAMES)}"
        )
    probe_id = _text(table, "probe", _ID, "16 hexadecimal digits, an id of imud list")
    digest = _text(table, "digest", _DIGEST, "8 hexadecimal digits")
    params = Params(tuple(_in_order(table, list(_records(table)))))
    if not params.records and digest is None:
        # An empty file, or one that was cut off, must not clear a probe.
        raise ParamsError("it holds no params; imud params clear PROBE removes all")
    if digest is not None and digest != f"{params.digest:08x}":
        raise ParamsError(
            f"the digest does not match: the values give {params.digest:08x}; if you "
            "edited them on purpose, delete the line that begins with digest"
        )
    return ParamsFile(params, probe_id)


def _records(table: Mapping[str, Any]) -> Iterator[ParamsRecord]:
    for kind in KINDS.values():
        if kind.name in table:
            yield _record(kind, _section(table, kind.name))
    for key, value in _section(table, "unknown").items():
        where = f"[unknown] {_shown(key)}"
        if not re.fullmatch(r"[0-9]{1,3}", key) or not 0 <= int(key) <= 255:
            raise ParamsError(f"{where}: a tag is a number from 0 to 255")
        if int(key) in KINDS:
            name = KINDS[int(key)].name
            raise ParamsError(f"{where}: this record has a table of its own: [{name}]")
        yield ParamsRecord(int(key), _bytes(value, where))


def _section(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    section = table.get(name, {})
    if not isinstance(section, dict):
        raise ParamsError(f"{name} is a table: [{name}] on a line of its own")
    return section


def _record(kind: Kind, table: Mapping[str, Any]) -> ParamsRecord:
    for key in table:
        if key not in kind.keys and key not in (PARTS, TAIL):
            known = ", ".join(kind.keys)
            raise ParamsError(
                f"[{kind.name}] {_shown(key)}: there is no such key, only {known}"
            )
    count = table.get(PARTS, len(kind.parts))
    if not isinstance(count, int) or not 0 <= count <= len(kind.parts):
        raise ParamsError(f"[{kind.name}] {PARTS} is not from 0 to {len(kind.parts)}")
    wire = {}
    for index, part in enumerate(kind.parts):
        where = f"[{kind.name}] {part.key}"
        if index >= count:
            if part.key in table:
                raise ParamsError(f"{where}: `parts` ends the record before this key")
            continue
        # An option that is left out is as without the record: the word of number 0.
        default = part.words[0] if kind.name == "options" else None
        try:
            wire[part.name] = part.wire(table.get(part.key, default))
        except ValueError as error:
            raise ParamsError(f"{where}: {_told(table, part.key)}{error}") from None
    tail = _bytes(table.get(TAIL, ""), f"[{kind.name}] {TAIL}")
    return ParamsRecord(kind.tag, _limited(kind.join(wire, tail), kind.name))


def _told(table: Mapping[str, Any], key: str) -> str:
    """A value of one number or word, to be repeated in a message."""
    value = table.get(key)
    return f"{_shown(value)} " if isinstance(value, str | datetime.date) else ""


def _in_order(
    table: Mapping[str, Any], records: list[ParamsRecord]
) -> list[ParamsRecord]:
    """By tag, unless the file gives the order."""
    tags = table.get("order", [])
    if not isinstance(tags, list) or not all(isinstance(tag, int) for tag in tags):
        raise ParamsError("order is a list of tags, such as [3, 1]")
    places = {tag: place for place, tag in reversed(list(enumerate(tags)))}
    return sorted(records, key=lambda each: (places.get(each.tag, len(tags)), each.tag))


def _bytes(value: object, where: str) -> bytes:
    if not isinstance(value, str) or not _HEX.fullmatch(value):
        raise ParamsError(f"{where}: bytes are pairs of hexadecimal digits in quotes")
    return _limited(bytes.fromhex(value), where)


def _limited(body: bytes, where: str) -> bytes:
    if len(body) > 255:
        raise ParamsError(f"{where}: {len(body)} bytes are more than a record holds")
    return body


def _text(
    table: Mapping[str, Any], key: str, form: re.Pattern[str], what: str
) -> str | None:
    value = table.get(key)
    if value is not None and not (isinstance(value, str) and form.fullmatch(value)):
        raise ParamsError(f"{key} is not {what}")
    return value


def _shown(value: object) -> str:
    """A value from a file for a message: short, without control characters."""
    text = "".join(c if c.isprintable() else "?" for c in str(value))
    return text if len(text) <= SHOWN_MAX else f"{text[: SHOWN_MAX - 3]}..."


def read(path: Path) -> ParamsFile:
    """A file of params. FileError if it can't be read, ParamsError with its name and
    what is wrong in it.
    """
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_MAX + 1)
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error
    if len(data) > SIZE_MAX:
        raise ParamsError(f"{path}: it is too long for a params file")
    try:
        return parse(data.decode("utf-8"))
    except UnicodeDecodeError:
        raise ParamsError(f"{path}: it is not text") from None
    except ParamsError as error:
        raise ParamsError(f"{path}: {error}") from None


def write(path: Path, params: Params, probe_id: str | None) -> None:
    """Writes a file, or replaces it; FileError if it can't."""
    try:
        path.write_text(written(params, probe_id), "utf-8")
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
