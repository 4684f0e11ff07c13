# SPDX-License-Identifier: MIT
"""The probe's C and the host's Python read what the other writes, and give
bad content the same names."""

from __future__ import annotations

import math
import subprocess
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from imud.params.value import Params
from imud.wire import frame, messages, schema
from imud.wire.params import ParamsParts
from length import choose, examples
from protocol import wire
from protocol.derived import range_of
from protocol.wire import VECTORS, unhex

pytestmark = pytest.mark.sampled(2)

# Where hello's fingerprint lies; of its own schema's hello the host is strict.
FINGERPRINT = slice(12, 16)

WIDE = {"u16": 2, "i16": 2, "u32": 4, "i32": 4}  # bytes a value, 1 for all others
UNIT_LENGTH = {"q": 2**30, "normal": 2**14}

Wire = dict[str, Any]
u32 = st.integers(0, 2**32 - 1)


@st.composite
def unit_vectors(draw: st.DrawFn, count: int, one: int) -> list[int]:
    values = draw(st.lists(st.integers(-1000, 1000), min_size=count, max_size=count))
    length = math.hypot(*values)
    assume(length > 0)
    return [round(one * value / length) for value in values]


def wire_values(field: schema.Field) -> st.SearchStrategy[Any]:
    """Wire numbers that the schema allows: one, or a list for an array."""
    if field.type == "text":
        printable = st.characters(min_codepoint=32, max_codepoint=126)
        return st.text(printable, max_size=field.count)
    if field.type == "bytes":
        return st.binary(min_size=field.count, max_size=field.count).map(bytes.hex)
    if field.enum is not None:
        return st.sampled_from([member.value for member in field.enum])
    if field.flags is not None:
        bits = [member.value for member in field.flags]
        return st.sets(st.sampled_from(bits)).map(sum)
    if field.name in UNIT_LENGTH:
        values = unit_vectors(field.count, UNIT_LENGTH[field.name])
    else:
        one = st.integers(*range_of(field.type)).filter(lambda n: n != field.null)
        if field.count == 1:
            return one if field.null is None else one | st.just(field.null)
        values = st.lists(one, min_size=field.count, max_size=field.count)
    if field.null is None:
        return values
    return values | st.just([field.null] * field.count)


def wire_messages(only: str = "") -> st.SearchStrategy[tuple[schema.MessageType, Wire]]:
    return st.sampled_from(
        [message for message in schema.MESSAGES if only in ("", message.name)]
    ).flatmap(
        lambda message: st.tuples(
            st.just(message),
            st.fixed_dictionaries({f.name: wire_values(f) for f in message.fields}),
        )
    )


def check_value(field: schema.Field, wire_value: Any, value: Any) -> None:
    """Whether the host's value is what the wire number means."""
    numbers = wire_value if isinstance(wire_value, list) else [wire_value]
    if field.type == "text":
        assert value == wire_value
    elif field.type == "bytes":
        assert value == bytes.fromhex(wire_value)
    elif field.enum is not None:
        assert value == field.enum(wire_value).name.lower()
    elif field.flags is not None:
        names = {flag.name for flag in field.flags if flag.value & wire_value}
        assert {name.upper() for name in value} == names
    elif field.null is not None and field.null in numbers:
        assert value is None
    else:
        expected = [number * field.scale for number in numbers]
        found = list(value) if isinstance(value, tuple) else [value]
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.long
@settings(max_examples=choose(everyday=examples(100), long=400))
@given(wire_messages(), u32, u32)
def test_the_host_reads_what_the_probe_writes_and_writes_the_same(
    pair: tuple[schema.MessageType, Wire], sequence: int, time_us: int
) -> None:
    message_type, fields = pair
    name = message_type.name
    content = wire.encode_message(name, fields, sequence, time_us)
    message = messages.decode(content)
    assert isinstance(message, messages.Message), message
    assert (message.name, message.sequence, message.time_us) == (
        name,
        sequence,
        time_us,
    )
    for field in message_type.fields:
        check_value(field, fields[field.name], message.fields[field.name])
    assert messages.encode(name, message.fields, sequence, time_us) == content
    result, header, again = wire.decode_message(name, content)
    assert (result, header) == ("ok", (message_type.id, sequence, time_us))
    for field in message_type.fields:
        value = again[field.name]
        assert (bytes(value).hex() if field.type == "bytes" else value) == fields[
            field.name
        ]


