# SPDX-License-Identifier: MIT
"""Params change as one transaction: staged, checked, switched to at once, or not."""

from __future__ import annotations

import struct

import pytest

from core.params_desk import (
    ACC,
    BANK,
    BASE,
    FOREIGN,
    FULL,
    GYR,
    MAG,
    ONE,
    ROOM,
    SMALL,
    TIP,
    Cells,
    Store,
    again,
    digest,
    ffi,
    lib,
    options,
    sensor,
    stored,
    values_of,
)

NONE = Store().image
OK, BUSY = lib.RESULT_OK, lib.RESULT_BUSY
DAMAGED, REFUSED, FAILED = lib.RESULT_DAMAGED, lib.RESULT_REFUSED, lib.RESULT_FAILED
SHORT, RANGE, TWICE = (
    lib.PARAMS_WRONG_LENGTH,
    lib.PARAMS_OUT_OF_RANGE,
    lib.PARAMS_DOUBLED,
)


def test_a_memory_without_params_has_the_identity():
    for filler in (0x00, 0x55, 0xB2, 0xFF):
        store = Store(Cells(bytes([filler]) * lib.MEMORY_SIZE))
        assert store.is_whole
        assert (store.digest, store.records) == (0, b"")
        identity = ffi.new("struct calibration *")
        lib.calibration_clear(identity)
        size = ffi.sizeof("struct calibration")
        assert store.image[:size] == bytes(ffi.buffer(identity))
        assert store.params.calibration.mag.matrix[1][1] == ONE
        assert (store.params.button_does, store.params.reference) == (0, 0)


@pytest.mark.parametrize("records", [FULL, SMALL, ACC, MAG + GYR, TIP, FOREIGN, b""])
def test_a_change_holds_and_survives_a_boot(records):
    store = Store()
    assert store.change(records) == OK
    assert store.changes == (1 if records else 0)
    assert (store.digest, store.records) == (digest(records), records)
    after = again(store.memory)
    assert after.is_whole
    assert (after.digest, after.records) == (digest(records), records)
    assert after.image == store.image


def test_values_of_the_records_are_in_force():
    store = Store()
    assert store.change(FULL) == OK
    params = store.params
    assert list(params.calibration.acc.bias) == [12345, -12345, 0]
    assert params.calibration.gyr.matrix[2][2] == ONE + 160
    assert params.calibration.mag.bias[0] == 1_000_000
    assert (params.button_does, params.reference) == (1, 2)


def test_the_temperature_and_the_field_of_a_calibration_are_in_force():
    """In whole records; a shorter one of older firmware leaves them unknown."""
    tail = struct.pack("<HHhHB", 250, 30, -1234, 9800, 2)
    field = struct.pack("<Hhhhh", 4820, 6610, 0, 78, -176)
    acc = sensor(lib.PARAMS_ACC, more=tail)
    mag = sensor(lib.PARAMS_MAG, more=tail + field)
    store = Store()
    assert store.change(acc + mag) == OK
    calibration = store.params.calibration
    assert (calibration.field_north, calibration.field_up) == (78, -176)
    assert calibration.temperature == -1234
    short = sensor(lib.PARAMS_ACC, more=tail[:5]) + sensor(
        lib.PARAMS_MAG, more=tail + field[:-1]
    )
    assert store.change(short) == OK
    assert calibration.field_north == lib.CALIBRATION_NO_FIELD
    assert calibration.temperature == lib.SAMPLE_NO_TEMPERATURE


def test_nothing_is_in_force_before_it_is_applied():
    store = Store(stored(SMALL))
    before = store.image
    store.stage(FULL)
    assert store.image == before
    assert again(store.memory).image == before


def test_all_parts_are_told_before_the_switch():
    store = Store()
    store.stage(FULL)
    assert store.ask(len(FULL), digest(FULL))[0] == BUSY
    while store.changes == 0:
        store.step()
        whole = b"".join(part for _, part in store.told)
    assert whole[: len(FULL)] == FULL
    assert not any(whole[len(FULL) :])
    assert [at for at, _ in store.told] == list(range(0, len(FULL), lib.PARAMS_PART))


def test_no_records_are_an_own_change_that_tells_itself():
    store = Store(stored(FULL))
    assert store.apply(0, 0)[0] == OK
    assert store.told == [(0, bytes(lib.PARAMS_PART))]
    assert store.image == NONE
    assert (again(store.memory).digest, again(store.memory).image) == (0, NONE)


