# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document: what a host
may not do.

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import (
    BLOCK,
    HCS,
    IDLE,
    ILLEGAL,
    SLOW,
    WRITE_ERROR,
    Card,
    lib,
    pattern,
)


def test_a_command_wants_a_byte_s_pause_behind_an_answer(rude: Card) -> None:
    rude.r1(16, 512)
    rude.send(rude.frame(13))
    assert rude.complains("NRC")


def test_a_command_wants_the_last_one_s_answer(rude: Card) -> None:
    rude.r1(13)  # the second byte of R2 is still to be read
    rude.send(rude.frame(13))
    assert rude.complains("before the answer")


def test_a_block_wants_a_byte_s_pause_behind_an_answer(rude: Card) -> None:
    rude.r1(24, 0)
    rude.send(b"\xfe")
    assert rude.complains("NWR")


def test_a_command_while_it_is_busy_is_not_heard(rude: Card) -> None:
    rude.write(1, pattern(1))
    assert rude.send(b"\xff" + rude.frame(13) + b"\xff" * 20) == bytes(27)
    assert rude.complains("while it is busy")
    rude.ready()
    assert rude.stored(1) == pattern(1)


def test_a_block_while_it_is_busy_is_not_taken(rude: Card) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.send(b"\xff\xfc")
    assert rude.complains("token before it is ready")


def test_a_reset_breaks_programming_off(tmp_path: Path) -> None:
    outcomes = set()
    for seed in range(30):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.truncate(0)
            file.truncate(256 * BLOCK)
        card.write(1, pattern(1))
        card.send(2)
        assert card.r1(0) == IDLE
        assert card.complains("while it is busy")
        assert not card.is_busy()
        outcomes.add(card.stored(1) == pattern(1))
    assert outcomes == {False, True}


@pytest.mark.parametrize("length", [1, 5, 6, 7])
def test_deselecting_amid_a_command_or_its_answer(rude: Card, length: int) -> None:
    rude.send(1)
    rude.send((rude.frame(13) + b"\xff")[:length])
    rude.select(on=False)
    assert rude.complains("deselected amid")
    rude.send(1)
    rude.select()
    assert rude.r1(13) == 0


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_deselecting_amid_a_transfer_ends_it(rude: Card, index: int) -> None:
    rude.r1(index, 0)
    rude.send(1)
    rude.select(on=False)
    assert rude.complains("deselected amid")
    rude.send(1)
    rude.select()
    assert rude.r1(13) == 0


def test_a_run_that_is_left_is_programmed_but_for_the_block_under_way(
    rude: Card,
) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    rude.send(b"\xff\xfc" + pattern(1)[:100])
    rude.select(on=False)
    rude.wait(41)
    assert rude.stored(0, 2) == pattern(0) + bytes(BLOCK)


def test_another_command_amid_a_read_is_illegal(rude: Card) -> None:
    rude.r1(18, 0)
    assert rude.r1(13) == ILLEGAL
    assert rude.complains("amid a transfer")


@pytest.mark.parametrize(
    ("index", "token"), [(24, 0xFC), (25, 0xFE), (24, 0xFD), (24, 0x00)]
)
def test_another_write_s_token_is_none(rude: Card, index: int, token: int) -> None:
    rude.r1(index, 0)
    rude.send(bytes([0xFF, token]))
    assert rude.complains("no token of this write")


def test_a_rejected_run_wants_its_cmd12(rude: Card) -> None:
    rude.fault("ERROR", first=2, count=1)
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    assert rude.put(pattern(1), 0xFC) == WRITE_ERROR
    rude.send(b"\xff\xfc" + pattern(2) + bytes(2))
    assert rude.send(3) == b"\xff" * 3
    assert rude.complains("after one that was rejected")
    assert rude.r1(12) == 0
    rude.ready()
    assert rude.stored(0, 3) == pattern(0) + bytes(2 * BLOCK)


def test_a_rejected_run_is_no_token_s_to_end(rude: Card) -> None:
    rude.fault("ERROR", first=1, count=1)
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.stop()
    assert rude.complains("CMD12")


def test_a_good_run_is_no_cmd12_s_to_end(rude: Card) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    assert rude.r1(12) == ILLEGAL
    assert rude.complains("amid a transfer")


def test_reserved_bits_are_zero(tmp_path: Path) -> None:
    eight, other = Card(tmp_path), Card(tmp_path)
    eight.power_up()
    eight.command(8, 0x11AA, 4)
    assert eight.complains("CMD8")
    other.power_up()
    other.command(8, 0x1AA, 4)
    other.app(41, HCS | 0xFF8000)
    assert other.complains("ACMD41")


def test_the_first_complaint_stays(rude: Card) -> None:
    rude.send(b"\x00")
    first = rude.complaint()
    rude.r1(42)
    assert rude.complaint() == first


def test_a_host_that_is_reset_amid_a_run_is_no_complaint(card: Card) -> None:
    card.r1(25, card.address(0))
    card.put(pattern(0), 0xFC)
    card.ready()
    card.send(b"\xff\xfc" + pattern(1)[:100])
    lib.sdcard_chip_host_reset(card.chip, card.now)
    card.select(on=False)
    card.hz = SLOW
    card.wait(50)
    card.identify()
    assert card.read(0) == pattern(0)
    assert card.read(1) == bytes(BLOCK)
