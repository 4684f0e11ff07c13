# SPDX-License-Identifier: MIT
"""The four functions that stand in for a C library, under other names beside the
host's own."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native

NAMES = ("memcpy", "memmove", "memset", "memcmp")
ffi, lib = native.load(
    ["firmware/stm32/string.c"],
    ["firmware/stm32/libc/string.h"],
    [f"{name}=our_{name}" for name in NAMES],
)

SIZE = 64
places = st.integers(0, 32)
lengths = st.integers(0, 32)
pattern = bytes(range(1, SIZE + 1))


@given(places, places, lengths)
def test_a_copy_moves_its_bytes_and_no_others(to, at, length):
    source = ffi.new("uint8_t[]", pattern)
    target = ffi.new("uint8_t[]", SIZE)
    assert lib.our_memcpy(target + to, source + at, length) == target + to
    expected = bytearray(SIZE)
    expected[to : to + length] = pattern[at : at + length]
    assert bytes(target) == expected


@given(places, places, lengths)
def test_a_move_may_overlap_itself(to, at, length):
    room = ffi.new("uint8_t[]", pattern)
    assert lib.our_memmove(room + to, room + at, length) == room + to
    expected = bytearray(pattern)
    expected[to : to + length] = pattern[at : at + length]
    assert bytes(room)[:SIZE] == expected


@given(places, lengths, st.integers(-300, 300))
def test_a_fill_takes_the_low_byte(to, length, value):
    room = ffi.new("uint8_t[]", pattern)
    assert lib.our_memset(room + to, value, length) == room + to
    expected = bytearray(pattern)
    expected[to : to + length] = bytes([value % 256]) * length
    assert bytes(room)[:SIZE] == expected


@pytest.mark.parametrize(
    ("one", "other", "sign"),
    [
        (b"", b"", 0),
        (b"same", b"same", 0),
        (b"a\xff", b"a\x01", 1),
        (b"a\x01", b"a\xff", -1),
        (b"\x00\x00", b"\x00\x01", -1),
    ],
)
def test_a_comparison_tells_which_is_greater(one, other, sign):
    found = lib.our_memcmp(one, other, len(one))
    assert (found > 0) - (found < 0) == sign
