# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document: gaps and busy
(SD 7.5).

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.chips.sdcard_desk import ACCEPTED, BLOCK, MS, Card, lib, pattern


def test_gaps_stay_within_their_limits_and_vary(card: Card) -> None:
    card.gaps.clear()
    for _ in range(100):
        card.r1(13)
        card.send(1)
    assert set(card.gaps) == set(range(1, 9))  # NCR: 1 to 8 bytes
    card.gaps.clear()
    for _ in range(60):
        card.r1(9)
        card.data(16)
    assert set(card.gaps[1::2]) == set(range(9))  # NCX: 0 to 8 bytes
    us = []
    for _ in range(60):
        assert card.r1(17, 0) == 0
        start = card.now
        card.data()
        us.append((card.now - start) / 1000 - 515 * 0.32)
    assert min(us) > 30
    assert max(us) < 401
    assert len(set(us)) > 30


@pytest.mark.sampled(2)
def test_busy_is_of_a_flash_s_length(card: Card) -> None:
    us = []
    for _ in range(120):
        card.write(1, pattern(1))
        start = card.now
        card.ready()
        us.append((card.now - start) / 1000)
    usual = [time for time in us if time < 2001]
    assert min(us) >= 300
    assert max(us) < 40_001
    assert len(usual) >= 110
    assert len(set(usual)) > 100


def test_now_and_then_busy_is_long(tmp_path: Path) -> None:
    card = Card(tmp_path, seed=3).identify()
    for _ in range(1000):
        card.write(1, pattern(1))
        card.send(1)
        card.wait(41)
        assert not card.is_busy()
        card.ready()
    worst = lib.sdcard_chip_busy_worst_ns(card.chip)
    assert 4 * MS < worst <= 40 * MS


def test_busy_is_seen_while_selected_and_goes_on_without(card: Card) -> None:
    card.write(1, pattern(1))
    assert card.send(3) == bytes(3)
    card.deselect()
    assert card.send(3) == b"\xff" * 3
    card.select()
    first, *rest = card.send(3)
    assert first in (0x00, 0x80)  # low from the first clock after CS on
    assert rest == [0, 0]
    card.deselect()
    card.wait(41)
    assert card.stored(1) == pattern(1)
    card.select()
    assert card.send(2) == b"\xff\xff"


def test_busy_ends_amid_a_byte(card: Card) -> None:
    ends = set()
    for _ in range(60):
        card.write(1, pattern(1))
        ends.add(card.until(lambda byte: byte != 0))
        assert card.send(1) == b"\xff"
    assert ends == {0xFF >> bit for bit in range(8)}


def test_programming_waits_for_the_clocks_behind_the_response(card: Card) -> None:
    assert card.write(1, pattern(1)) == ACCEPTED
    card.select(on=False)
    card.wait(1000)
    assert card.stored(1) == bytes(BLOCK)
    card.send(1)  # 8 clocks, with CS high or low (SD 4.4)
    card.wait(41)
    assert card.stored(1) == pattern(1)
    card.select()


def test_busy_after_a_stop_may_come_a_byte_late(tmp_path: Path) -> None:
    seen = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        card.r1(25, 0)
        card.put(pattern(0), 0xFC)
        card.ready()
        seen.add(card.send(b"\xff\xfd\xff\xff")[2:])
        card.ready()
        assert card.complaint() is None
    assert seen == {b"\x00\x00", b"\xff\x00"}  # NBR: 0 or 1 byte


def test_the_free_bits_of_a_data_response_are_free(card: Card) -> None:
    seen = set()
    for _ in range(60):
        card.r1(24, 0)
        card.send(b"\xff\xfe" + pattern(0) + bytes(2))
        seen.add(card.send(1)[0])
        card.ready()
    assert seen == {high << 5 | ACCEPTED for high in range(8)}


def test_a_card_may_be_left_alone_between_blocks_while_it_is_busy(card: Card) -> None:
    card.fault("SLOW", from_ns=card.now, for_ns=50 * MS, ms=20)
    card.r1(25, card.address(0))
    for number in range(3):
        assert card.put(pattern(number), 0xFC) == ACCEPTED
        card.send(1)
        card.deselect()
        card.wait(30)
        card.select()
        card.ready()
    card.stop()
    assert card.stored(0, 3) == b"".join(pattern(i) for i in range(3))
