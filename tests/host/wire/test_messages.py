# SPDX-License-Identifier: MIT
"""Content to messages and back, and every way in which content can be skewed."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import EXAMPLES, HELLO, POSE, FakeProbe
from imud.wire import schema
from imud.wire.messages import Skew, _examine, decode, encode, place_of

HEADER = 9


def fields_of(content: bytes, name: str) -> list[bytes]:
    """A message's content cut into its fields, tag and value."""
    message = next(m for m in schema.MESSAGES if m.name == name)
    parts, offset = [], HEADER
    for field in message.fields:
        size = 1 + struct.calcsize("<" + field.code)
        parts.append(content[offset : offset + size])
        offset += size
    assert offset == len(content)
    return parts


def kind_of(content: bytes) -> str:
    decoded = decode(content)
    assert isinstance(decoded, Skew), decoded
    return decoded.kind


def approx(value: Any) -> Any:
    return pytest.approx(value) if isinstance(value, float | tuple) else value


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_message_comes_back_as_it_was(name: str) -> None:
    decoded = decode(encode(name, EXAMPLES[name], 0x89ABCDEF, 0xFEDCBA98))
    assert (decoded.name, decoded.sequence, decoded.time_us) == (
        name,
        0x89ABCDEF,
        0xFEDCBA98,
    )
    assert list(decoded.fields) == [
        f.name for m in schema.MESSAGES if m.name == name for f in m.fields
    ]
    for field, value in EXAMPLES[name].items():
        if value and isinstance(value, tuple) and isinstance(value[0], str):
            assert decoded.fields[field] == value
        else:
            assert decoded.fields[field] == approx(value)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_place_of_a_field_holds_its_value(name: str) -> None:
    content = encode(name, EXAMPLES[name], 1, 2)
    parts = fields_of(content, name)
    for field, part in zip(EXAMPLES[name], parts, strict=True):
        place = place_of(name, field)
        assert content[place] == part[1:]
        assert content[place.start - 1 : place.start] == part[:1]


def test_a_field_that_a_message_lacks_has_no_place() -> None:
    with pytest.raises(ValueError, match="pose has no field uptime"):
        place_of("pose", "uptime")


@given(st.lists(st.integers(-(2**30), 2**30), min_size=4, max_size=4))
def test_a_quaternion_is_exact_in_doubles(wire: list[int]) -> None:
    norm = sum(number * number for number in wire) ** 0.5 / 2**30
    content = encode("pose", POSE, 0, 0)
    at = HEADER + 1
    decoded = decode(content[:at] + struct.pack("<4i", *wire) + content[at + 16 :])
    if abs(norm - 1) < 1e-3:
        assert decoded.fields["q"] == tuple(number / 2**30 for number in wire)
    else:
        assert isinstance(decoded, Skew)
        assert decoded.kind == "impossible_value"


def test_a_decimal_scale_gives_the_decimal() -> None:
    decoded = decode(encode("pose", POSE | {"tilt_sigma": 0.07}, 0, 0))
    assert decoded.fields["tilt_sigma"] == 0.07


@pytest.mark.parametrize(
    ("name", "field"),
    [(m.name, f.name) for m in schema.MESSAGES for f in m.fields if f.null is not None],
)
def test_not_available_is_none(name: str, field: str) -> None:
    decoded = decode(encode(name, EXAMPLES[name] | {field: None}, 0, 0))
    assert decoded.fields[field] is None


@pytest.mark.parametrize("length", range(HEADER))
def test_less_than_a_header_has_no_number(length: int) -> None:
    decoded = decode(bytes(length))
    assert isinstance(decoded, Skew)
    assert (decoded.kind, decoded.sequence) == ("wrong_length", None)


def test_an_id_that_is_no_message_keeps_its_number() -> None:
    decoded = decode(b"\x77" + struct.pack("<II", 5, 6))
    assert isinstance(decoded, Skew)
    assert (decoded.kind, decoded.sequence, decoded.time_us) == (
        "unknown_message",
        5,
        6,
    )


def test_text_that_is_not_text_is_impossible() -> None:
    content = encode("hello", HELLO, 0, 0)
    for wrong in (b"0.1.0\x07fake", b"0.1.0\xe9fake"):
        assert kind_of(content.replace(b"0.1.0+fake", wrong)) == "impossible_value"


def test_a_hello_of_a_later_schema_is_read_as_far_as_it_is_known() -> None:
    other = FakeProbe(schema_fingerprint=schema.FINGERPRINT ^ 1).content("hello")
    decoded = decode(other + b"\xf0\x01\x02")
    assert decoded.fields["firmware"] == "0.1.0+fake"
    board = other.index(bytes([4, 1]), HEADER + 20)
    decoded = decode(other[: board + 1] + b"\xee" + other[board + 2 :])
    assert decoded.fields["board"] is None


def test_a_hello_of_an_older_schema_is_read_if_it_says_who_it_is() -> None:
    other = FakeProbe(schema_fingerprint=schema.FINGERPRINT ^ 1).content("hello")
    parts = fields_of(other, "hello")
    decoded = decode(other[:HEADER] + b"".join(parts[:5]))
    assert list(decoded.fields)[-1] == "probe_id"
    assert kind_of(other[:HEADER] + b"".join(parts[:4])) == "missing"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q": None}, "q can't be None"),
        ({"q": (1.0, 0.0, 0.0)}, "4 numbers"),
        ({"q": (9.0, 0.0, 0.0, 0.0)}, "q can't be"),
        ({"pose_flags": ("sleepy",)}, "pose_flags can't be"),
        ({"tilt_sigma": "1"}, "tilt_sigma can't be"),
        ({"sigma": 1}, "unknown or missing fields"),
    ],
)
def test_what_can_not_be_sent_is_an_error(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        encode("pose", POSE | change, 0, 0)


def test_text_that_is_too_long_is_an_error() -> None:
    with pytest.raises(ValueError, match="at most 16 bytes"):
        encode("hello", HELLO | {"firmware": "0" * 17}, 0, 0)


@given(st.sampled_from(sorted(EXAMPLES)), st.data())
def test_the_quick_way_says_what_the_careful_one_says(name: str, data: Any) -> None:
    content = bytearray(encode(name, EXAMPLES[name], 7, 8))
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(
            st.integers(1, 255)
        )
    hurt = bytes(content[: data.draw(st.integers(0, len(content)))])
    for each in (bytes(content), hurt):
        assert decode(each) == _examine(each)
