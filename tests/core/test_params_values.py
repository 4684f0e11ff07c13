# SPDX-License-Identifier: MIT
"""The values that records may have, at their bounds and beyond."""

from __future__ import annotations

import struct

import pytest

from core.params_desk import (
    ACC,
    BANK,
    BASE,
    FULL,
    ONE,
    SMALL,
    Store,
    digest,
    ffi,
    lib,
    sensor,
    stored,
)

TIP_MAX_UM = 2_000_000
AXIS_MAX = 16_400  # a unit vector's part has 16,384 at most, and some rounding


def tip_of(offset: list[int], axis: list[int]) -> bytes:
    values = struct.pack("<3i3h", *offset, *axis) + b"\xff" * 5
    return bytes([lib.PARAMS_TIP, len(values)]) + values


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_a_tip_up_to_two_metres_away_is_known_and_none_beyond(
    at: int, sign: int
) -> None:
    store = Store()
    for far, is_known in ((TIP_MAX_UM, True), (TIP_MAX_UM + 1, False)):
        offset = [7, 7, 7]
        offset[at] = sign * far
        assert store.change(tip_of(offset, [0, 0, ONE])) == lib.RESULT_OK
        found = list(store.params.tip.offset_um)
        assert (found == offset) == is_known
        assert (found[0] == -(2**31)) == (not is_known)
        assert list(store.params.tip.axis) == [0, 0, ONE]


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_an_axis_is_a_unit_vector_or_not_known(at: int, sign: int) -> None:
    store = Store()
    for length, is_known in ((AXIS_MAX, True), (AXIS_MAX + 1, False)):
        axis = [3, 3, 3]
        axis[at] = sign * length
        assert store.change(tip_of([1, 2, 3], axis)) == lib.RESULT_OK
        assert (store.params.tip.axis[0] == -(2**15)) == (not is_known)
        assert list(store.params.tip.offset_um) == [1, 2, 3]


@pytest.mark.parametrize("tag", [0, 6, 7])
def test_records_of_tags_below_eight_come_once_though_nobody_knows_them(
    tag: int,
) -> None:
    foreign = bytes([tag, 1, 9])
    assert Store().change(ACC + foreign) == lib.RESULT_OK
    assert Store().change(ACC + foreign + foreign) == lib.RESULT_REFUSED


@pytest.mark.parametrize("tag", [8, 99, 255])
def test_records_of_other_tags_may_come_twice(tag: int) -> None:
    assert Store().change(ACC + 2 * bytes([tag, 1, 9])) == lib.RESULT_OK


def test_a_calibration_may_end_with_its_sigma() -> None:
    store = Store()
    assert store.change(sensor(lib.PARAMS_ACC, 5, more=b"\x21\x01")) == lib.RESULT_OK
    assert store.params.calibration.acc.sigma == 0x121


@pytest.mark.parametrize("length", [2, 4, 5, 6, 8, 9, 10, 11])
@pytest.mark.parametrize("last", [0, 94, 255])
def test_an_accelerometers_drift_is_read_where_its_record_has_it(length, last) -> None:
    record = b"\x01\x00\x02\x00\xc4\x09\x05\x00\x01" + bytes([last, 7])
    store = Store()
    part = sensor(lib.PARAMS_ACC, 5, more=record[:length])
    assert store.change(part) == lib.RESULT_OK
    found = store.params.calibration
    known_c = 2500 if length >= 6 else -(2**15)
    assert found.temperature == known_c
    assert found.drift == (last if length >= 10 else lib.CALIBRATION_DRIFT)


def test_the_last_part_is_filled_up_with_zeros() -> None:
    store = Store()
    assert store.change(FULL) == lib.RESULT_OK
    part = ffi.new("uint8_t[]", b"\xee" * lib.PARAMS_PART)
    at = len(FULL) // lib.PARAMS_PART * lib.PARAMS_PART
    lib.params_store_part(store.c, lib.BANK_CURRENT, len(FULL), at, part)
    told = bytes(part)[: lib.PARAMS_PART]
    assert told == FULL[at:].ljust(lib.PARAMS_PART, b"\0")


def test_a_mark_that_cannot_be_blanked_ends_the_change() -> None:
    memory = stored(SMALL, FULL)
    store = Store(memory)
    old = store.image
    # Those before are asked for again: they need not be sent, and have a mark.
    spare = BASE + (store.bank ^ 1) * BANK
    memory.worn = {spare}
    memory.writes.clear()
    assert store.apply(len(SMALL), digest(SMALL))[0] == lib.RESULT_FAILED
    store.settle()
    assert set(memory.writes) == {spare}  # and nothing behind it
    assert (store.image, store.changes) == (old, 0)
