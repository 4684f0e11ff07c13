# SPDX-License-Identifier: MIT
"""The id of a chip, of any length, to 64 bits of a probe's id."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

import native

ffi, lib = native.load()

# Of the STM32F405 twelve bytes, of the Pico's flash eight.
chip_ids = st.binary(min_size=1, max_size=32)


def folded(chip_id: bytes) -> bytes:
    out = ffi.new("uint8_t[8]")
    lib.identity_fold(chip_id, len(chip_id), out)
    return bytes(out)


def fnv_1a(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def test_it_is_the_published_hash() -> None:
    # Of "foobar" in the authors' own list of test vectors.
    assert fnv_1a(b"foobar") == 0x85944171F73967E8


@given(chip_ids)
def test_all_bytes_count(chip_id: bytes) -> None:
    assert folded(chip_id) == fnv_1a(chip_id).to_bytes(8, "little")


@given(chip_ids, st.data())
def test_chips_that_differ_in_one_bit_have_different_ids(
    chip_id: bytes, data: st.DataObject
) -> None:
    bit = data.draw(st.integers(0, 8 * len(chip_id) - 1))
    other = bytearray(chip_id)
    other[bit // 8] ^= 1 << bit % 8
    assert folded(chip_id) != folded(bytes(other))