@given(wire_messages(), u32)
def test_the_hosts_frames_are_the_probes(
    pair: tuple[schema.MessageType, Wire], sequence: int
) -> None:
    message_type, fields = pair
    content = wire.encode_message(message_type.name, fields, sequence, 0)
    framed = wire.encode_frame(wire.seed_of(content, wire.lib.SCHEMA_SEED), content)
    assert frame.encode_frame(content) == framed
    assert frame.FrameDecoder().feed(framed) == [content]


def ours(content: bytes) -> bytes:
    """The content; a whole hello gets our own schema's fingerprint."""
    if content[0] != wire.HELLO_ID or len(content) < FINGERPRINT.stop:
        return content
    own = schema.FINGERPRINT.to_bytes(4, "little")
    return content[: FINGERPRINT.start] + own + content[FINGERPRINT.stop :]


def host_word(content: bytes) -> str:
    """The host's result by the C's name; the C does not check values."""
    found = messages.decode(content)
    if isinstance(found, messages.Message) or found.kind == "impossible_value":
        return "ok"
    return "wrong_id" if found.kind == "unknown_message" else found.kind


def test_parts_make_an_accelerometers_drift() -> None:
    parts = (
        "01280000000000000000000000000040000000000000004000000000",
        "00000040490024009808482602280000000000000000000000000000",
    )
    heard, digest = ParamsParts(), None
    for offset, part in zip((0, 28), parts, strict=True):
        fields = {"set_digest": 1595539754, "set_length": 42, "part_offset": offset}
        fields |= {"part": bytes.fromhex(part)}
        digest = heard.add_part(messages.Message("params", 9, 0, fields))
    assert digest is not None
    acc = Params.decode(heard.get(digest) or b"").plain("acc")
    assert acc["drift_m_s2_k"] == pytest.approx(40 * 7.8125e-5)
    assert acc["temperature_c"] == pytest.approx(22.0)


@pytest.mark.parametrize("vector", VECTORS["good"], ids=lambda v: v["name"])
def test_the_host_reads_every_good_vector(vector: dict[str, Any]) -> None:
    content = ours(unhex(vector["content"]))
    found = messages.decode(content)
    if vector.get("impossible", False):
        assert isinstance(found, messages.Skew)
        assert found.kind == "impossible_value"
        return
    assert isinstance(found, messages.Message), found
    assert (found.name, found.sequence, found.time_us) == (
        vector["message"],
        vector["sequence"],
        vector["time_us"],
    )
    fields = {field.name: field for m in schema.MESSAGES for field in m.fields}
    for name, number in vector["fields"].items():
        if name != "schema_fingerprint":  # ours() has put in another
            check_value(fields[name], number, found.fields[name])
    again = messages.encode(found.name, found.fields, found.sequence, found.time_us)
    assert content.startswith(again)
    assert (content == again) != vector.get("grown", False)


@pytest.mark.parametrize("vector", VECTORS["skew"], ids=lambda v: v["name"])
def test_the_host_names_every_skew_as_the_probe_does(vector: dict[str, Any]) -> None:
    assert host_word(ours(unhex(vector["content"]))) == vector["result"]


def pieces(name: str, content: bytes) -> list[bytes]:
    """Header and fields of good content."""
    message_type = next(m for m in schema.MESSAGES if m.name == name)
    found, at = [content[: wire.HEADER_SIZE]], wire.HEADER_SIZE
    for field in message_type.fields:
        size = 1 + WIDE.get(field.type, 1) * field.count
        found.append(content[at : at + size])
        at += size
    assert at == len(content)
    return found


