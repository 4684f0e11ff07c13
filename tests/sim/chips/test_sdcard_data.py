# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document: reading and
writing.

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import (
    ACCEPTED,
    ADDRESS,
    BAD_CRC,
    BLOCK,
    CRC_ERROR,
    ERASE_RESET,
    ERASE_SEQUENCE,
    PARAMETER,
    WRITE_ERROR,
    Card,
    lib,
    pattern,
)


def test_a_block_is_read_as_it_stands(card: Card) -> None:
    with card.path.open("r+b") as file:
        file.seek(7 * BLOCK)
        file.write(pattern(7) + pattern(8))
    assert card.read(7) == pattern(7)
    assert card.read(8) == pattern(8)
    assert card.read(9) == bytes(BLOCK)


def test_a_run_is_read_until_it_is_stopped(card: Card) -> None:
    with card.path.open("r+b") as file:
        for number in range(5):
            file.write(pattern(number))
    assert card.r1(18, card.address(0)) == 0
    for number in range(5):
        assert card.data() == pattern(number)
    assert card.r1(12) == 0
    card.ready()
    assert card.r1(13) == 0


def test_a_run_is_stopped_amid_a_block(card: Card) -> None:
    assert card.r1(18, 0) == 0
    assert card.token() == 0xFE
    card.send(100)
    assert card.r1(12) == 0
    card.ready()
    assert card.read(1) == bytes(BLOCK)


def test_the_byte_behind_cmd12_is_no_answer(tmp_path: Path) -> None:
    seen = set()
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(bytes(BLOCK))
        card.r1(18, 0)
        card.token()
        card.send(10)
        seen.add(card.send(card.frame(12) + b"\xff")[-1])
    assert seen == {0x3F}  # two bits of data, then the idle line


def test_a_stopped_read_may_be_busy_or_not(tmp_path: Path) -> None:
    seen = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        card.r1(18, 0)
        card.data()
        assert card.r1(12) == 0
        seen.add(card.send(1)[0])
        card.ready()
        assert card.complaint() is None
    assert seen == {0x00, 0xFF}


def test_a_run_that_leaves_the_card_ends_in_an_error_token(card: Card) -> None:
    assert card.r1(18, card.address(2047)) == 0
    card.data()
    assert card.token() == 0x08  # SD 7.3.3.3: out of range
    assert card.send(600) == b"\xff" * 600
    assert card.r1(12) == 0
    card.ready()
    assert card.command(13, more=1) == b"\x00\x80"
    assert card.command(13, more=1) == b"\x00\x00"


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_an_address_beyond_the_card_is_a_parameter_error(
    card: Card, index: int
) -> None:
    assert card.r1(index, card.address(2048)) == PARAMETER
    assert card.r1(13) == 0


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_bytes_that_cross_a_block_are_an_address_error(
    tmp_path: Path, index: int
) -> None:
    card = Card(tmp_path).identify()
    assert card.r1(index, 513) == ADDRESS
    assert card.complaint() is None


def test_a_part_of_a_block_is_read_from_standard_capacity(tmp_path: Path) -> None:
    card = Card(tmp_path).identify()
    with card.path.open("r+b") as file:
        file.write(pattern(0))
    assert card.r1(16, 16) == 0
    assert card.r1(17, 100) == 0
    assert card.data(16) == pattern(0)[100:116]
    assert card.r1(17, 500) == ADDRESS
    assert card.r1(24, 0) == PARAMETER  # WRITE_BL_PARTIAL is 0
    assert card.complaint() is None


def test_the_block_length_of_high_capacity_stays(tmp_path: Path) -> None:
    card = Card(tmp_path, 2048, kind=lib.SDCARD_CHIP_SDHC).identify()
    assert card.r1(16, 16) == 0
    assert len(card.read(1)) == BLOCK


@pytest.mark.parametrize("length", [0, 513, 0xFFFFFFFF])
def test_a_block_length_that_can_not_be_is_refused(card: Card, length: int) -> None:
    assert card.r1(16, length) == PARAMETER


def test_a_block_is_there_once_busy_is_over(card: Card) -> None:
    assert card.write(5, pattern(5)) == ACCEPTED
    assert card.send(1) == b"\x00"
    assert card.stored(5) == bytes(BLOCK)
    card.ready()
    assert card.stored(5) == pattern(5)
    assert card.read(5) == pattern(5)
    assert card.read(4) == card.read(6) == bytes(BLOCK)


