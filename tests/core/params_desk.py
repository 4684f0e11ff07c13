# SPDX-License-Identifier: MIT
"""Params in a memory that power can be cut from, and hosts that change them."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from core.settings_desk import Memory as Cells
from core.settings_desk import PowerCutError, ffi, lib

ONE = 16384
ROOM = lib.PARAMS_ROOM
BASE = lib.MEMORY_PARAMS
BANK = lib.MEMORY_PARAMS_BANK
STEPS_MAX = 20 * ROOM


def sensor(tag: int, bias: int = 0, diagonal: int = ONE, more: bytes = b"") -> bytes:
    """A record of a sensor's calibration."""
    matrix = [
        diagonal if row == column else 0 for row in range(3) for column in range(3)
    ]
    values = struct.pack("<3i9h", bias, -bias, 0, *matrix) + (more or b"\xff" * 9)
    return bytes([tag, len(values)]) + values


def options(button: int = 0, reference: int = 0) -> bytes:
    return bytes([lib.PARAMS_OPTIONS, 2, button, reference])


ACC, GYR, MAG = (
    sensor(lib.PARAMS_ACC, 12345),
    sensor(lib.PARAMS_GYR, -777, ONE + 160),
    sensor(lib.PARAMS_MAG, 1_000_000, ONE - 99, b"\x12" * 15),
)
TIP = bytes([lib.PARAMS_TIP, 23]) + bytes(range(23))
FOREIGN = b"\x63\x05other"
FULL = ACC + GYR + MAG + TIP + options(1, 2) + FOREIGN
SMALL = options(0, 1)


def signed(number: int) -> int:
    return number - 2**32 if number >= 2**31 else number


def digest(records: bytes) -> int:
    return zlib.crc32(records)


class Store:
    """A boot over a memory: the params in force, and how they change."""

    def __init__(self, memory: Cells | None = None) -> None:
        self.memory = memory or Cells()
        self.c = ffi.new("struct params_store *")
        self.params = ffi.new("struct params *")
        ffi.buffer(self.c)[:] = b"\xa5" * ffi.sizeof("struct params_store")
        self.is_whole = bool(
            lib.params_store_open(self.c, self.memory.storage, self.params)
        )
        self.told: list[tuple[int, bytes]] = []
        self.changes = 0

    @property
    def image(self) -> bytes:
        """The values in force."""
        return bytes(ffi.buffer(self.params))

    @property
    def bank(self) -> int:
        """The bank that is current: 0 or 1."""
        return int(self.c.bank.content[lib.BANK_CURRENT] >= BASE + BANK)

    @property
    def digest(self) -> int:
        return int(self.c.bank.list.digest)

    @property
    def records(self) -> bytes:
        return self._read(lib.BANK_CURRENT, self.c.bank.list.length)

    def _read(self, side: int, length: int) -> bytes:
        part = ffi.new("uint8_t[]", lib.PARAMS_PART)
        read = b""
        for at in range(0, length, lib.PARAMS_PART):
            lib.params_store_part(self.c, side, length, at, part)
            read += bytes(part)
        return read[:length]

    def step(self) -> int:
        if not self.memory.storage.is_ready(ffi.NULL):
            return int(lib.PARAMS_WORKS)
        before = len(self.memory.writes)
        done = int(lib.params_store_step(self.c))
        assert len(self.memory.writes) - before <= 1
        if done == lib.PARAMS_TELLS:
            part = ffi.new("uint8_t[]", lib.PARAMS_PART)
            length, at = self.c.asked.length, self.c.told
            lib.params_store_part(self.c, lib.BANK_SPARE, length, at, part)
            self.told.append((at, bytes(part)))
        if done == lib.PARAMS_CHANGED:
            self.changes += 1
            assert lib.params_store_load(self.c, self.params)
        return done

    def settle(self) -> None:
        """Steps until there is nothing to do; raises PowerCutError on the way."""
        for _ in range(STEPS_MAX):
            if self.step() == lib.PARAMS_IDLE:
                return
            if self.memory.is_cut:
                raise PowerCutError
        raise AssertionError("steps without end")

    def write(self, at: int, word: bytes) -> int:
        value = int.from_bytes(word.ljust(4, b"\0"), "little", signed=True)
        return int(lib.params_store_write(self.c, at, value))

    def stage(self, records: bytes) -> None:
        for at in range(0, len(records), 4):
            assert self.write(at, records[at : at + 4]) == lib.RESULT_OK
            self.settle()

    def ask(self, length: int, sum_of: int) -> tuple[int, list[int]]:
        value = ffi.new("int32_t[2]", [length, signed(sum_of)])
        result = int(lib.params_store_apply(self.c, value))
        assert result == lib.RESULT_REFUSED or list(value) == [length, signed(sum_of)]
        return result, list(value)

    def apply(self, length: int, sum_of: int) -> tuple[int, list[int]]:
        """Asks until it is known."""
        for _ in range(STEPS_MAX):
            result, refusal = self.ask(length, sum_of)
            if result != lib.RESULT_BUSY:
                return result, refusal
            self.settle()
        raise AssertionError("busy without end")

    def change(self, records: bytes) -> int:
        self.stage(records)
        return self.apply(len(records), digest(records))[0]


def stored(*sets: bytes) -> Cells:
    """A memory after these changes."""
    store = Store()
    for records in sets:
        assert store.change(records) == lib.RESULT_OK
    return store.memory


def values_of(records: bytes) -> bytes:
    """The values that a probe with these records has in force."""
    return Store(stored(records)).image


def again(memory: Any) -> Store:
    """A boot over what a memory holds."""
    return Store(Cells(bytes(memory.bytes)))
