# SPDX-License-Identifier: MIT
"""Settings in a memory: saved, loaded, kept apart from the id."""

from __future__ import annotations

import pytest

from core.settings_desk import BANK, BANKS, ID, SIZE, Memory, Probe, lib, saved


def banks_of(memory: Memory) -> set[int]:
    """The banks that were written to."""
    return {(offset - BANKS) // BANK for offset in memory.writes if offset >= BANKS}


@pytest.mark.parametrize("filler", [0x00, 0x01, 0x55, 0xB2, 0xFF])
def test_a_memory_of_one_value_gives_the_defaults(filler):
    probe = Probe(Memory(bytes([filler]) * SIZE))
    assert probe.loaded == lib.SETTINGS_NONE
    settings = probe.settings
    assert bytes(settings.probe_id) == bytes(8)
    assert settings.boot_count == 0
    assert (settings.pose_rate_hz, settings.raw_rate_hz) == (100, 200)
    assert settings.streams == lib.STREAM_POSE


@pytest.mark.parametrize("saves", range(1, 6))
def test_the_last_save_is_what_is_loaded(saves):
    memory, image = saved(*range(1, saves + 1))
    probe = Probe(memory)
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == image


def test_saves_over_many_boots_go_to_the_banks_in_turn():
    memory = Memory()
    turns = []
    for boot in range(600):  # the sequence of 8 bits wraps twice
        probe = Probe(memory)
        assert probe.loaded == (lib.SETTINGS_OK if boot else lib.SETTINGS_NONE)
        assert probe.settings.boot_count == boot
        probe.settings.boot_count += 1
        memory.writes.clear()
        assert probe.save() == lib.MEMORY_OK
        (bank,) = banks_of(memory)
        turns.append(bank)
    assert turns == [turns[0], turns[1]] * 300
    assert turns[0] != turns[1]


def test_the_id_is_written_once_in_two_copies_and_never_again():
    memory, _ = saved(1)
    apart = [offset for offset in memory.writes if offset < BANKS]
    assert apart == list(range(lib.MEMORY_IDENTITY, lib.MEMORY_IDENTITY + 20))
    memory.writes.clear()
    for boot in range(2, 50):
        probe = Probe(memory)
        probe.change(boot)
        assert probe.save() == lib.MEMORY_OK
    assert min(memory.writes) >= BANKS


@pytest.mark.parametrize("copy", [0, 1])
def test_one_good_copy_of_the_id_is_enough_and_the_other_is_mended(copy):
    memory, image = saved(1)
    for i in range(10):
        memory.bytes[lib.MEMORY_IDENTITY + 10 * copy + i] ^= 0x5A
    whole = bytes(saved(1)[0].bytes)
    probe = Probe(memory)
    assert probe.image == image
    assert probe.save() == lib.MEMORY_OK
    at = slice(lib.MEMORY_IDENTITY, lib.MEMORY_IDENTITY + 20)
    assert bytes(memory.bytes)[at] == whole[at]


def test_settings_that_are_lost_do_not_take_the_id_with_them():
    memory, _ = saved(1, 2)
    memory.bytes[BANKS:] = b"\xff" * (SIZE - BANKS)
    probe = Probe(memory)
    assert probe.loaded == lib.SETTINGS_NONE
    assert bytes(probe.settings.probe_id) == ID


def test_a_boot_wears_a_cell_at_most_once():
    memory, _ = saved(1, 2)
    for boot in range(3, 203):
        probe = Probe(memory)
        probe.settings.boot_count = boot
        memory.writes.clear()
        assert probe.save() == lib.MEMORY_OK
        if boot < 5:
            continue  # what the two banks were filled with differs more
        # Mark, sequence, CRC, boot count, mark; the mark's cell twice, but only in
        # every other boot.
        assert len(memory.writes) <= 9
        assert max(map(memory.writes.count, memory.writes)) <= 2


def test_nothing_is_written_before_a_save_is_asked_for():
    memory, _ = saved(1)
    memory.writes.clear()
    probe = Probe(memory)
    probe.change(2)
    assert [probe.step() for _ in range(50)] == [lib.MEMORY_OK] * 50
    assert memory.writes == []


def test_a_step_writes_one_byte_at_most():
    memory = Memory()
    memory.busy = 3
    probe = Probe(memory)
    image = probe.change(5)
    lib.settings_save(probe.writer)
    result = lib.MEMORY_BUSY
    while result == lib.MEMORY_BUSY:
        before = len(memory.writes)
        result = probe.step()
        assert len(memory.writes) - before <= 1
    assert result == lib.MEMORY_OK
    memory.busy = 0
    assert Probe(memory).image == image
