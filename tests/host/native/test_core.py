# SPDX-License-Identifier: MIT
"""The C core as Python sees it: arguments, buffers, counters, memory."""

from __future__ import annotations

import binascii
import gc
import sys
import tracemalloc
import weakref

import pytest

from imud import _core

SEED = 0x1D0F
HELLO = 0x03


def decoder() -> _core.FrameDecoder:
    return _core.FrameDecoder(SEED, HELLO)


@pytest.mark.parametrize("length", [0, 1, 254, 255, 256, 510, 1000])
def test_crc_of_any_length_agrees_with_the_standard_library(length):
    data = bytes(i * 7 & 0xFF for i in range(length))
    assert _core.crc16(SEED, data) == binascii.crc_hqx(data, SEED)


def test_crc_has_the_check_value_of_its_catalogue_entry():
    # CRC-16/IBM-3740 (CCITT-FALSE), check value over "123456789".
    assert _core.crc16(0xFFFF, b"123456789") == 0x29B1


@pytest.mark.parametrize("length", [1, _core.CONTENT_MAX])
def test_content_at_the_limits_goes_round(length):
    content = bytes([9] * length)
    assert decoder().feed(_core.encode_frame(SEED, content)) == [content]


@pytest.mark.parametrize("length", [0, _core.CONTENT_MAX + 1, 255, 256, 257])
def test_content_beyond_the_limits_is_refused(length):
    with pytest.raises(ValueError, match=f"1 to 120 bytes, not {length}"):
        _core.encode_frame(SEED, bytes(length))


@pytest.mark.parametrize("seed", [-1, 0x10000])
def test_a_seed_that_is_not_16_bits_is_refused(seed):
    for call in (
        lambda: _core.crc16(seed, b"x"),
        lambda: _core.encode_frame(seed, b"x"),
        lambda: _core.FrameDecoder(seed, HELLO),
    ):
        with pytest.raises(ValueError, match="seed must be 0 to 65535"):
            call()


@pytest.mark.parametrize("hello_id", [-1, 256])
def test_an_id_that_is_not_8_bits_is_refused(hello_id):
    with pytest.raises(ValueError, match="hello_id must be 0 to 255"):
        _core.FrameDecoder(SEED, hello_id)


@pytest.mark.parametrize("wrong", ["text", None, 5, [1, 2]])
def test_what_is_no_buffer_is_refused(wrong):
    for call in (
        lambda: decoder().feed(wrong),
        lambda: _core.crc16(SEED, wrong),
        lambda: _core.encode_frame(SEED, wrong),
    ):
        with pytest.raises(TypeError):
            call()


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_contiguous_buffer_will_do(kind):
    frame = _core.encode_frame(SEED, kind(b"\x09pose"))
    assert decoder().feed(kind(frame)) == [b"\x09pose"]
    with pytest.raises(BufferError):
        decoder().feed(memoryview(frame)[::2])


def test_a_buffer_is_let_go():
    frame = bytearray(_core.encode_frame(SEED, b"\x09pose"))
    decoder().feed(frame)
    with pytest.raises(ValueError, match="must be"):
        _core.encode_frame(-1, frame)
    frame.append(0)  # BufferError while anything holds it


def test_each_kind_of_bad_frame_has_its_counter():
    good = _core.encode_frame(SEED, b"\x09pose")
    hello = _core.encode_frame(_core.HELLO_SEED, bytes([HELLO]) + b"hello")
    corrupt = bytes([good[0], good[1] ^ 0x10]) + good[2:]
    stream = b"".join(
        [
            good,
            hello,
            _core.encode_frame(SEED ^ 1, b"\x09other"),
            corrupt,
            b"\x05abc\x00",  # a COBS code that reaches beyond the delimiter
            b"\xff" + b"\x01" * 254 + b"\x02x\x00",
            b"\x02x\x00",
        ]
    )
    under_test = decoder()
    assert under_test.feed(stream) == [b"\x09pose", bytes([HELLO]) + b"hello"]
    assert under_test.stats() == {
        "ok": 2,
        "bad_cobs": 1,
        "bad_crc": 2,
        "too_long": 1,
        "too_short": 1,
    }


def test_decoders_share_nothing():
    first, second = decoder(), decoder()
    frame = _core.encode_frame(SEED, b"\x09pose")
    assert first.feed(frame[:4]) == second.feed(frame)[1:]
    assert first.feed(frame[4:]) == [b"\x09pose"]
    assert (first.stats()["ok"], second.stats()["ok"]) == (1, 1)


def test_nothing_leaks_in_good_or_bad_calls():
    frame = _core.encode_frame(SEED, b"\x09pose")

    def round_trip() -> None:
        under_test = decoder()
        under_test.feed(frame * 3)
        under_test.stats()
        _core.crc16(SEED, frame)
        for bad in (lambda: _core.FrameDecoder(-1, 0), lambda: under_test.feed(None)):
            with pytest.raises((TypeError, ValueError)):
                bad()

    round_trip()
    gc.collect()  # what tests before this one have left
    references = sys.getrefcount(_core.FrameDecoder), sys.getrefcount(frame)
    tracemalloc.start()
    try:
        for _ in range(50):
            round_trip()
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(500):
            round_trip()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (sys.getrefcount(_core.FrameDecoder), sys.getrefcount(frame)) == references
    # One leaked decoder a round would be 500 * 150 bytes.
    assert after - before < 20_000


def test_the_collector_knows_what_a_decoder_holds():
    under_test = decoder()
    assert gc.is_tracked(under_test)
    assert gc.get_referents(under_test) == [_core.FrameDecoder]
    with pytest.raises(TypeError):
        weakref.ref(under_test)
    with pytest.raises(TypeError):
        _core.FrameDecoder.feed = None
