# SPDX-License-Identifier: MIT
"""The settings' journal over a model of flash: bits go from 1 to 0 one word at a time,
back to 1 a sector at a time, and power may go in the middle of either."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native

pytestmark = pytest.mark.sampled(3)

ffi, lib = native.load()

WORDS = 4 * lib.JOURNAL_BYTES
BLANK = 0xFFFFFFFF
FRESH = bytes([lib.JOURNAL_ERASED]) * lib.JOURNAL_BYTES


def header(generation: int) -> int:
    """A sector's first word: mark, generation, and how many of their bits are 0."""
    data = generation << 8 | 0xA5
    return (24 - data.bit_count()) << 24 | data


class Flash:
    """Two sectors; `cut_at` says in which operation, from 1, power goes."""

    def __init__(self, seed: int = 0) -> None:
        self.random = random.Random(seed)  # noqa: S311, no secret
        self.sectors = [[BLANK] * WORDS, [BLANK] * WORDS]
        self.operations: list[str] = []
        self.cut_at: int | None = None
        self.is_dead = False
        self.is_off = False
        read = ffi.callback("uint32_t(uint8_t, uint32_t)", self._read)
        program = ffi.callback("void(uint8_t, uint32_t, uint32_t)", self._program)
        erase = ffi.callback("void(uint8_t)", self._erase)
        self._keep = (read, program, erase)
        self.seam = ffi.new(
            "struct journal_flash *",
            {"words": WORDS, "read": read, "program": program, "erase": erase},
        )

    def _read(self, sector: int, word: int) -> int:
        assert word < WORDS
        return self.sectors[sector][word]

    def _begins(self, what: str) -> bool:
        """Return whether the operation goes through; None of it does without power."""
        if self.is_off or self.is_dead:
            return False
        self.operations.append(what)
        self.is_off = len(self.operations) == self.cut_at
        return True

    def _program(self, sector: int, word: int, value: int) -> None:
        assert word < WORDS
        if not self._begins("program"):
            return
        assert self.sectors[sector][word] == BLANK, "programmed twice"
        late = self.random.getrandbits(32) if self.is_off else 0
        self.sectors[sector][word] = value | late

    def _erase(self, sector: int) -> None:
        if not self._begins("erase"):
            return
        words = self.sectors[sector]
        if self.is_off:
            share = self.random.choice((0, 1, 2))
            for at in range(self.random.randrange(WORDS + 1)):
                words[at] |= (BLANK, self.random.getrandbits(32), 0)[share]
        else:
            words[:] = [BLANK] * WORDS

    def open(self) -> Any:
        """Power comes back permanently."""
        self.is_off, self.cut_at = False, None
        return self.opened()

    def opened(self) -> Any:
        journal = ffi.new("struct journal *")
        lib.journal_open(journal, self.seam)
        return journal


def content(journal: Any) -> bytes:
    return bytes(journal.bytes)


def fill(journal: Any, free: int) -> bytes:
    """Write until `free` words are left."""
    while journal.next < WORDS - free:
        lib.journal_write(journal, journal.next % 40, journal.next % 251)
    return content(journal)


def test_a_fresh_flash_is_erased_bytes():
    assert content(Flash().open()) == FRESH


def test_flash_that_is_blank_is_not_erased_and_any_other_is():
    flash = Flash()
    flash.open()
    assert flash.operations == ["program"]
    for place in (0, 1, WORDS - 1):
        flash = Flash()
        flash.sectors[0][place] &= ~1
        assert content(flash.open()) == FRESH
        assert flash.operations == ["erase", "program"]


offsets = st.one_of(st.integers(0, lib.JOURNAL_BYTES - 1), st.just(511), st.just(0))
writes = st.lists(st.tuples(offsets, st.integers(0, 255)), max_size=50)


@given(writes)
def test_what_was_written_is_there_when_opened_again(pairs):
    flash, expected = Flash(), bytearray(FRESH)
    journal = flash.open()
    for offset, value in pairs:
        lib.journal_write(journal, offset, value)
        expected[offset] = value
    assert content(journal) == expected
    assert content(flash.open()) == expected


def test_an_offset_beyond_the_bytes_is_left_alone():
    flash = Flash()
    journal = flash.open()
    count = len(flash.operations)
    lib.journal_write(journal, lib.JOURNAL_BYTES, 1)
    assert len(flash.operations) == count


def test_a_write_programs_one_word_and_never_erases():
    flash = Flash()
    journal = flash.open()
    del flash.operations[:]
    for value in range(100):
        lib.journal_write(journal, 7, value)
    assert flash.operations == ["program"] * 100


