# SPDX-License-Identifier: MIT
"""Frames in any chunks, with noise, cuts, insertions and every flipped bit."""

from __future__ import annotations

import binascii
import itertools
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imud import _core
from length import choose, examples
from protocol import wire
from protocol.wire import VECTORS, Decoder, encode_frame, good, unhex

pytestmark = pytest.mark.sampled(3)

SEED = 0x2A57
CONTENT_MAX = wire.lib.FRAME_CONTENT_MAX
OVERHEAD = 4  # CRC, one COBS code, delimiter

contents = st.binary(min_size=1, max_size=CONTENT_MAX)
# Runs of zeros and of other bytes, the hard cases of COBS.
lumpy = st.lists(st.sampled_from([b"\0", b"\0\0\0", b"\x01", b"\xff\x80", b"abc"]))
sparse = lumpy.map(b"".join).filter(lambda b: 1 <= len(b) <= CONTENT_MAX)
seeds = st.integers(0, 0xFFFF)


def content_frame(content: bytes, seed: int = SEED) -> bytes:
    return encode_frame(wire.seed_of(content, seed), content)


def reference_frame(seed: int, content: bytes) -> bytes:
    """An independent encoder: COBS and CRC."""
    checked = content + struct.pack("<H", binascii.crc_hqx(content, seed))
    blocks = (bytes([len(b) + 1]) + b for b in checked.split(b"\0"))
    return b"".join(blocks) + b"\0"


def sample_contents() -> list[bytes]:
    """Every good vector's content, and random bytes in each message's layout."""
    rng = random.Random(20)  # noqa: S311 - the same frames on every run
    found = [unhex(vector["content"]) for vector in VECTORS["good"]]
    for name in wire.IDS:
        typical = next(v for v in VECTORS["good"] if v["message"] == name)
        for _ in range(3):
            fields = {
                field: [rng.randrange(256) for _ in range(kind.length)]
                if kind.kind == "array" and kind.item.cname == "uint8_t"
                else value
                for (field, kind), value in zip(
                    wire.field_types(name), typical["fields"].values(), strict=True
                )
            }
            content = bytearray(
                wire.encode_message(name, fields, rng.randrange(2**32), 0)
            )
            content[5:9] = rng.randbytes(4)
            found.append(bytes(content))
    found += [rng.randbytes(rng.randrange(1, CONTENT_MAX + 1)) for _ in range(12)]
    return found


NEXT = unhex(next(v for v in VECTORS["good"] if v["name"] == "an event")["content"])


@given(contents | sparse, seeds)
def test_content_goes_round_and_its_frame_has_one_zero(
    content: bytes, seed: int
) -> None:
    frame = content_frame(content, seed)
    assert frame == reference_frame(wire.seed_of(content, seed), content)
    assert frame.index(0) == len(frame) - 1 == len(content) + OVERHEAD - 1
    assert Decoder(seed).feed(frame) == [content]


@pytest.mark.parametrize("length", range(1, CONTENT_MAX + 1))
def test_every_length_goes_round(length: int) -> None:
    for content in (bytes(length), b"\xff" * length, bytes(range(1, length + 1))):
        assert Decoder(SEED).feed(content_frame(content)) == [content]


@given(st.binary(max_size=255), st.binary(max_size=255), seeds)
def test_a_crc_goes_on_where_the_one_before_ended(
    one: bytes, other: bytes, seed: int
) -> None:
    assert wire.crc(seed, one) == binascii.crc_hqx(one, seed)
    assert wire.crc(wire.crc(seed, one), other) == binascii.crc_hqx(one + other, seed)


@given(st.lists(contents, max_size=6), st.data())
def test_frames_come_through_in_any_chunks(
    messages: list[bytes], data: st.DataObject
) -> None:
    stream = b"".join(content_frame(content) for content in messages)
    cuts = data.draw(st.lists(st.integers(0, len(stream))))
    edges = [0, *sorted(cuts), len(stream)]
    decoder = _core.FrameDecoder(SEED, wire.HELLO_ID)
    found = [
        content
        for start, end in itertools.pairwise(edges)
        for content in decoder.feed(stream[start:end])
    ]
    assert found == messages
    assert decoder.stats()["ok"] == len(messages)


@given(st.lists(contents, min_size=1, max_size=5), st.binary(max_size=300), st.data())
def test_noise_costs_at_most_the_frame_that_it_touches(
    messages: list[bytes], noise: bytes, data: st.DataObject
) -> None:
    at = data.draw(st.integers(0, len(messages)))
    frames = [content_frame(content) for content in messages]
    stream = b"".join([*frames[:at], noise, *frames[at:]])
    found = good(Decoder(SEED).feed(stream))
    # Noise spoils the next frame unless a zero ends it.
    is_apart = not noise or noise.endswith(b"\0")
    expected = messages if is_apart else messages[:at] + messages[at + 1 :]
    assert found in (expected, messages)
    # After another frame one more zero keeps the next frame safe.
    guarded = b"".join([*frames[:at], noise, b"\0", *frames[at:]])
    assert good(Decoder(SEED).feed(guarded)) == messages


@given(st.lists(contents, max_size=5), st.lists(st.integers(0, 9), max_size=6))
def test_zeros_in_a_row_are_nothing(messages: list[bytes], zeros: list[int]) -> None:
    counts = [*zeros, *[0] * len(messages)]
    stream = b"".join(
        bytes(count) + content_frame(content)
        for count, content in zip(counts, messages, strict=False)
    )
    assert Decoder(SEED).feed(stream + bytes(5)) == messages


