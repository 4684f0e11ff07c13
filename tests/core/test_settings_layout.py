# SPDX-License-Identifier: MIT
"""The layout of the settings in memory, what is refused in a good bank, what other
firmware leaves there, and the form that the first firmware gave them.
"""

from __future__ import annotations

import struct
import zlib

import pytest

from core.settings_desk import BANK, BANKS, ID, SIZE, Memory, Probe, ffi, lib, saved

BOOTS, RATES, OWN, STREAMS = (
    b"\x01\x02\x03\x00",
    b"\x02\x04\x0a\x00\x14\x00",
    b"\x04\x0a\x50\x00\xd8\xff\x0c\x00\x08\x00\xcd\xab",
    b"\x03\x01\x02",
)
GOOD = BOOTS + RATES + OWN + STREAMS


def crc(data: bytes) -> int:
    """CRC-16 of the document: 0x1021, first bit first, from 0xFFFF."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = register << 1 ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def forged(records: bytes, sequence: int = 9) -> Memory:
    """A memory with an id and one good bank."""
    head = bytes([sequence ^ 0xB2, sequence]) + len(records).to_bytes(2, "little")
    bank = head + zlib.crc32(records).to_bytes(4, "little") + records
    memory = Memory()
    memory.bytes[BANKS : BANKS + len(bank)] = bank
    identity = ID + crc(ID).to_bytes(2, "big")
    at = lib.MEMORY_IDENTITY
    memory.bytes[at : at + 2 * len(identity)] = 2 * identity
    return memory


def records_of(memory: Memory) -> bytes:
    """The content of the newer bank, which is the last one written."""
    last = max(i for i, at in enumerate(memory.writes) if at >= BANKS)
    bank = (memory.writes[last] - BANKS) // BANK
    start = BANKS + bank * BANK
    length = int.from_bytes(memory.bytes[start + 2 : start + 4], "little")
    content = start + lib.BANK_HEADER
    return bytes(memory.bytes[content : content + length])


def test_a_bank_is_laid_out_as_documented():
    probe = Probe(forged(GOOD))
    assert probe.loaded == lib.SETTINGS_OK
    settings = probe.settings
    assert bytes(settings.probe_id) == ID
    assert (settings.boot_count, settings.streams) == (3, 2)
    assert (settings.pose_rate_hz, settings.raw_rate_hz) == (10, 20)
    assert list(settings.own_field.axis) == [80, -40, 12]
    assert (settings.own_field.sigma, settings.own_calibration) == (8, 0xABCD)


def test_a_save_is_laid_out_as_documented():
    memory = forged(GOOD)
    probe = Probe(memory)
    probe.settings.boot_count = 0x1234
    assert probe.save() == lib.MEMORY_OK
    assert records_of(memory) == b"\x01\x02\x34\x12" + RATES + OWN + STREAMS


@pytest.mark.parametrize(
    "records",
    [
        BOOTS + b"\x02\x04\x00\x00\x14\x00" + STREAMS,
        BOOTS + b"\x02\x04\xe9\x03\x14\x00" + STREAMS,
        BOOTS + b"\x02\x04\x0a\x00\x00\x00" + STREAMS,
        BOOTS + b"\x02\x04\x0a\x00\xff\xff" + STREAMS,
        BOOTS + RATES + b"\x03\x01\x04",
    ],
)
def test_values_out_of_range_give_the_defaults_but_keep_the_id(records):
    probe = Probe(forged(records))
    assert probe.loaded == lib.SETTINGS_NONE
    assert bytes(probe.settings.probe_id) == ID
    assert probe.settings.pose_rate_hz == 100


@pytest.mark.parametrize("rate", [1, 1000])
def test_rates_at_their_limits_are_valid(rate):
    rates = b"\x02\x04" + 2 * rate.to_bytes(2, "little")
    probe = Probe(forged(BOOTS + rates + STREAMS))
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.settings.pose_rate_hz == rate


@pytest.mark.parametrize(
    "records",
    [b"", b"\x01", BOOTS, GOOD[:-1], GOOD + b"\x09", GOOD + b"\x09\xff", b"\x00\x00"],
)
def test_a_torn_or_partial_list_is_read_as_far_as_it_goes(records):
    probe = Probe(forged(records))
    assert bytes(probe.settings.probe_id) == ID
    assert probe.settings.boot_count in (0, 3)
    assert probe.save() == lib.MEMORY_OK
    again = Probe(Memory(bytes(probe.memory.bytes)))
    assert again.loaded == lib.SETTINGS_OK
    assert again.image == probe.image


FOREIGN = b"\x07\x03abc", b"\xc8\x00", b"\x55\x05vwxyz"


@pytest.mark.parametrize(
    "records",
    [
        FOREIGN[0] + GOOD + FOREIGN[1] + FOREIGN[2],
        BOOTS + FOREIGN[0] + RATES + FOREIGN[1] + STREAMS + FOREIGN[2],
        FOREIGN[0] + FOREIGN[1] + FOREIGN[2] + STREAMS + BOOTS,
        FOREIGN[0] + BOOTS + RATES + STREAMS + FOREIGN[1] + FOREIGN[2],
    ],
)
def test_records_of_other_firmware_are_kept_over_many_saves(records):
    memory = forged(records)
    for boot in range(4, 20):
        probe = Probe(memory)
        probe.settings.boot_count = boot
        assert probe.save() == lib.MEMORY_OK
        kept = records_of(memory)
        assert kept[len(GOOD) :] == b"".join(FOREIGN)
        assert kept[:4] == b"\x01\x02" + boot.to_bytes(2, "little")


def test_more_foreign_records_than_there_is_room_for_leave_ours_good():
    room = BANK - lib.BANK_HEADER
    memory = forged(b"\x09" + bytes([room - 2]) + b"x" * (room - 2))
    probe = Probe(memory)
    probe.settings.boot_count = 77
    assert probe.save() == lib.MEMORY_OK
    assert Probe(memory).settings.boot_count == 77


# The first firmware's form.


def first_slot(number: int, sequence: int) -> bytes:
    """A slot as the first firmware wrote it on this processor."""
    payload = ID + struct.pack("<HHHB", number, 50, 150, 3)
    payload += b"\0" * (-len(payload) % 4) + bytes(
        3 * ffi.sizeof("struct calibration_of_sensor")
    )
    whole = bytes([1, len(payload), sequence]) + payload
    return whole + crc(whole).to_bytes(2, "little")


@pytest.mark.parametrize("sequence", [0, 7, 254, 255])
def test_settings_of_the_first_firmware_are_taken_over_and_left_in_place(sequence):
    older, newer = (
        first_slot(41, sequence),
        first_slot(42, (sequence + 1) % 256),
    )
    for slots in (older + newer, newer + older):
        # Which slot is the newer is told by being one ahead of the other.
        memory = Memory((slots + b"\xff" * SIZE)[:SIZE])
        probe = Probe(memory)
        assert probe.loaded == lib.SETTINGS_OK
        assert bytes(probe.settings.probe_id) == ID
        assert probe.settings.boot_count == 42
        assert (probe.settings.pose_rate_hz, probe.settings.raw_rate_hz) == (50, 150)
        assert probe.settings.streams == lib.STREAM_POSE | lib.STREAM_RAW
        assert probe.save() == lib.MEMORY_OK
        # Downgraded, the first firmware finds what it left, and its id.
        assert bytes(memory.bytes[: len(slots)]) == slots
        assert min(memory.writes) >= lib.MEMORY_IDENTITY
        assert Probe(memory).image == probe.image


@pytest.mark.parametrize("at", [0, 1])
def test_a_slot_of_the_first_form_that_was_being_written_leaves_the_other(at):
    older, newer = first_slot(41, 3), first_slot(42, 4)
    content = bytearray((older + newer + b"\xff" * SIZE)[:SIZE])
    content[len(older) + at] ^= 0x10
    probe = Probe(Memory(bytes(content)))
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.settings.boot_count == 41


def test_settings_of_this_firmware_go_before_those_of_the_first():
    memory, image = saved(5)
    memory.bytes[: 2 * len(first_slot(1, 1))] = first_slot(1, 1) + first_slot(2, 2)
    assert Probe(memory).image == image
