# SPDX-License-Identifier: MIT
"""Settings in two slots: power may go at any byte, a cell may wear out, another build
may have written; what is loaded is whole, valid and the newest there is."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native

ffi, lib = native.load()

SLOT = lib.SETTINGS_SLOT
SIZE = 2 * SLOT
PAYLOAD = ffi.sizeof("struct settings")
STEPS_MAX = 5 * SLOT


class PowerCutError(Exception):
    """The supply went while a byte was being written."""


class Memory:
    """A board's EEPROM: bytes, their wear, and a supply that can be cut."""

    def __init__(self, content: bytes = b"") -> None:
        self.bytes = bytearray(content or b"\xff" * SIZE)
        self.writes: list[int] = []  # offsets, in order
        self.cut_at: int | None = None  # the write that is cut, from 1
        self.left = (0xFF, 0x00, 0x00)  # see LEFT_BEHIND
        self.is_cut = False
        self.busy = 0  # calls of is_ready that say no after a write
        self._wait = 0
        self.worn: set[int] = set()
        read = ffi.callback("uint8_t(void *, uint16_t)", self._read)
        write = ffi.callback("void(void *, uint16_t, uint8_t)", self._write)
        ready = ffi.callback("bool(void *)", self._is_ready)
        self._keep = (read, write, ready)
        self.storage = ffi.new(
            "struct settings_storage *",
            {"read": read, "write": write, "is_ready": ready},
        )

    def _read(self, _: Any, offset: int) -> int:
        assert offset < SIZE
        assert self._wait == 0, "read while a write goes on"
        return self.bytes[offset]

    def _write(self, _: Any, offset: int, value: int) -> None:
        assert offset < SIZE
        assert self._wait == 0, "written while not ready"
        if self.is_cut:
            return
        self.writes.append(offset)
        if len(self.writes) == self.cut_at:
            old_bits, new_bits, flipped = self.left
            self.bytes[offset] = (
                self.bytes[offset] & old_bits ^ value & new_bits ^ flipped
            )
            self.is_cut = True
        elif offset not in self.worn:
            self.bytes[offset] = value
        self._wait = self.busy

    def _is_ready(self, _: Any) -> bool:
        if self._wait:
            self._wait -= 1
            return False
        return True


class Probe:
    """A boot of a probe over its memory: what it remembers, and how it saves."""

    def __init__(self, memory: Memory) -> None:
        self.memory = memory
        self.settings = ffi.new("struct settings *")
        self.writer = ffi.new("struct settings_writer *")
        ffi.buffer(self.writer)[:] = b"\xa5" * ffi.sizeof("struct settings_writer")
        self.loaded = lib.settings_load(memory.storage, self.settings, self.writer)

    @property
    def image(self) -> bytes:
        return bytes(ffi.buffer(self.settings))

    def step(self) -> int:
        return int(lib.settings_step(self.writer, self.memory.storage, self.settings))

    def save(self) -> int:
        """Save to the end, or until the supply is cut."""
        lib.settings_save(self.writer)
        for _ in range(STEPS_MAX * (1 + self.memory.busy)):
            result = self.step()
            if result != lib.SETTINGS_BUSY:
                return result
            if self.memory.is_cut:
                raise PowerCutError
        raise AssertionError("a save without end")

    def change(self, number: int) -> bytes:
        """Set every field to something that depends on the number; return the image."""
        settings = self.settings
        for i in range(8):
            settings.probe_id[i] = (number * 31 + i) & 0xFF
        settings.boot_count = number
        settings.pose_rate_hz = number % 200 + 1
        settings.raw_rate_hz = (number * 7) % 200 + 1
        settings.streams = number % 4
        for sensor in (
            settings.calibration.acc,
            settings.calibration.gyr,
            settings.calibration.mag,
        ):
            for axis in range(3):
                sensor.bias[axis] = (number * 7919 + axis) * 1009 % 250_000_000
                sensor.matrix[axis][axis] = 16_384 + number % 1000
        assert lib.settings_are_valid(settings)
        return self.image


def saved(*numbers: int) -> tuple[Memory, bytes]:
    """Return a memory after saves of these numbers, and the last image."""
    memory = Memory()
    probe = Probe(memory)
    image = b""
    for number in numbers:
        image = probe.change(number)
        assert probe.save() == lib.SETTINGS_OK
    return memory, image


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


# Power goes.

