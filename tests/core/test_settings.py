# SPDX-License-Identifier: MIT
"""Settings in a memory: saved, loaded, refused where they make no sense."""

from __future__ import annotations

import pytest

from core.settings_desk import SIZE, SLOT, Memory, Probe, ffi, lib, saved


def test_an_erased_memory_gives_the_defaults():
    probe = Probe(Memory())
    assert probe.loaded == lib.SETTINGS_NONE
    settings = probe.settings
    assert bytes(settings.probe_id) == bytes(8)
    assert settings.boot_count == 0
    assert (settings.pose_rate_hz, settings.raw_rate_hz) == (100, 200)
    assert settings.streams == lib.STREAM_POSE
    assert lib.settings_are_valid(settings)
    identity = ffi.new("struct calibration *")
    lib.calibration_clear(identity)
    calibration = ffi.addressof(settings[0], "calibration")
    assert bytes(ffi.buffer(calibration)) == bytes(ffi.buffer(identity))


@pytest.mark.parametrize("filler", [0x00, 0x01, 0x55, 0xFF])
def test_a_memory_of_one_value_gives_the_defaults(filler):
    assert Probe(Memory(bytes([filler]) * SIZE)).loaded == lib.SETTINGS_NONE


@pytest.mark.parametrize("saves", range(1, 6))
def test_the_last_save_is_what_is_loaded(saves):
    memory, image = saved(*range(1, saves + 1))
    probe = Probe(memory)
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == image


def test_saves_over_many_boots_go_to_the_slots_in_turn():
    memory = Memory()
    for boot in range(600):  # the sequence of 8 bits wraps twice
        probe = Probe(memory)
        assert probe.loaded == (lib.SETTINGS_OK if boot else lib.SETTINGS_NONE)
        assert probe.settings.boot_count == boot
        probe.settings.boot_count += 1
        memory.writes.clear()
        assert probe.save() == lib.SETTINGS_OK
        slots = {offset // SLOT for offset in memory.writes}
        assert slots == {boot % 2}


def test_only_bytes_that_differ_are_written():
    memory, _ = saved(1, 2)
    probe = Probe(memory)
    probe.settings.boot_count = 1000  # 0x03E8
    memory.writes.clear()
    assert probe.save() == lib.SETTINGS_OK
    # Marks off and on, sequence, what differs from the save before last, CRC.
    offsets = [offset % SLOT for offset in memory.writes]
    assert offsets[0] == 0
    assert offsets[-1] == 0
    assert len(offsets) == len(set(offsets)) + 1
    memory.writes.clear()
    assert probe.save() == lib.SETTINGS_OK
    first = len(memory.writes)
    memory.writes.clear()
    probe.settings.boot_count = 1001  # one byte more than the sequence and the CRC
    assert probe.save() == lib.SETTINGS_OK
    assert len(memory.writes) <= 6 <= first


def test_nothing_is_written_before_a_save_is_asked_for():
    memory, _ = saved(1)
    memory.writes.clear()
    probe = Probe(memory)
    probe.change(2)
    assert [probe.step() for _ in range(50)] == [lib.SETTINGS_OK] * 50
    assert memory.writes == []


def test_a_step_writes_one_byte_at_most_and_only_when_ready():
    memory = Memory()
    memory.busy = 3
    probe = Probe(memory)
    image = probe.change(5)
    lib.settings_save(probe.writer)
    result = lib.SETTINGS_BUSY
    while result == lib.SETTINGS_BUSY:
        before = len(memory.writes)
        result = probe.step()
        assert len(memory.writes) - before <= 1
    assert result == lib.SETTINGS_OK
    assert Probe(memory).image == image
