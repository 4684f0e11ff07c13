# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document: power-up and
identification (SD 6.4.1, 7.2.1).

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import (
    BAD_CRC,
    BLOCK,
    HCS,
    IDLE,
    ILLEGAL,
    MS,
    SLOW,
    Card,
    crc16,
    lib,
)


def test_a_reset_is_answered_after_74_clocks(fresh: Card) -> None:
    fresh.power_up()


@pytest.mark.parametrize(
    ("wait_ns", "with_cs_high", "with_cs_low"),
    [(2 * MS, 9, 0), (2 * MS, 0, 20), (500_000, 10, 0)],
)
def test_fewer_clocks_or_less_than_a_millisecond_are_not_enough(
    tmp_path: Path, wait_ns: int, with_cs_high: int, with_cs_low: int
) -> None:
    card = Card(tmp_path)
    card.now = wait_ns
    card.send(with_cs_high)
    card.select()
    card.send(with_cs_low)
    with pytest.raises(TimeoutError):
        card.r1(0)
    assert card.complains("1 ms and 74 clocks")


@pytest.mark.parametrize(("index", "crc"), [(0, 0x97), (8, None), (17, None)])
def test_nothing_but_a_good_cmd0_is_heard_first(
    tmp_path: Path, index: int, crc: int | None
) -> None:
    card = Card(tmp_path)
    card.send(10)
    card.select()
    with pytest.raises(TimeoutError):
        card.r1(index, crc=crc)
    assert card.complains("no valid CMD0 first")
    assert card.r1(0) == IDLE


def test_the_document_s_own_commands_have_the_crcs_that_it_prints() -> None:
    # Examples of SD 4.5 and 7.2.2: CMD0, CMD17 with argument 0, 512 bytes of 0xFF.
    assert Card.frame(0) == bytes.fromhex("400000000095")
    assert Card.frame(17) == bytes.fromhex("510000000055")
    assert crc16(b"\xff" * 512) == b"\x7f\xa1"


@pytest.mark.parametrize("check", [0xAA, 0x00, 0x5B])
def test_cmd8_echoes_voltage_and_pattern(fresh: Card, check: int) -> None:
    fresh.power_up()
    assert fresh.command(8, 0x100 | check, 4) == bytes([1, 0, 0, 1, check])


@pytest.mark.parametrize("voltage", [0, 2, 3])
def test_cmd8_with_another_voltage_gets_none_back(fresh: Card, voltage: int) -> None:
    fresh.power_up()
    assert fresh.command(8, voltage << 8 | 0xAA, 4) == b"\x01\x00\x00\x00\xaa"


def test_cmd8_is_checked_even_where_crc_is_off(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    assert card.r1(8, 0x1AA, crc=0x85) == BAD_CRC | IDLE
    assert card.complains("wrong CRC")


def test_initialisation_takes_its_time(tmp_path: Path) -> None:
    times = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed)
        card.power_up()
        card.command(8, 0x1AA, 4)
        start = card.now
        while card.app(41, HCS)[0] == IDLE:
            card.wait(1)
        times.add((card.now - start) // MS)
        assert card.complaint() is None
    assert min(times) >= 20
    assert max(times) <= 302  # 300 ms and a turn of this loop; SD 4.2.3 allows 1 s
    assert len(times) > 6


@pytest.mark.parametrize(("sees_cmd8", "argument"), [(True, 0), (False, HCS)])
def test_high_capacity_waits_for_a_host_that_knows_it(
    tmp_path: Path, sees_cmd8: bool, argument: int
) -> None:
    card = Card(tmp_path, blocks=2048, kind=lib.SDCARD_CHIP_SDHC)
    card.power_up()
    if sees_cmd8:
        card.command(8, 0x1AA, 4)
    for _ in range(1200):
        assert card.app(41, argument)[0] == IDLE
        card.wait(1)
    assert (card.complaint() is None) is sees_cmd8


def test_standard_capacity_ignores_hcs(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    card.command(8, 0x1AA, 4)
    card.app(41, 0)
    card.wait(301)
    assert card.app(41, 0)[0] == 0
    assert card.complaint() is None


def test_a_card_of_version_1_knows_no_cmd8(tmp_path: Path) -> None:
    card = Card(tmp_path, is_version_1=True)
    card.power_up()
    assert card.r1(8, 0x1AA) == ILLEGAL | IDLE
    card.app(41)
    card.wait(301)
    assert card.app(41)[0] == 0
    assert card.complaint() is None


def test_the_ocr_tells_ready_and_capacity(card: Card) -> None:
    is_high = card.config.kind == lib.SDCARD_CHIP_SDHC
    ocr = int.from_bytes(card.command(58, more=4)[1:], "big")
    assert ocr == 0x80FF8000 | (HCS if is_high else 0)
    assert card.r1(0) == IDLE
    card.hz = SLOW
    assert card.command(58, more=4) == b"\x01\x00\xff\x80\x00"


def test_what_must_wait_for_ready_is_refused(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    for index in (9, 10, 13, 16, 17, 18, 24, 25, 32):
        assert card.r1(index, 512) == ILLEGAL | IDLE
    assert card.complains("must wait")


def test_only_acmd41_is_repeated_while_it_initialises(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    card.command(8, 0x1AA, 4)
    card.app(41, HCS)
    assert card.complaint() is None
    card.command(58, more=4)
    assert card.complains("while ACMD41 is repeated")


def test_the_clock_has_its_limits(tmp_path: Path) -> None:
    early, late = Card(tmp_path), Card(tmp_path)
    for card in (early, late):
        card.hz = 400_000
        card.power_up()
        assert card.complaint() is None
    early.hz = 400_001
    early.send(1)
    assert early.complains("above 400 kHz")
    late.command(8, 0x1AA, 4)
    late.app(41, HCS)
    late.wait(301)
    late.app(41, HCS)
    late.hz = 25_000_000
    late.send(1)
    assert late.complaint() is None
    late.hz = 25_000_001
    late.send(1)
    assert late.complains("above 25 MHz")


@pytest.mark.parametrize("index", [1, 2, 3, 5, 7, 11, 12, 15, 20, 23, 28, 52, 63])
def test_what_is_no_command_here_is_illegal(card: Card, index: int) -> None:
    assert card.r1(index) == ILLEGAL
    assert card.r1(13) == 0  # an error is reported once


@pytest.mark.parametrize("index", [6, 27, 42, 56])
def test_what_is_not_modelled_says_so(rude: Card, index: int) -> None:
    assert rude.r1(index) == ILLEGAL
    assert rude.complains("not modelled")


def test_an_application_s_command_that_is_none_is_the_plain_one(card: Card) -> None:
    assert card.app(17, 0)[0] == 0
    assert card.data() == bytes(BLOCK)