# What a cut leaves of a byte: old & first ^ new & second ^ third.
LEFT_BEHIND = {
    "old value": (0xFF, 0x00, 0x00),
    "new value": (0x00, 0xFF, 0x00),
    "erased": (0x00, 0x00, 0xFF),
    "zero": (0x00, 0x00, 0x00),
    "half erased": (0x0F, 0x00, 0xF0),
    "half written": (0x00, 0xF0, 0x0F),
    "mixed": (0xFF, 0xFF, 0x5A),
    "the mark": (0x00, 0x00, lib.SETTINGS_VERSION),
}


@pytest.mark.parametrize("left", LEFT_BEHIND, ids=str)
@pytest.mark.parametrize("saves", [0, 1, 2, 3])
def test_a_cut_at_any_byte_leaves_the_old_settings_or_the_changed_ones(left, saves):
    memory, old = saved(*range(1, saves + 1))
    before = bytes(memory.bytes)
    probe = Probe(Memory(before))
    probe.change(77)
    probe.save()
    count = len(probe.memory.writes)
    assert count > 20
    for cut_at in range(1, count + 1):
        memory = Memory(before)
        memory.cut_at, memory.left = cut_at, LEFT_BEHIND[left]
        probe = Probe(memory)
        changed = probe.change(77)
        with pytest.raises(PowerCutError):
            probe.save()
        after = Probe(Memory(bytes(memory.bytes)))
        if after.loaded == lib.SETTINGS_NONE:
            assert saves == 0, f"both slots are lost by a cut at write {cut_at}"
            continue
        assert after.image in (old, changed), f"a mixture by a cut at write {cut_at}"
        # And from there on all is as ever.
        last = after.change(99)
        assert after.save() == lib.SETTINGS_OK
        assert Probe(after.memory).image == last


@given(
    cuts=st.lists(
        st.tuples(st.integers(1, 2 * SLOT), st.integers(0, 255)), min_size=1, max_size=8
    )
)
def test_cut_after_cut_nothing_is_lost_that_was_saved(cuts):
    memory, last = saved(1)
    for number, (cut_at, garbage) in enumerate(cuts, 2):
        memory = Memory(bytes(memory.bytes))
        memory.cut_at = cut_at
        memory.left = (0, 0, garbage)
        probe = Probe(memory)
        assert probe.loaded == lib.SETTINGS_OK
        assert probe.image == last
        changed = probe.change(number)
        try:
            assert probe.save() == lib.SETTINGS_OK
            last = changed
        except PowerCutError:
            after = Probe(Memory(bytes(memory.bytes)))
            assert after.loaded == lib.SETTINGS_OK
            assert after.image in (last, changed)
            last = after.image


@pytest.mark.parametrize("saves", [2, 3])
@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_one_spoilt_byte_leaves_one_good_slot(saves, flip):
    memory, newest = saved(*range(1, saves + 1))
    older = saved(*range(1, saves))[1]
    for offset in range(SIZE):
        spoilt = Memory(bytes(memory.bytes))
        spoilt.bytes[offset] ^= flip
        probe = Probe(spoilt)
        assert probe.loaded == lib.SETTINGS_OK, f"byte {offset}"
        is_in_newest = offset // SLOT == (saves - 1) % 2
        assert probe.image == (older if is_in_newest else newest), f"byte {offset}"


def test_all_values_of_one_byte_of_each_header_leave_one_good_slot():
    memory, newest = saved(1, 2)
    older = saved(1)[1]
    for offset in (0, 1, 2, SLOT, SLOT + 1, SLOT + 2):
        for value in range(256):
            spoilt = Memory(bytes(memory.bytes))
            spoilt.bytes[offset] = value
            assert Probe(spoilt).image in (older, newest)


@given(st.binary(min_size=SIZE, max_size=SIZE))
def test_noise_gives_the_defaults(content):
    assert Probe(Memory(content)).loaded == lib.SETTINGS_NONE


# Settings of another build, with a good CRC.