def test_a_frame_cut_anywhere_costs_itself_and_the_one_it_runs_into() -> None:
    for content in sample_contents():
        frame, following = content_frame(content), content_frame(NEXT)
        for kept in range(len(frame)):
            head = frame[:kept]
            # A frame that is cut away completely cannot spoil the next.
            expected = [NEXT] if kept == 0 else []
            assert good(Decoder(SEED).feed(head + following)) == expected
            assert good(Decoder(SEED).feed(head + b"\0" + following)) == (
                [content, NEXT] if kept == len(frame) - 1 else [NEXT]
            )
            tail = frame[kept:]
            assert good(Decoder(SEED).feed(tail + following)) == (
                [content, NEXT] if kept == 0 else [NEXT]
            )


def test_a_byte_lost_anywhere_never_gives_another_content() -> None:
    for content in sample_contents():
        frame = content_frame(content)
        for at in range(len(frame) - 1):
            found = Decoder(SEED).feed(frame[:at] + frame[at + 1 :])
            assert good(found) == []


@pytest.mark.parametrize("name", ["an event", "a command", "a hello"])
def test_a_byte_inserted_anywhere_never_gives_another_content(name: str) -> None:
    vector = next(v for v in VECTORS["good"] if v["name"] == name)
    content = unhex(vector["content"])
    frame = content_frame(content)
    for at in range(len(frame) + 1):
        for byte in range(256):
            found = Decoder(SEED).feed(frame[:at] + bytes([byte]) + frame[at:])
            is_outside = at >= len(frame) or (byte == 0 and at in (0, len(frame) - 1))
            assert good(found) == ([content] if is_outside else [])


@pytest.mark.long
def test_no_flipped_bit_ever_passes_as_good() -> None:
    """Every bit of every frame, and the frame behind it is not harmed."""
    following = content_frame(NEXT)
    flips = 0
    for content in sample_contents():
        frame = content_frame(content)
        for bit in range(0, 8 * len(frame), choose(everyday=3, long=1)):
            damaged = bytearray(frame)
            damaged[bit // 8] ^= 1 << bit % 8
            found = Decoder(SEED).feed(bytes(damaged) + following)
            # Without its delimiter a frame spoils the next.
            is_delimiter = bit // 8 == len(frame) - 1
            assert good(found) == ([] if is_delimiter else [NEXT])
            assert len(found) > len(good(found))
            flips += 1
    assert flips > choose(everyday=6_000, long=20_000)


@settings(max_examples=examples(300))
@given(contents, st.integers(1, 0xFFFF), st.integers(0, 8 * CONTENT_MAX), seeds)
def test_a_burst_of_16_bits_always_changes_the_crc(
    content: bytes, pattern: int, shift: int, seed: int
) -> None:
    number = int.from_bytes(content, "big")
    burst = (pattern << shift) % (1 << 8 * len(content))
    damaged = (number ^ burst).to_bytes(len(content), "big")
    assert (wire.crc(seed, damaged) == wire.crc(seed, content)) == (burst == 0)


def test_a_hello_and_a_message_never_stand_in_for_each_other() -> None:
    """Another first byte means another seed too, whatever the schema's seed."""
    for vector in VECTORS["good"]:
        content = unhex(vector["content"])
        for seed in (0x0000, 0x0F0F, 0x1234, 0xFFFE, 0xFEFF):
            frame = content_frame(content, seed)
            assert Decoder(seed).feed(frame) == [content]
            is_hello = content[0] == wire.HELLO_ID
            other = Decoder(seed ^ 0x5A5A).feed(frame)
            assert other == ([content] if is_hello else ["bad_crc"])


def test_a_flood_of_random_bytes_holds_nothing_good() -> None:
    decoder = Decoder(SEED)
    rng = random.Random(3)  # noqa: S311 - the same flood on every run
    assert good(decoder.feed(rng.randbytes(200_000))) == []
    assert decoder.c.length <= decoder.c.room
    assert good(decoder.feed(b"\0" + content_frame(NEXT))) == [NEXT]


@given(st.binary(max_size=600))
def test_the_decoder_stays_in_its_bounds(noise: bytes) -> None:
    decoder = Decoder(SEED)
    for byte in noise:
        decoder.feed([byte])
        assert decoder.c.length <= decoder.c.room
        assert decoder.c.remaining < 255
        if byte == 0:
            assert (decoder.c.length, decoder.c.code, decoder.c.error) == (0, 0, 0)


def test_a_frame_fills_the_decoders_room_and_no_more() -> None:
    small = Decoder(SEED)
    small.c.room = len(NEXT) + wire.lib.FRAME_CRC
    assert small.feed(content_frame(NEXT)) == [NEXT]
    assert small.feed(content_frame(NEXT + b"\x01")) == ["too_long"]
    assert small.feed(content_frame(NEXT)) == [NEXT]


def test_an_endless_frame_is_reported_once_and_forgotten() -> None:
    decoder = Decoder(SEED)
    assert decoder.feed(b"\x01" * 100_000) == []
    assert decoder.feed(b"\0" + content_frame(NEXT)) == ["too_long", NEXT]
