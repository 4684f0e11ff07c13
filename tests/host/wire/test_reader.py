# SPDX-License-Identifier: MIT
"""The C that reads messages gives what wire/fields.py says, and leaves it the rest."""

from __future__ import annotations

import random
import struct

import pytest

from fakes.messages import EXAMPLES
from imud import _core
from imud.wire import messages, schema
from imud.wire.fields import FieldCodec, Impossible
from imud.wire.messages import Message

PLAIN = [
    message.name
    for message in schema.MESSAGES
    if not any(field.type in ("text", "bytes") for field in message.fields)
]


def in_python(content: bytes, fields: list[FieldCodec]) -> dict[str, object] | None:
    """The same by the slow way; None: a value is impossible."""
    values: dict[str, object] = {}
    offset = struct.calcsize(schema.HEADER)
    for field in fields:
        try:
            values[field.name] = field.unpack(content, offset + 1)
        except Impossible:
            return None
        offset += 1 + field.size
    return values


@pytest.mark.parametrize("name", PLAIN)
def test_any_numbers_are_read_as_python_reads_them(name: str) -> None:
    kind = next(message for message in schema.MESSAGES if message.name == name)
    fields = [FieldCodec(field) for field in kind.fields]
    reader = _core.Reader(tuple(each for f in fields if (each := f.plain())))
    chance = random.Random(20)  # noqa: S311 - no secret
    read = 0
    good = messages.encode(name, EXAMPLES[name], 0, 0)
    for _ in range(300):
        head = struct.pack(schema.HEADER, kind.id, *chance.choices(range(1 << 32), k=2))
        content = head
        for field in fields:
            # Values of an example, nulls and the ends of ranges, any bytes.
            begin = len(content) + 1
            edge = chance.choice((0x00, 0x7F, 0x80, 0xFF))
            values = (
                *(good[begin : begin + field.size] for _ in range(18)),
                bytes([edge]) * field.size,
                bytes(field.size - 1) + bytes([edge]),
                chance.randbytes(field.size),
            )
            content += bytes([field.tag]) + chance.choice(values)
        expected = in_python(content, fields)
        result = reader.read(content)
        if result is not None:
            read += 1
            sequence, time_us, got = result
            assert (sequence, time_us) == struct.unpack(schema.HEADER, head)[1:]
            assert got == expected
            assert [type(value) for value in got.values()] == [
                type(value) for value in expected.values()
            ]
            assert [*got] == [*expected]
        assert reader.read(content[:-1]) is None
        assert reader.read(content + b"\0") is None
    assert read > 30


@pytest.mark.parametrize("name", PLAIN)
def test_a_wrong_tag_is_not_read(name: str) -> None:
    content = bytearray(messages.encode(name, EXAMPLES[name], 1, 2))
    kind = next(message for message in schema.MESSAGES if message.name == name)
    fields = [FieldCodec(field) for field in kind.fields]
    reader = _core.Reader(tuple(each for f in fields if (each := f.plain())))
    offset = struct.calcsize(schema.HEADER)
    for field in fields:
        content[offset] ^= 0x40
        assert reader.read(bytes(content)) is None
        content[offset] ^= 0x40
        offset += 1 + field.size
    assert isinstance(messages.decode(bytes(content)), Message)


@pytest.mark.parametrize("norm", [1.0, 1.0004, 1.0008, 0.9992, 1.002, 0.998])
def test_a_norm_that_python_accepts_is_accepted(norm: float) -> None:
    fields = EXAMPLES["pose"] | {"q": (norm, 0.0, 0.0, 0.0)}
    decoded = messages.decode(messages.encode("pose", fields, 1, 2))
    assert isinstance(decoded, Message) == (abs(norm - 1) < 1e-3)


def test_it_refuses_fields_that_it_can_not_read() -> None:
    good = FieldCodec(schema.Field("x", 1, "u16")).plain()
    with pytest.raises(ValueError, match="1 to 4 bytes"):
        _core.Reader(((*good[:3], 8, *good[4:]),))
    with pytest.raises(ValueError, match="1 to 16 numbers"):
        _core.Reader(((*good[:4], 17, *good[5:]),))
    with pytest.raises(TypeError):
        _core.Reader([good])  # type: ignore[arg-type]