def test_what_was_applied_can_be_asked_for_again_and_wears_nothing():
    store = Store()
    assert store.change(FULL) == OK
    store.memory.writes.clear()
    assert store.ask(len(FULL), digest(FULL))[0] == OK
    store.stage(FULL)
    assert store.apply(len(FULL), digest(FULL))[0] == OK
    assert store.changes == 1


def test_the_params_before_come_back_without_being_sent():
    store = Store(stored(SMALL, FULL))
    assert store.apply(len(SMALL), digest(SMALL))[0] == OK
    assert store.image == values_of(SMALL)


# Hosts that are wrong, late, or two.


def test_missing_parts_are_damage_and_the_old_params_hold():
    store = Store(stored(SMALL))
    old = store.image
    for missing in range(0, len(FULL), 4):
        fresh = again(store.memory)
        spare = BASE + (store.bank ^ 1) * BANK
        fresh.memory.bytes[spare : spare + BANK] = b"\xee" * BANK
        for at in range(0, len(FULL), 4):
            if at != missing:
                assert fresh.write(at, FULL[at : at + 4]) == OK
                fresh.settle()
        assert fresh.apply(len(FULL), digest(FULL))[0] == DAMAGED
        assert fresh.image == old


def test_two_hosts_at_once_are_damage_and_then_one_of_them_has_it():
    one, other = ACC + options(1, 1), GYR + options(0, 2)
    store = Store()
    for at in range(0, len(one), 4):
        for records in (one, other):
            assert store.write(at, records[at : at + 4]) == OK
            store.settle()
    assert store.apply(len(one), digest(one))[0] == DAMAGED
    assert store.image == NONE
    assert store.apply(len(other), digest(other))[0] == OK
    assert store.image == values_of(other)


def test_a_word_waits_until_the_one_before_is_in_memory():
    store = Store()
    store.memory.busy = 3
    assert store.write(0, FULL[:4]) == OK
    assert store.write(4, FULL[4:8]) == BUSY
    assert store.ask(4, digest(FULL[:4]))[0] == BUSY
    store.settle()
    assert store.write(4, FULL[4:8]) == OK


def test_nothing_can_be_staged_while_a_change_is_checked():
    store = Store()
    store.stage(FULL)
    assert store.ask(len(FULL), digest(FULL))[0] == BUSY
    while store.changes == 0:
        assert store.write(0, b"\xff\xff\xff\xff") == BUSY
        assert store.ask(4, 77)[0] == BUSY
        store.step()
    assert store.image == values_of(FULL)


def test_a_result_is_of_the_change_that_was_asked_for():
    store = Store()
    store.stage(FULL)
    assert store.ask(len(FULL), 1)[0] == BUSY
    store.settle()  # damaged, and nobody asks any more
    assert store.apply(len(FULL), digest(FULL))[0] == OK


@pytest.mark.parametrize(
    ("at", "word"), [(-4, 0), (1, 0), (2, 0), (ROOM, 0), (ROOM - 3, 0), (2**31 - 4, 0)]
)
def test_a_word_belongs_to_a_multiple_of_four_inside_the_room(at, word):
    assert lib.params_store_write(Store().c, at, word) == lib.RESULT_BAD_ARGUMENT


@pytest.mark.parametrize(
    "length",
    [
        *(-(2**31), -256, -1, 512, 512 + 4, 2**16 + 4, 2**31 - 1),
        *range(ROOM + 1, 256),
        *range(256 + ROOM + 1, 512),
    ],
)
def test_a_length_is_inside_the_room(length):
    assert Store().ask(length, 5)[0] == lib.RESULT_BAD_ARGUMENT


def test_256_beside_the_length_says_that_the_filter_goes_on():
    store = Store()
    for more in (256, 0):
        for records in (SMALL, FULL, b""):
            store.stage(records)
            assert store.apply(len(records) + more, digest(records))[0] == OK
            assert store.records == records
            assert store.c.goes_on == (more == 256)


@pytest.mark.parametrize("more", [0, 256])
def test_what_is_in_force_is_in_force_however_the_filter_shall_go_on(more):
    store = Store(stored(FULL))
    store.memory.writes.clear()
    assert store.apply(len(FULL) + more, digest(FULL))[0] == OK
    assert (store.changes, store.memory.writes) == (0, [])