def crc(data: bytes) -> int:
    """CRC-16 of the document: 0x1021, first bit first, from 0xFFFF."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = register << 1 ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def forged(
    payload: bytes, version: int | None = None, length: int | None = None
) -> Memory:
    header = bytes(
        [
            lib.SETTINGS_VERSION if version is None else version,
            PAYLOAD if length is None else length,
            9,
        ]
    )
    slot = header + payload + crc(header + payload).to_bytes(2, "little")
    return Memory((slot + b"\xff" * SIZE)[:SIZE])


def test_a_slot_is_laid_out_as_documented():
    _, image = saved(3)
    probe = Probe(forged(image))
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == image


@pytest.mark.parametrize(("version", "length"), [(0, None), (2, None), (255, None),
                                                 (None, 0), (None, PAYLOAD - 1),
                                                 (None, PAYLOAD + 1)])  # fmt: skip
def test_another_version_or_length_is_refused(version, length):
    image = saved(3)[1]
    assert Probe(forged(image, version, length)).loaded == lib.SETTINGS_NONE


def spoil_calibration(settings: Any) -> None:
    settings.calibration.mag.matrix[2][0] = 32_767
    settings.calibration.mag.matrix[2][1] = 32_767


@pytest.mark.parametrize(
    "spoil",
    [
        lambda settings: setattr(settings, "pose_rate_hz", 0),
        lambda settings: setattr(settings, "pose_rate_hz", 1001),
        lambda settings: setattr(settings, "raw_rate_hz", 0),
        lambda settings: setattr(settings, "raw_rate_hz", 65535),
        lambda settings: setattr(settings, "streams", 4),
        spoil_calibration,
    ],
)
def test_values_out_of_range_are_refused_and_the_older_slot_taken(spoil):
    memory = Memory()
    probe = Probe(memory)
    good = probe.change(1)
    assert probe.save() == lib.SETTINGS_OK
    spoil(probe.settings)
    assert not lib.settings_are_valid(probe.settings)
    assert probe.save() == lib.SETTINGS_OK
    probe = Probe(memory)
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == good
    # The refused slot is the next to be written.
    last = probe.change(2)
    assert probe.save() == lib.SETTINGS_OK
    assert Probe(memory).image == last


@pytest.mark.parametrize("rate", [1, 1000])
def test_rates_at_their_limits_are_valid(rate):
    probe = Probe(Memory())
    probe.settings.pose_rate_hz = probe.settings.raw_rate_hz = rate
    assert lib.settings_are_valid(probe.settings)


# Changes while a save goes on.


def test_a_change_at_any_step_of_a_save_is_in_the_memory_at_its_end():
    memory, _ = saved(1)
    before = bytes(memory.bytes)
    probe = Probe(Memory(before))
    probe.change(2)
    lib.settings_save(probe.writer)
    steps = 1
    while probe.step() == lib.SETTINGS_BUSY:
        steps += 1
    for at in range(steps):
        memory = Memory(before)
        probe = Probe(memory)
        probe.change(2)
        lib.settings_save(probe.writer)
        for _ in range(at):
            assert probe.step() == lib.SETTINGS_BUSY
        image = probe.change(3)
        assert probe.save() == lib.SETTINGS_OK
        assert Probe(memory).image == image, f"changed after step {at}"


def test_asking_again_while_a_save_goes_on_wears_nothing():
    plain, _ = saved(1, 2)
    plain.writes.clear()
    memory = Memory(bytes(plain.bytes))
    probe = Probe(plain)
    probe.change(3)
    assert probe.save() == lib.SETTINGS_OK
    probe = Probe(memory)
    image = probe.change(3)
    lib.settings_save(probe.writer)
    while (result := probe.step()) == lib.SETTINGS_BUSY:
        lib.settings_save(probe.writer)
    assert result == lib.SETTINGS_OK
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


# Memory that wears out.


@pytest.mark.parametrize("offset", [0, 1, 2, 3, 10, SLOT - 2, SLOT - 1])
def test_a_worn_cell_is_a_failure_and_the_other_slot_stays_good(offset):
    memory, image = saved(1)
    memory.worn = {SLOT + offset}
    memory.bytes[SLOT + offset] = 0xFE  # nothing that a save wants there
    probe = Probe(memory)
    changed = probe.change(2)
    memory.writes.clear()
    assert probe.save() == lib.SETTINGS_FAILED
    assert memory.writes.count(SLOT + offset) == 3
    assert Probe(memory).image == image
    # It stays a failure, and one that ends; a cell that works again is used again.
    assert probe.save() == lib.SETTINGS_FAILED
    memory.worn = set()
    assert probe.save() == lib.SETTINGS_OK
    assert Probe(memory).image == changed


def test_a_mark_that_cannot_be_blanked_is_a_failure_and_keeps_what_is_there():
    memory, image = saved(1, 2)
    memory.worn = {0}
    probe = Probe(memory)
    probe.change(3)
    assert probe.save() == lib.SETTINGS_FAILED
    assert Probe(memory).image == image


def test_a_cell_that_takes_the_third_write_is_good_enough():
    memory, _ = saved(1)
    memory.worn = {SLOT + 20}
    memory.bytes[SLOT + 20] = 0xFE
    probe = Probe(memory)
    image = probe.change(2)
    lib.settings_save(probe.writer)
    while memory.writes.count(SLOT + 20) < 2:
        assert probe.step() == lib.SETTINGS_BUSY
    memory.worn = set()
    while (result := probe.step()) == lib.SETTINGS_BUSY:
        pass
    assert result == lib.SETTINGS_OK
    assert Probe(memory).image == image
