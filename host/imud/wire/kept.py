# SPDX-License-Identifier: MIT
"""The schemas that this imud reads: its own, and those of older probes and logs.

Each is kept by its fingerprint, as its canonical text (protocol/PROTOCOL.md). Contents
of another schema become contents of ours where they come in: from a FrameDecoder, or
the reader of logs. A field is the one with its tag, a member the one with its number.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from imud.wire import messages, schema
from imud.wire.messages import Codec

FOLDER = Path(__file__).parent / "schemas"

_TODAY = {field.tag: field for message in schema.MESSAGES for field in message.fields}
_HEADER = messages.FIELDS_OF.start
# Its id and place are the same in every schema.
_FINGERPRINT = messages.place_of("hello", "schema_fingerprint")


class KeptSchema:
    """A schema, and how contents of it become contents of ours."""

    def __init__(self, fingerprint: int, canonical: str) -> None:
        self.fingerprint = fingerprint
        self.seed = fingerprint & 0xFFFF
        self._same: set[int] = set()  # ids of messages that are as in our schema
        self.others: dict[int, Codec] = {}  # messages that are not
        layouts = _fields_of(canonical)
        for ours in schema.MESSAGES:
            fields = layouts.get(ours.id, ())
            if _layout(fields) == _layout(ours.fields):
                self._same.add(ours.id)
            elif fields:
                theirs = schema.MessageType(ours.name, ours.id, ours.direction, fields)
                self.others[ours.id] = Codec(theirs)

    def to_ours(self, content: bytes) -> bytes:
        """The content with the fields of our schema, those that it lacks not available.
        Unchanged where it can't be: decode() says what is wrong with it.
        """
        codec = self.others.get(content[0]) if content else None
        message = codec.read(content) if codec is not None else None
        if message is None:
            return content
        found = content[:_HEADER]
        for field in messages.CODECS[content[0]].fields:
            is_there = field.name in message.fields
            try:
                value = field.pack(message.fields[field.name]) if is_there else None
            except ValueError:
                return content
            found += bytes([field.tag]) + (value or field.blank())
        return found

    def takes(self, content: bytes) -> bool:
        """Whether a message of our schema is one of this schema, too."""
        return content[0] in self._same


def _fields_of(canonical: str) -> dict[int, tuple[schema.Field, ...]]:
    """The fields of each message by its id, named as in our schema."""
    found: dict[int, tuple[schema.Field, ...]] = {}
    ident = 0  # enums and flags come before all messages
    for line in canonical.splitlines():
        kind, name, *words = line.split()
        if kind == "message":
            ident = int(words[0])
        elif kind == "record":
            break
        elif kind == "field":
            found[ident] = (*found.get(ident, ()), _field(name, words))
    return found


def _field(name: str, words: list[str]) -> schema.Field:
    tag, kind, count, scale, unit, null, *_ = words
    ours = _TODAY.get(int(tag))
    base, _, power = scale.partition("^")
    return schema.Field(
        ours.name if ours else name,
        int(tag),
        kind,
        int(count),
        float(base) ** int(power) if power else float(scale),
        unit,
        None if null == "-" else int(null),
        ours.enum if ours else None,
        ours.flags if ours else None,
    )


def _layout(fields: tuple[schema.Field, ...]) -> list[object]:
    return [(f.name, f.tag, f.type, f.count, f.scale, f.null) for f in fields]


_FILES = {int(path.stem, 16): path for path in FOLDER.glob("*.txt")}


def fingerprints() -> list[int]:
    """Those of all schemas that this imud reads."""
    return sorted(_FILES)


@cache
def _kept(fingerprint: int) -> KeptSchema:
    return KeptSchema(fingerprint, _FILES[fingerprint].read_text("ascii"))


OURS = _kept(schema.FINGERPRINT)


def find(fingerprint: object) -> KeptSchema | None:
    """The schema of that fingerprint; None: this imud can't read it."""
    is_kept = isinstance(fingerprint, int) and fingerprint in _FILES
    return _kept(fingerprint) if is_kept else None


def fingerprint_of(hello: bytes) -> int:
    """The fingerprint in the content of a hello of any schema."""
    return int.from_bytes(hello[_FINGERPRINT], "little")


def as_ours(content: bytes) -> bytes:
    """A content that to_ours() gave, to be sent on: a hello then says so."""
    if content[:1] != bytes([messages.HELLO_ID]):
        return content
    ours = schema.FINGERPRINT.to_bytes(4, "little")
    return content[: _FINGERPRINT.start] + ours + content[_FINGERPRINT.stop :]