def test_a_refusal_is_told_with_256_beside_the_length():
    store = Store()
    store.stage(options(3, 0))
    refused = store.apply(4 + 256, digest(options(3, 0)))
    assert refused == (REFUSED, [lib.PARAMS_OPTIONS, RANGE])


def test_records_may_fill_the_room_to_its_last_byte():
    records = ACC + b"\xc8\xc8" + b"x" * 200
    left = ROOM - len(records) - 2
    records += bytes([201, left]) + b"y" * left
    assert len(records) == ROOM
    store = Store()
    assert store.change(records) == OK
    assert again(store.memory).records == records


@pytest.mark.parametrize(
    ("records", "refusal"),
    [
        (ACC[:-1], (lib.PARAMS_ACC, SHORT)),
        (ACC + GYR[:1], (lib.PARAMS_GYR, SHORT)),
        (bytes([lib.PARAMS_MAG, 29]) + bytes(29), (lib.PARAMS_MAG, SHORT)),
        (bytes([lib.PARAMS_OPTIONS, 1, 0]), (lib.PARAMS_OPTIONS, SHORT)),
        (FOREIGN[:-1], (0x63, SHORT)),
        (sensor(lib.PARAMS_ACC, 0, 27853), (lib.PARAMS_ACC, RANGE)),
        (sensor(lib.PARAMS_GYR, 16384**2 + 1), (lib.PARAMS_GYR, RANGE)),
        (sensor(lib.PARAMS_MAG, 1 - 2**31), (lib.PARAMS_MAG, RANGE)),
        (options(3, 0), (lib.PARAMS_OPTIONS, RANGE)),
        (options(0, 3), (lib.PARAMS_OPTIONS, RANGE)),
        (options() + ACC + options(), (lib.PARAMS_OPTIONS, TWICE)),
        (ACC + sensor(lib.PARAMS_ACC), (lib.PARAMS_ACC, TWICE)),
    ],
)
def test_records_that_cannot_be_used_are_refused_by_name(records, refusal):
    store = Store(stored(SMALL))
    old = store.image
    store.stage(records)
    assert store.apply(len(records), digest(records)) == (REFUSED, list(refusal))
    assert store.image == old
    assert again(store.memory).image == old


def test_longer_records_are_taken_as_far_as_they_are_known():
    store = Store()
    records = sensor(lib.PARAMS_ACC, 5, more=b"\xff" * 60) + options() + b""
    longer = records[:-3] + b"\x05\x01\x02xyz"
    assert store.change(longer) == OK
    assert store.params.calibration.acc.bias[0] == 5
    assert (store.params.button_does, store.params.reference) == (1, 2)


def test_params_that_this_firmware_refuses_are_told_as_lost_and_kept_in_memory():
    """A set by another firmware, with values that only that firmware knows."""
    store = Store(stored(SMALL))
    bank = BASE + store.bank * BANK
    records = options(9, 9)
    memory = Cells(bytes(store.memory.bytes))
    memory.bytes[bank + 8 : bank + 8 + len(records)] = records
    memory.bytes[bank + 4 : bank + 8] = digest(records).to_bytes(4, "little")
    after = Store(memory)
    assert not after.is_whole
    assert (after.digest, after.image) == (0, NONE)
    assert after.memory.writes == []


def test_a_worn_cell_fails_the_change_and_the_old_params_hold():
    start = stored(SMALL)
    old = Store(start).image
    spare = BASE + (Store(start).bank ^ 1) * BANK
    for at in (0, 1, 5, 8, 20):
        store = again(start)
        store.memory.worn = {spare + at}
        store.memory.bytes[spare + at] = 0xEE  # nothing that a change wants there
        results = set()
        for word in range(0, len(FULL), 4):
            results.add(store.write(word, FULL[word : word + 4]))
            store.settle()
        results.add(store.apply(len(FULL), digest(FULL))[0])
        assert FAILED in results
        assert store.image == old
        assert again(store.memory).image == old


def test_a_failure_is_told_once_and_then_a_change_is_taken_up_again():
    store = again(stored(SMALL))
    spare = BASE + (store.bank ^ 1) * BANK
    store.memory.worn = {spare + 8}
    store.memory.bytes[spare + 8] = 0xEE
    assert store.write(0, FULL[:4]) == lib.RESULT_OK
    store.settle()
    assert store.write(0, FULL[:4]) == FAILED
    store.memory.worn = set()
    store.stage(FULL)
    assert store.apply(len(FULL), digest(FULL))[0] == lib.RESULT_OK
    assert store.records == FULL
