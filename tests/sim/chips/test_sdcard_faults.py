# SPDX-License-Identifier: MIT
"""The faults of the SD card's model."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import (
    ACCEPTED,
    BLOCK,
    CRC_ERROR,
    MS,
    SLOW,
    WRITE_ERROR,
    Card,
    ffi,
    kind_of,
    lib,
    pattern,
)


def test_a_pulled_card_leaves_the_line_high_and_comes_back_fresh(card: Card) -> None:
    card.write(3, pattern(3))
    card.ready()
    out = card.now + 10 * MS
    card.fault("PULLED", from_ns=out, for_ns=100 * MS)
    assert card.read(3) == pattern(3)
    card.wait(10)
    assert card.send(card.frame(13) + b"\xff" * 20) == b"\xff" * 26
    card.wait(100)
    # The card is back but not initialised: it ignores commands without a complaint.
    assert card.send(card.frame(13) + b"\xff" * 20) == b"\xff" * 26
    card.deselect()
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(3) == pattern(3)


def test_a_card_may_be_put_in_later(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.fault("PULLED", for_ns=500 * MS)
    card.send(10)
    card.select()
    with pytest.raises(TimeoutError):
        card.r1(0)
    card.deselect()
    card.now = 502 * MS
    card.identify()
    assert card.complaint() is None


def test_a_card_pulled_while_it_programs_is_torn_there_and_then(tmp_path: Path) -> None:
    seen = set()
    for seed in range(40):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 10 * BLOCK)
        card.fault("PULLED", from_ns=card.now + 600_000)
        card.write(1, pattern(1))
        card.send(1)
        card.wait(5)
        seen.add(kind_of(card.stored(1), b"\x55" * BLOCK, pattern(1)))
        assert card.stored(0) == card.stored(2) == b"\x55" * BLOCK
        card.wait(5)
        assert card.complaint() is None
    assert {"old", "new", "torn"} <= seen


@pytest.mark.parametrize("kind", ["PULLED", "DEAD"])
def test_a_card_can_go_within_a_block(card: Card, kind: str) -> None:
    card.fault(kind, first=2, count=1, after_ns=200_000, for_ns=100 * MS)
    card.write(1, pattern(1))
    card.ready()
    card.write(2, pattern(2))
    assert card.send(1) == b"\x00"
    card.wait(0.19)
    assert card.send(1) == b"\x00"
    card.wait(0.01)
    assert card.send(1) == b"\xff"
    card.wait(99)
    assert card.send(30) == b"\xff" * 30
    card.wait(2)
    card.deselect()
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(1) == pattern(1)
    if kind == "DEAD":  # it kept its power and has programmed block 2
        assert card.read(2) == pattern(2)


def test_a_card_that_is_dead_at_first_comes_up_later(fresh: Card) -> None:
    fresh.fault("DEAD", for_ns=100 * MS)
    for _ in range(4):
        fresh.send(10)
        fresh.select()
        assert fresh.send(fresh.frame(0) + b"\xff" * 8)[-8:] == b"\xff" * 8
        fresh.deselect()
    fresh.now = 100 * MS - 60_000  # it comes to life during the clocks
    fresh.send(10)
    fresh.select()
    assert fresh.send(fresh.frame(0) + b"\xff" * 8)[-8:] == b"\xff" * 8
    fresh.deselect()
    fresh.power_up()


def test_a_slow_card_is_busy_for_as_long_as_asked(card: Card) -> None:
    address = card.address(1)
    card.fault("SLOW", from_ns=card.now, for_ns=MS, ms=250)
    card.r1(24, address)
    assert card.put(pattern(1)) == ACCEPTED
    card.send(1)
    card.wait(249)
    assert card.send(1) == b"\x00"
    card.wait(1)
    card.ready()
    card.write(1, pattern(2))
    card.send(1)
    card.wait(41)
    assert not card.is_busy()
    assert lib.sdcard_chip_busy_worst_ns(card.chip) == 250 * MS


def test_a_slow_card_can_be_slower_than_the_document_lets_it(card: Card) -> None:
    card.fault("SLOW", first=2, count=1, ms=1500)
    card.write(1, pattern(1))
    card.ready()
    card.write(1, pattern(2))
    card.send(1)
    card.wait(1499)
    assert card.is_busy()
    card.wait(1)
    assert not card.is_busy()


@pytest.mark.parametrize(
    ("kind", "response", "status"), [("CRC", CRC_ERROR, 0), ("ERROR", WRITE_ERROR, 4)]
)
def test_blocks_are_rejected_as_asked(
    card: Card, kind: str, response: int, status: int
) -> None:
    card.fault(kind, first=2, count=2)
    responses = []
    for number in range(5):
        responses.append(card.write(number, pattern(number)))
        card.ready()
    assert responses == [ACCEPTED, response, response, ACCEPTED, ACCEPTED]
    assert card.stored(1, 2) == bytes(2 * BLOCK)
    assert card.command(13, more=1) == bytes([0, status])
    assert lib.sdcard_chip_bad_crc(card.chip) == (2 if kind == "CRC" else 0)
    card.fault(kind, from_ns=card.now + MS, for_ns=MS)
    assert card.write(6, pattern(6)) == ACCEPTED
    card.ready()


def test_a_rejected_block_of_a_run_is_told_and_the_rest_is_there(card: Card) -> None:
    card.fault("CRC", first=3, count=1)
    card.r1(25, card.address(0))
    responses = []
    for number in range(3):
        responses.append(card.put(pattern(number), 0xFC))
        card.ready()
    assert responses == [ACCEPTED, ACCEPTED, CRC_ERROR]
    assert card.r1(12) == 0
    card.ready()
    assert card.stored(0, 3) == pattern(0) + pattern(1) + bytes(BLOCK)


def test_a_worn_block_refuses(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_REFUSES)
    responses = []
    for number in range(9, 13):
        responses.append(card.write(number, pattern(number)))
        card.ready()
    assert responses == [ACCEPTED, WRITE_ERROR, WRITE_ERROR, ACCEPTED]


def test_a_worn_block_keeps_what_it_has(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_KEEPS)
    card.write_run(9, *[pattern(number) for number in range(9, 13)])
    assert card.stored(9, 4) == pattern(9) + bytes(2 * BLOCK) + pattern(12)


def test_a_worn_block_can_not_be_read(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_UNREADABLE)
    assert card.write(10, pattern(10)) == ACCEPTED
    card.ready()
    assert card.r1(17, card.address(10)) == 0
    assert card.token() == 0x04  # SD 7.3.3.3: ECC failed
    assert card.command(13, more=1) == b"\x00\x10"
    assert card.read(9) == bytes(BLOCK)


def test_a_dead_card_says_nothing_and_takes_nothing(card: Card) -> None:
    address = card.address(1)
    card.fault("DEAD", from_ns=card.now + MS, for_ns=50 * MS)
    card.wait(1)
    assert card.send(card.frame(24, address) + b"\xff" * 20) == b"\xff" * 26
    assert card.send(b"\xfe" + pattern(1) + bytes(3)) == b"\xff" * 516
    card.wait(50)
    assert card.stored(1) == bytes(BLOCK)
    card.send(b"\x00")  # the rest of a transfer whose start it missed
    card.deselect()
    card.select()
    assert card.r1(13) == 0
    card.fault("DEAD", from_ns=card.now)
    card.wait(100_000)
    assert card.send(card.frame(0) + b"\xff" * 20) == b"\xff" * 26


def test_there_is_room_for_32_faults(card: Card) -> None:
    for _ in range(32):
        card.fault("CRC", first=1000, count=1)
    fault = ffi.new("struct sdcard_chip_fault *")
    assert not lib.sdcard_chip_add_fault(card.chip, fault)
    lib.sdcard_chip_clear_faults(card.chip)
    card.fault("CRC", first=1, count=1)
    assert card.write(0, pattern(0)) == CRC_ERROR
