# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document: registers (SD
chapter 5).

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import (
    ACCEPTED,
    BLOCK,
    PARAMETER,
    Card,
    crc7,
    ffi,
    lib,
    pattern,
)

NOWHERE = ffi.new("char[]", b"/no/such/image")


def csd_of(card: Card) -> int:
    assert card.r1(9) == 0
    content = card.data(16)
    assert content[15] == crc7(content[:15]) << 1 | 1
    return int.from_bytes(content, "big")


def bits(register: int, high: int, low: int) -> int:
    return register >> low & (1 << high - low + 1) - 1


@pytest.mark.parametrize(
    "size",
    [
        1 << 20,
        8 << 20,
        100_000 * 512,
        5000 * 2048,  # more than 4096 of the smallest unit
        1 << 30,
        2 << 30,
    ],
)
def test_the_csd_of_an_sdsc_card_gives_its_size(tmp_path: Path, size: int) -> None:
    card = Card(tmp_path, blocks=size // BLOCK).identify()
    csd = csd_of(card)
    assert bits(csd, 127, 126) == 0
    assert bits(csd, 103, 96) == 0x32
    block = 1 << bits(csd, 83, 80)
    size_told = (bits(csd, 73, 62) + 1) * (1 << bits(csd, 49, 47) + 2) * block
    assert size_told == size == lib.sdcard_chip_blocks(card.chip) * BLOCK
    assert bits(csd, 79, 79) == 1  # READ_BL_PARTIAL
    assert bits(csd, 25, 22) == bits(csd, 83, 80)
    assert card.complaint() is None


@pytest.mark.parametrize("size", [(2 << 30) + (1 << 19), 4 << 30, 32 << 30])
def test_the_csd_of_an_sdhc_card_gives_its_size(tmp_path: Path, size: int) -> None:
    card = Card(tmp_path, blocks=size // BLOCK).identify()
    csd = csd_of(card)
    assert bits(csd, 127, 126) == 1
    assert (bits(csd, 69, 48) + 1) * 512 * 1024 == size
    # SD 5.3.3 fixes these values.
    assert [bits(csd, 119, 112), bits(csd, 111, 104)] == [0x0E, 0x00]
    assert [bits(csd, 83, 80), bits(csd, 79, 79), bits(csd, 46, 46)] == [9, 0, 1]
    assert [bits(csd, 45, 39), bits(csd, 28, 26), bits(csd, 25, 22)] == [0x7F, 2, 9]


def test_the_last_block_of_32_gb_is_written_and_little_of_the_disk(
    tmp_path: Path,
) -> None:
    card = Card(tmp_path, blocks=64 << 20).identify()
    last = (64 << 20) - 1
    assert card.write(last, pattern(1)) == ACCEPTED
    card.ready()
    assert card.read(last) == pattern(1)
    assert card.r1(17, last + 1) == PARAMETER
    assert card.path.stat().st_blocks * 512 < 1 << 20


@pytest.mark.parametrize(
    ("size", "kind", "problem"),
    [
        (0, "BY_SIZE", "multiple of 512"),
        (513, "BY_SIZE", "multiple of 512"),
        (512, "BY_SIZE", "no SDSC card"),
        ((64 << 20) + 512, "BY_SIZE", "a multiple of 512 KB"),
        ((4 << 30) + 512, "BY_SIZE", "no SDHC card"),
        ((2 << 30) + 512, "SDSC", "no SDSC card"),
        (511 * 1024, "SDHC", "no SDHC card"),
    ],
)
def test_what_is_no_card_is_told(
    tmp_path: Path, size: int, kind: str, problem: str
) -> None:
    with (tmp_path / "card.img").open("wb") as file:
        file.truncate(size)
    with pytest.raises(ValueError, match=problem):
        Card(tmp_path, kind=getattr(lib, f"SDCARD_CHIP_{kind}"))


def test_an_image_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no file"):
        Card(tmp_path, image=NOWHERE)


def test_the_cid_is_one_card_s_own(tmp_path: Path) -> None:
    serials = set()
    for seed in range(8):
        card = Card(tmp_path, seed=seed).identify()
        assert card.r1(10) == 0
        cid = card.data(16)
        assert cid[15] == crc7(cid[:15]) << 1 | 1
        assert cid[3:8] == b"CARD1"
        serials.add(cid[9:13])
    assert len(serials) == 8


def test_status_and_configuration_come_as_data(card: Card) -> None:
    is_high = card.config.kind == lib.SDCARD_CHIP_SDHC
    assert card.app(13, more=1) == b"\x00\x00"
    status = card.data(64)
    assert status[:8] == bytes(8)
    assert status[10] >> 4 == (9 if is_high else 6)  # AU_SIZE
    assert card.app(51)[0] == 0
    # SD 5.6: version 2.00, both bus widths supported.
    scr = card.data(8)
    assert scr[:2] == (b"\x02\x35" if is_high else b"\x02\x25")
    assert card.app(42)[0] == 0
