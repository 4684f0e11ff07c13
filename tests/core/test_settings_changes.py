# SPDX-License-Identifier: MIT
"""Settings that change during a save, and memory that wears out."""

from __future__ import annotations

import pytest

from core.settings_desk import (
    BANK,
    BANKS,
    LEFT_BEHIND,
    Memory,
    PowerCutError,
    Probe,
    lib,
    saved,
)


def test_a_change_at_any_step_of_a_save_is_in_the_memory_at_its_end():
    memory, _ = saved(1)
    before = bytes(memory.bytes)
    probe = Probe(Memory(before))
    probe.change(2)
    lib.settings_save(probe.writer)
    steps = 1
    while probe.step() == lib.MEMORY_BUSY:
        steps += 1
    for at in range(steps):
        memory = Memory(before)
        probe = Probe(memory)
        probe.change(2)
        lib.settings_save(probe.writer)
        for _ in range(at):
            assert probe.step() == lib.MEMORY_BUSY
        image = probe.change(3)
        assert probe.save() == lib.MEMORY_OK
        assert Probe(memory).image == image, f"changed after step {at}"


def test_asking_again_while_a_save_goes_on_wears_nothing():
    plain, _ = saved(1, 2)
    plain.writes.clear()
    memory = Memory(bytes(plain.bytes))
    probe = Probe(plain)
    probe.change(3)
    assert probe.save() == lib.MEMORY_OK
    probe = Probe(memory)
    image = probe.change(3)
    lib.settings_save(probe.writer)
    while (result := probe.step()) == lib.MEMORY_BUSY:
        lib.settings_save(probe.writer)
    assert result == lib.MEMORY_OK
    assert memory.writes == plain.writes
    assert Probe(memory).image == image


@pytest.mark.parametrize("left", ["old value", "erased", "mixed"])
def test_a_cut_after_a_change_during_a_save_leaves_no_mixture(left):
    memory, first = saved(1)
    before = bytes(memory.bytes)
    for at in range(0, 70, 7):
        for cut_at in range(1, 100, 3):
            memory = Memory(before)
            memory.cut_at, memory.left = cut_at, LEFT_BEHIND[left]
            probe = Probe(memory)
            second = probe.change(2)
            lib.settings_save(probe.writer)
            for _ in range(at):
                probe.step()
            third = probe.change(3)
            try:
                probe.save()
            except PowerCutError:
                after = Probe(Memory(bytes(memory.bytes)))
                assert after.loaded == lib.SETTINGS_OK
                assert after.image in (first, second, third)


@pytest.mark.parametrize("at", [0, 1, 2, 3, 4, 7, 8, 10, 20])
def test_a_worn_cell_is_a_failure_and_the_other_bank_stays_good(at):
    memory, image = saved(1)
    cell = BANKS + at  # the first save went to the other bank
    memory.worn = {cell}
    memory.bytes[cell] = 0xFE  # nothing that a save wants there
    probe = Probe(memory)
    changed = probe.change(2)
    memory.writes.clear()
    assert probe.save() == lib.MEMORY_FAILED
    assert memory.writes.count(cell) == 3
    assert Probe(memory).image == image
    # It stays a failure, and one that ends; a cell that works again is used again.
    assert probe.save() == lib.MEMORY_FAILED
    memory.worn = set()
    assert probe.save() == lib.MEMORY_OK
    assert Probe(memory).image == changed


def test_a_mark_that_cannot_be_blanked_is_a_failure_and_keeps_what_is_there():
    memory, image = saved(1, 2)
    memory.worn = {BANKS, BANKS + BANK}
    probe = Probe(memory)
    probe.change(3)
    assert probe.save() == lib.MEMORY_FAILED
    assert Probe(memory).image == image


def test_a_worn_cell_of_the_id_is_a_failure_and_its_other_copy_good():
    memory = Memory()
    memory.worn = {lib.MEMORY_IDENTITY + 3}
    probe = Probe(memory)
    image = probe.change(1)
    assert probe.save() == lib.MEMORY_FAILED
    assert Probe(memory).loaded == lib.SETTINGS_NONE
    memory.worn = set()
    assert probe.save() == lib.MEMORY_OK
    memory.bytes[lib.MEMORY_IDENTITY + 3] ^= 0xFF
    assert Probe(memory).image == image


def test_a_cell_that_takes_the_third_write_is_good_enough():
    memory, _ = saved(1)
    cell = BANKS + 12
    memory.worn = {cell}
    memory.bytes[cell] = 0xFE
    probe = Probe(memory)
    image = probe.change(2)
    lib.settings_save(probe.writer)
    while memory.writes.count(cell) < 2:
        assert probe.step() == lib.MEMORY_BUSY
    memory.worn = set()
    while (result := probe.step()) == lib.MEMORY_BUSY:
        pass
    assert result == lib.MEMORY_OK
    assert Probe(memory).image == image
