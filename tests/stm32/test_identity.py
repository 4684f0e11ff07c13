# SPDX-License-Identifier: MIT
"""96 bits of silicon to 64 of a probe's id."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

import native

ffi, lib = native.load()

words = st.lists(st.integers(0, 2**32 - 1), min_size=3, max_size=3)


def folded(three: list[int]) -> bytes:
    out = ffi.new("uint8_t[8]")
    lib.identity_fold(three, out)
    return bytes(out)


def fnv_1a(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def test_it_is_the_published_hash():
    # Of "foobar" in the authors' own list of test vectors.
    assert fnv_1a(b"foobar") == 0x85944171F73967E8


@given(words)
def test_all_twelve_bytes_count(three):
    data = b"".join(word.to_bytes(4, "little") for word in three)
    assert folded(three) == fnv_1a(data).to_bytes(8, "little")


@given(words, st.integers(0, 95))
def test_chips_that_differ_in_one_bit_have_different_ids(three, bit):
    other = list(three)
    other[bit // 32] ^= 1 << bit % 32
    assert folded(three) != folded(other)
