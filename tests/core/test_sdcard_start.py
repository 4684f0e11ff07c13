# SPDX-License-Identifier: MIT
"""The SD card's driver: every kind of card is identified, or refused."""

from __future__ import annotations

import pytest

from core.fake_card import FakeCard, csd1, csd2
from core.sdcard_desk import ABSENT, OK, REFUSED, TIMEOUT, Driver, ready

CMD = {"reset": 0, "status": 13, "length": 16, "crc": 59, "stop": 12}


@pytest.mark.parametrize(
    ("card", "has_high_capacity"),
    [
        (FakeCard(1 << 24), True),
        (FakeCard(1024), True),
        (FakeCard(1 << 20, is_sdhc=False), False),
        (FakeCard(1 << 20, is_sdhc=False, version=1), False),
    ],
)
@pytest.mark.parametrize("pause", [1, 8])
def test_each_kind_of_card_is_identified(card, has_high_capacity, pause):
    card.power_up()
    card.pause = pause
    driver = ready(card)
    assert driver.state.blocks == card.size
    assert driver.state.has_high_capacity == has_high_capacity
    assert card.has_crc
    assert (CMD["length"] in card.commands) != has_high_capacity
    assert driver.wire.is_fast
    assert not driver.wire.is_selected
    assert driver.state.faults == 0


def test_identification_is_slow_and_counts_before_the_first_command():
    card = FakeCard()
    driver = Driver(card)
    speeds = set()
    card.read_us = 0

    def look(_: int) -> None:
        if not card.is_ready:
            speeds.add(driver.wire.is_fast)

    driver.wire.on_exchange = look
    assert driver.identify() == OK
    assert speeds == {False}


# 5.3.2: 2 GB with blocks of 1024 bytes, 4 GB with 2048, 8 MB with the smallest factor.
@pytest.mark.parametrize(
    ("blocks", "length", "factor"),
    [(1 << 22, 10, 7), (1 << 23, 11, 7), (1 << 14, 9, 0), (1 << 21, 9, 7)],
)
def test_a_standard_card_is_as_large_as_its_csd_says(blocks, length, factor):
    card = FakeCard(blocks, is_sdhc=False)
    card.csd = csd1(blocks, length, factor)
    assert ready(card).state.blocks == blocks


@pytest.mark.parametrize(
    ("csd", "blocks"),
    [(csd2(1 << 31), 1 << 31), (csd2(1 << 32), (1 << 32) - 1)],
)
def test_a_large_card_is_counted_up_to_two_terabytes(csd, blocks):
    card = FakeCard()
    card.csd = csd
    assert ready(card).state.blocks == blocks


def test_a_protected_card_is_read_only():
    for bit in (0x10, 0x20):
        card = FakeCard()
        card.csd = card.csd[:14] + bytes([bit]) + card.csd[15:]
        assert ready(card).state.is_read_only
    assert not ready().state.is_read_only


@pytest.mark.parametrize(
    "csd",
    [
        b"\x80" + bytes(15),  # version 3: more than 2 TB
        csd1(1 << 20),  # of another kind than the OCR says
    ],
)
def test_a_card_of_an_unknown_kind_is_refused(csd):
    card = FakeCard()
    card.csd = csd
    assert Driver(card).identify() == REFUSED


@pytest.mark.parametrize("length", [8, 12])
def test_a_standard_card_with_strange_blocks_is_refused(length):
    card = FakeCard(is_sdhc=False)
    card.csd = card.csd[:5] + bytes([0x50 | length]) + card.csd[6:]
    assert Driver(card).identify() == REFUSED


def test_what_is_no_sd_card_is_refused():
    card = FakeCard()
    card.illegal = {41}  # an MMC
    assert Driver(card).identify() == REFUSED
    card = FakeCard()
    card.volts = 0  # runs at none of ours
    assert Driver(card).identify() == REFUSED
    card = FakeCard()
    card.ocr = 0x00FF8000
    assert Driver(card).identify() == REFUSED


def test_an_empty_socket_is_told_at_once():
    card = FakeCard()
    card.is_in = False
    driver = Driver(card)
    assert driver.identify() == ABSENT
    assert driver.wire.now_us < 50_000
    assert driver.state.faults == 0


def test_a_card_that_never_starts_is_given_a_second():
    card = FakeCard()
    card.starting = 10**9
    driver = Driver(card)
    assert driver.identify() == TIMEOUT
    assert 1_000_000 <= driver.wire.now_us < 1_200_000


def test_a_card_that_takes_a_while_is_waited_for():
    card = FakeCard()
    card.starting = 200
    driver = ready(card)
    assert 300_000 < driver.wire.now_us < 1_000_000


@pytest.mark.parametrize("sent", [*range(7), 8, 100, 511, 513, 514])
def test_a_card_amid_a_block_is_brought_back(sent):
    card = FakeCard()
    ready(card)
    # The host is reset while it sends a run.
    card.run = card.run_first = 7
    card.data = bytearray(sent) if sent < 514 else None
    card.busy_until = 30_000.0
    driver = Driver(card)
    assert driver.identify() == OK
    assert driver.read(7) == OK
