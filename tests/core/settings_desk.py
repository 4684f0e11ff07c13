# SPDX-License-Identifier: MIT
"""A memory of bytes that power can be cut from, and the settings on it."""

from __future__ import annotations

from typing import Any

import native

ffi, lib = native.load()
SIZE = lib.MEMORY_SIZE
BANK = lib.MEMORY_SETTINGS_BANK
BANKS = lib.MEMORY_SETTINGS
# Where a save may write: identity and banks.
PLACES = range(lib.MEMORY_IDENTITY, BANKS + 2 * BANK)
STEPS_MAX = 5 * len(PLACES)


ID = bytes.fromhex("a1b2c3d4e5f60718")


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
            "struct memory *",
            {"read": read, "write": write, "is_ready": ready},
        )

    def _read(self, _: Any, offset: int) -> int:
        assert offset < SIZE
        assert self._wait == 0, "read during a write"
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
        """One step, as a probe takes it: only when the memory is ready."""
        if not self.memory.storage.is_ready(ffi.NULL):
            return int(lib.MEMORY_BUSY)
        return int(lib.settings_step(self.writer, self.settings))

    def save(self) -> int:
        """Save to the end, or until the supply is cut."""
        lib.settings_save(self.writer)
        for _ in range(STEPS_MAX * (1 + self.memory.busy)):
            result = self.step()
            if result != lib.MEMORY_BUSY:
                return result
            if self.memory.is_cut:
                raise PowerCutError
        raise AssertionError("a save without end")

    def change(self, number: int) -> bytes:
        """Set every field to something that depends on the number, but for the id,
        which a probe has for life; return the image.
        """
        settings = self.settings
        ffi.memmove(settings.probe_id, ID, len(ID))
        settings.boot_count = number
        settings.pose_rate_hz = number % 200 + 1
        settings.raw_rate_hz = (number * 7) % 200 + 1
        settings.own_field.axis = [number, -number, 3 * number]
        settings.own_field.sigma = number % 40
        settings.own_calibration = number * 257
        settings.streams = number % 4
        return self.image


def saved(*numbers: int) -> tuple[Memory, bytes]:
    """Return a memory after saves of these numbers, and the last image."""
    memory = Memory()
    probe = Probe(memory)
    image = b""
    for number in numbers:
        image = probe.change(number)
        assert probe.save() == lib.MEMORY_OK
    return memory, image


# What a cut leaves of a byte: old & first ^ new & second ^ third.
LEFT_BEHIND = {
    "old value": (0xFF, 0x00, 0x00),
    "new value": (0x00, 0xFF, 0x00),
    "erased": (0x00, 0x00, 0xFF),
    "zero": (0x00, 0x00, 0x00),
    "half erased": (0x0F, 0x00, 0xF0),
    "half written": (0x00, 0xF0, 0x0F),
    "mixed": (0xFF, 0xFF, 0x5A),
    "the mark": (0x00, 0x00, 0xB2),
}