def test_an_opening_erases_only_where_three_quarters_are_written():
    flash = Flash()
    fill(flash.open(), WORDS // 4)
    del flash.operations[:]
    journal = flash.open()
    assert flash.operations == []
    lib.journal_write(journal, 1, 2)
    expected = content(journal)
    carried = flash.open()
    assert flash.operations[1] == "erase"
    assert flash.operations.count("erase") == 1
    assert content(carried) == expected
    assert carried.next < lib.JOURNAL_BYTES


def test_a_full_sector_keeps_the_old_value_until_the_next_opening():
    flash = Flash()
    journal = flash.open()
    before = fill(journal, 0)
    lib.journal_write(journal, 3, before[3] ^ 0xFF)
    assert content(journal) == before
    journal = flash.open()
    lib.journal_write(journal, 3, before[3] ^ 0xFF)
    assert content(flash.open())[3] == before[3] ^ 0xFF


def test_flash_that_takes_nothing_holds_erased_bytes_until_it_takes():
    flash = Flash()
    flash.is_dead = True
    journal = flash.open()
    lib.journal_write(journal, 0, 5)
    assert content(journal) == FRESH
    flash.is_dead = False
    lib.journal_write(flash.open(), 0, 5)
    assert content(flash.open())[0] == 5


def test_generations_go_round():
    flash = Flash()
    flash.open()
    flash.sectors[0][0] = header(0xFFFE)
    seen = []
    for turn in range(4):
        journal = flash.open()
        seen.append((journal.sector, journal.generation))
        fill(journal, 10)
        lib.journal_write(journal, 50, turn)
        assert content(flash.open())[50] == turn
    assert seen == [(0, 0xFFFE), (1, 0xFFFF), (0, 0), (1, 1)]


@given(
    st.integers(0, lib.JOURNAL_BYTES - 1),
    st.integers(0, 255),
    st.integers(0, BLANK),
)
def test_a_word_half_programmed_is_nothing_or_whole(offset, value, late):
    flash = Flash()
    journal = flash.open()
    place = journal.next
    lib.journal_write(journal, offset, value)
    whole = flash.sectors[journal.sector][place]
    flash.sectors[journal.sector][place] |= late
    expected = bytearray(FRESH)
    if whole | late == whole:
        expected[offset] = value
    assert content(flash.open()) == expected


@pytest.mark.parametrize("seed", range(100))
def test_a_cut_within_a_write_leaves_that_byte_old_or_new(seed):
    flash = Flash(seed)
    journal = flash.open()
    before = fill(journal, WORDS - 60)
    flash.cut_at = len(flash.operations) + 1
    offset = flash.random.randrange(lib.JOURNAL_BYTES)
    value = flash.random.randrange(256)
    lib.journal_write(journal, offset, value)
    after = bytearray(before)
    after[offset] = value
    journal = flash.open()
    assert content(journal) in (before, bytes(after))
    lib.journal_write(journal, offset, 0x5A)
    assert content(flash.open())[offset] == 0x5A


@pytest.mark.parametrize("seed", range(100))
def test_a_cut_at_any_moment_of_carrying_over_loses_nothing(seed):
    flash = Flash(seed)
    for _ in range(2):  # so that the other sector holds an older header
        expected = fill(flash.open(), 100)
    # An erasure, 40 bytes, a header.
    flash.cut_at = len(flash.operations) + 1 + seed % 42
    flash.opened()
    assert flash.is_off
    journal = flash.open()
    assert content(journal) == expected
    lib.journal_write(journal, 300, 0x5A)
    assert content(flash.open())[300] == 0x5A


@pytest.mark.parametrize("seed", range(20))
def test_a_cut_within_the_first_start_leaves_a_fresh_journal(seed):
    flash = Flash(seed)
    flash.sectors = [
        [flash.random.getrandbits(32) for _ in range(WORDS)] for _ in range(2)
    ]
    flash.cut_at = 1 + seed % 2
    flash.opened()
    journal = flash.open()
    assert content(journal) == FRESH
    lib.journal_write(journal, 0, 0x5A)
    assert content(flash.open())[0] == 0x5A


def test_settings_saved_through_it_survive_a_cut_at_every_operation():
    def start(flash: Flash) -> tuple[Any, Any, Any, Any]:
        journal = flash.opened()
        keep = (
            ffi.callback("uint8_t(void *, uint16_t)", lambda _, at: journal.bytes[at]),
            ffi.callback(
                "void(void *, uint16_t, uint8_t)",
                lambda _, at, value: lib.journal_write(journal, at, value),
            ),
            ffi.callback("bool(void *)", lambda _: True),
        )
        storage = ffi.new(
            "struct memory *",
            {"read": keep[0], "write": keep[1], "is_ready": keep[2]},
        )
        settings = ffi.new("struct settings *")
        writer = ffi.new("struct settings_writer *")
        result = lib.settings_load(storage, settings, writer)
        return settings, writer, storage, (result, keep)

    def save(settings: Any, writer: Any) -> int:
        lib.settings_save(writer)
        for _ in range(1000):
            result = lib.settings_step(writer, settings)
            if result != lib.MEMORY_BUSY:
                return int(result)
        raise AssertionError("an endless save")

    flash = Flash()
    settings, writer, _storage, _ = start(flash)
    settings.boot_count = 1
    assert save(settings, writer) == lib.MEMORY_OK
    cut, known, completed = 1, 1, 0
    while completed < 3:
        flash.is_off, flash.cut_at = False, None
        settings, writer, _storage, (result, keep) = start(flash)
        assert result == lib.SETTINGS_OK
        assert settings.boot_count in (known, known + 1)
        known = settings.boot_count
        settings.boot_count = known + 1
        flash.cut_at = len(flash.operations) + cut
        save(settings, writer)
        assert keep
        if flash.is_off:
            cut += 1
        else:
            completed, cut = completed + 1, 1
    settings, *_ = start(flash)
    assert settings.boot_count == known + 1