def test_a_run_is_there_once_it_is_stopped(card: Card) -> None:
    contents = [pattern(i) for i in range(40)]
    card.write_run(10, *contents)
    assert card.stored(10, 40) == b"".join(contents)
    assert card.numbers == list(range(1, 41))
    assert lib.sdcard_chip_written(card.chip) == 40
    assert card.app(22)[0] == 0
    assert card.data(4) == bytes([0, 0, 0, 40])


def test_a_run_s_last_blocks_are_not_there_before(card: Card) -> None:
    card.r1(25, card.address(0))
    for number in range(20):
        card.put(pattern(number), 0xFC)
        card.ready()
    assert card.stored(0, 4) == b"".join(pattern(i) for i in range(4))
    assert card.stored(4, 16) == bytes(16 * BLOCK)
    card.stop()


def test_a_run_that_leaves_the_card_is_rejected(card: Card) -> None:
    card.r1(25, card.address(2047))
    assert card.put(pattern(1), 0xFC) == ACCEPTED
    card.ready()
    assert card.put(pattern(2), 0xFC) == WRITE_ERROR
    assert card.r1(12) == 0
    card.ready()
    assert card.command(13, more=1) == b"\x00\x80"
    card.app(22)
    assert card.data(4) == bytes([0, 0, 0, 1])
    assert card.stored(2047) == pattern(1)


def test_blocks_announced_and_not_sent_are_anything(tmp_path: Path) -> None:
    kept = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 64 * BLOCK)
        card.app(23, 8)
        card.write_run(10, pattern(0), pattern(1))
        assert card.stored(10, 2) == pattern(0) + pattern(1)
        rest = card.stored(12, 6)
        gone = rest.count(bytes(BLOCK)[:1]) // BLOCK
        assert rest == bytes(gone * BLOCK) + b"\x55" * (6 - gone) * BLOCK
        assert card.stored(18) == b"\x55" * BLOCK
        kept.add(gone)
        assert card.complaint() is None
    assert {0, 6} & kept
    assert len(kept) > 2


def test_erased_blocks_read_as_zeros(card: Card) -> None:
    card.write_run(0, *[b"\x77" * BLOCK] * 10)
    assert card.r1(32, card.address(3)) == 0
    assert card.command(58, more=4)[0] == ERASE_RESET
    assert card.r1(33, 0) == ERASE_SEQUENCE
    first, last = card.address(3), card.address(6)
    assert [card.r1(32, first), card.r1(33, last), card.r1(38)] == [0, 0, 0]
    card.ready()
    assert card.stored(0, 10).count(0) == 4 * BLOCK
    assert card.stored(3, 4) == bytes(4 * BLOCK)
    assert card.r1(38) == ERASE_SEQUENCE
    assert card.r1(33, last) == ERASE_SEQUENCE
    assert [card.r1(32, first), card.r1(33, last)] == [0, 0]
    assert card.r1(33, last) == ERASE_SEQUENCE
    assert [card.r1(32, last), card.r1(33, first), card.r1(38)] == [0, 0, 0]
    assert card.command(13, more=1) == b"\x00\x40"
    assert card.r1(32, card.address(2048)) == PARAMETER


def test_crcs_count_once_they_are_turned_on(tmp_path: Path) -> None:
    card = Card(tmp_path).identify()
    assert card.r1(24, 0, crc=0x01) == 0
    assert card.put(pattern(1), crc=b"\x00\x00") == ACCEPTED
    card.ready()
    assert card.r1(59, 1) == 0
    assert card.r1(24, 0) == 0
    assert card.put(pattern(2)) == ACCEPTED
    card.ready()
    assert card.complaint() is None
    assert card.r1(24, 0) == 0
    assert card.put(pattern(3), crc=b"\x00\x00") == CRC_ERROR
    assert card.send(1) == b"\xff"
    assert card.complains("block with a wrong CRC")
    assert card.r1(17, 0, crc=0x01) == BAD_CRC
    assert card.stored(0) == pattern(2)
    assert lib.sdcard_chip_bad_crc(card.chip) == 2
    assert card.r1(59, 0) == 0
    assert card.r1(13, crc=0x01) == 0