@st.composite
def skewed(draw: st.DrawFn) -> tuple[str, bytes]:
    """Content with fields removed, doubled, exchanged, replaced or cut."""
    vector = draw(st.sampled_from([v for v in VECTORS["good"] if "grown" not in v]))
    parts = pieces(vector["message"], unhex(vector["content"]))
    for _ in range(draw(st.integers(1, 3))):
        one = draw(st.integers(1, max(1, len(parts) - 1)))
        other = draw(st.integers(1, max(1, len(parts) - 1)))
        match draw(st.sampled_from(["out", "twice", "exchange", "tag", "bytes"])):
            case "out":
                del parts[one : one + 1]
            case "twice":
                parts[other:other] = parts[one : one + 1]
            case "exchange" if len(parts) > max(one, other):
                parts[one], parts[other] = parts[other], parts[one]
            case "tag" if len(parts) > one:
                tag = draw(st.integers(0, 255))
                parts[one] = bytes([tag]) + parts[one][1:]
            case _:
                parts[one:one] = [draw(st.binary(max_size=3))]
    content = b"".join(parts)
    cut = draw(st.just(len(content)) | st.integers(1, len(content)))
    assume(cut <= wire.lib.FRAME_CONTENT_MAX)
    return vector["message"], ours(content[:cut])


@pytest.mark.long
@settings(max_examples=choose(everyday=examples(500), long=2000))
@given(skewed())
def test_probe_and_host_judge_alike(pair: tuple[str, bytes]) -> None:
    name, content = pair
    assert wire.decode_message(name, content)[0] == host_word(content)


def test_a_content_cut_anywhere_is_refused_whatever_lies_behind_it() -> None:
    for vector in VECTORS["good"]:
        name, whole = vector["message"], unhex(vector["content"])
        if vector.get("grown", False):
            continue
        whole = ours(whole)
        for kept in range(1, len(whole)):
            result, _, _ = wire.decode_message(name, whole[:kept], whole[kept:])
            assert result in ("missing", "wrong_length")
            assert host_word(whole[:kept]) == result


def test_the_constants_are_the_same() -> None:
    lib = wire.lib
    assert lib.PROTOCOL_VERSION == schema.PROTOCOL_VERSION
    assert lib.SCHEMA_FINGERPRINT == schema.FINGERPRINT
    assert lib.SCHEMA_SEED == schema.SEED
    assert lib.FRAME_HELLO_SEED == schema.HELLO_SEED
    assert {message.name: message.id for message in schema.MESSAGES} == wire.IDS
    groups = {
        "BOARD": schema.Board,
        "SENSOR": schema.Sensor,
        "STATE": schema.State,
        "EVENT": schema.Event,
        "CAUSE": schema.Cause,
        "COMMAND": schema.Command,
        "RESULT": schema.Result,
        "RESET_CAUSE": schema.ResetCauseFlags,
        "SELF_TEST": schema.SelfTestFlags,
        "SAMPLE": schema.SampleFlags,
        "POSE": schema.PoseFlags,
        "STREAM": schema.StreamFlags,
    }
    for prefix, group in groups.items():
        for member in group:
            assert getattr(lib, f"{prefix}_{member.name}") == member.value


@pytest.mark.parametrize("compiler", ["gcc", "avr-gcc"])
def test_the_nulls_are_the_same(compiler: str) -> None:
    """Asked of the compilers themselves: on the AVR an int has 16 bits."""
    checks = [
        f"_Static_assert({f'{message.name}_{field.name}'.upper()}_NULL"
        f' == {field.null}LL, "{field.name}");'
        for message in schema.MESSAGES
        for field in message.fields
        if field.null is not None
    ]
    assert len(checks) >= 8
    done = subprocess.run(
        [compiler, "-std=gnu11", "-Ifirmware", "-fsyntax-only", "-xc", "-"],
        input='#include "core/wire/messages.h"\n' + "\n".join(checks),
        cwd=wire.ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.returncode == 0
