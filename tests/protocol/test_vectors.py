# SPDX-License-Identifier: MIT
"""The vectors, derived from the document, against the firmware's C both ways."""

from __future__ import annotations

from typing import Any

import pytest

from protocol import wire
from protocol.wire import BY_HAND, VECTORS, as_bytes_hex, unhex


def each(kind: str, key: str = "name") -> pytest.MarkDecorator:
    """Those that have a key."""
    vectors = [vector for vector in VECTORS[kind] if key in vector]
    return pytest.mark.parametrize("vector", vectors, ids=[v["name"] for v in vectors])


@each("crc")
def test_the_crc_is_the_documents(vector: dict[str, Any]) -> None:
    assert wire.crc(vector["seed"], unhex(vector["bytes"])) == vector["crc"]


@each("frame")
def test_any_content_becomes_its_frame_and_comes_back(vector: dict[str, Any]) -> None:
    content, frame = unhex(vector["content"]), unhex(vector["frame"])
    assert wire.encode_frame(vector["seed"], content) == frame
    assert wire.Decoder(vector["seed"]).feed(frame) == [content]


@each("good")
def test_a_message_becomes_its_content(vector: dict[str, Any]) -> None:
    content = wire.encode_message(
        vector["message"], vector["fields"], vector["sequence"], vector["time_us"]
    )
    expected = unhex(vector["content"])
    if vector.get("grown", False):
        assert expected.startswith(content)
        assert len(expected) > len(content)
    else:
        assert content == expected


@each("good")
def test_content_becomes_its_message(vector: dict[str, Any]) -> None:
    name = vector["message"]
    result, header, fields = wire.decode_message(name, unhex(vector["content"]))
    assert result == "ok"
    assert header == (wire.IDS[name], vector["sequence"], vector["time_us"])
    assert as_bytes_hex(fields, vector["fields"]) == vector["fields"]


@each("good", "frame")
def test_content_becomes_its_frame_and_comes_back(vector: dict[str, Any]) -> None:
    content, frame = unhex(vector["content"]), unhex(vector["frame"])
    seed = wire.seed_of(content, vector["seed"])
    assert wire.encode_frame(seed, content) == frame
    assert wire.Decoder(vector["seed"]).feed(frame) == [content]


@each("skew")
def test_skew_is_refused_by_name(vector: dict[str, Any]) -> None:
    found = wire.decode_message(vector["message"], unhex(vector["content"]))
    assert found[0] == vector["result"]


@each("stream")
def test_a_stream_holds_what_it_holds(vector: dict[str, Any]) -> None:
    found = wire.Decoder(vector["seed"]).feed(unhex(vector["bytes"]))
    words = [item.hex() if isinstance(item, bytes) else item for item in found]
    assert words == vector["results"]


def test_every_message_has_one_by_hand() -> None:
    by_hand = [vector["message"] for vector in BY_HAND["good"] if "frame" in vector]
    assert sorted(by_hand) == sorted(wire.IDS)


def test_no_message_is_taken_for_another() -> None:
    for vector in VECTORS["good"]:
        for name in wire.IDS.keys() - {vector["message"]}:
            content = unhex(vector["content"])
            assert wire.decode_message(name, content)[0] == "wrong_id"


def test_the_examples_of_the_document_are_vectors() -> None:
    """Each block of hex in PROTOCOL.md, white space aside, is a vector's."""
    known = {
        unhex(vector[key]).hex()
        for kind in VECTORS.values()
        for vector in kind
        for key in ("content", "frame", "bytes")
        if key in vector
    }
    text = (wire.ROOT / "protocol" / "PROTOCOL.md").read_text("utf-8")
    examples = text.split("```hex\n")[1:]
    assert len(examples) >= 4
    for example in examples:
        lines = example.split("```")[0].splitlines()
        digits = "".join("".join(line.split("  ")[0].split()) for line in lines)
        assert digits in known, example
