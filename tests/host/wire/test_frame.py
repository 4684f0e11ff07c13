# SPDX-License-Identifier: MIT
"""The firmware's frame decoder, as the daemon uses it, against one of a few lines."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from fakes import FakeProbe
from imud.wire.frame import FrameDecoder, FrameStats, encode_frame

CONTENT = st.binary(min_size=1, max_size=reference.CONTENT_MAX)


def feed(data: bytes, cuts: list[int]) -> tuple[list[bytes], FrameStats]:
    decoder = FrameDecoder()
    contents = []
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for start, end in itertools.pairwise(edges):
        contents += decoder.feed(data[start:end])
    return contents, decoder.stats


@given(st.lists(CONTENT, max_size=8), st.lists(st.integers(0, 1000), max_size=8))
def test_contents_come_back_whatever_the_chunks(
    contents: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(encode_frame(content) for content in contents)
    assert stream.count(0) == len(contents)
    decoded, stats = feed(stream, cuts)
    assert decoded == contents
    assert stats == FrameStats(ok=len(contents))


@given(
    st.lists(st.one_of(CONTENT.map(encode_frame), st.binary(max_size=140)), max_size=10)
)
def test_noise_between_frames_is_refused_as_the_reference_refuses_it(
    parts: list[bytes],
) -> None:
    stream = b"".join(parts) + b"\0"
    decoded, stats = feed(stream, [])
    assert decoded == reference.contents(stream)
    assert stats.ok == len(decoded)


@given(st.data())
def test_damage_costs_the_frames_it_touches_and_no_other(data: st.DataObject) -> None:
    probe = FakeProbe()
    frames = [probe.say("pose") for _ in range(6)]
    struck = data.draw(st.integers(0, 4))
    place = data.draw(st.integers(0, len(frames[struck]) - 1))
    damaged = bytearray(frames[struck])
    damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    stream = b"".join([*frames[:struck], bytes(damaged), *frames[struck + 1 :]])
    decoded, _ = feed(stream, [])
    whole = [reference.contents(frame)[0] for frame in frames]
    # A lost delimiter joins two frames; nothing else reaches beyond its own.
    lost = {struck, struck + 1} if place == len(frames[struck]) - 1 else {struck}
    assert decoded == [c for i, c in enumerate(whole) if i not in lost]


@pytest.mark.parametrize("length", [0, reference.CONTENT_MAX + 1])
def test_content_that_fits_no_frame_is_an_error(length: int) -> None:
    with pytest.raises(ValueError, match="1 to 120 bytes"):
        encode_frame(bytes(length))


def test_bad_frames_are_told_apart() -> None:
    flipped = bytearray(encode_frame(b"no zero, so one code"))
    flipped[5] ^= 0x10
    decoder = FrameDecoder()
    decoder.feed(bytes(flipped))
    decoder.feed(b"\x05\x01\0")  # a code that points past the delimiter
    decoder.feed(b"\x02\x01\0")
    decoder.feed(b"\xff" + b"\x01" * 254 + b"\0")
    assert decoder.stats == FrameStats(bad_crc=1, bad_cobs=1, too_short=1, too_long=1)
