# SPDX-License-Identifier: MIT
"""The card's driver: every kind of card is identified, what is written can be read, and
whatever a card does ends in time with a result that says what it was."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native
from core.fake_card import (
    ACCEPTED,
    BAD_CRC,
    BLOCK,
    WRITE_ERROR,
    FakeCard,
    Wire,
    csd1,
    csd2,
)

ffi, lib = native.load()

OK, ABSENT, TIMEOUT = lib.SDCARD_OK, lib.SDCARD_ABSENT, lib.SDCARD_TIMEOUT
REFUSED, GARBLED, FAILED = lib.SDCARD_REFUSED, lib.SDCARD_GARBLED, lib.SDCARD_FAILED

CMD = {"reset": 0, "status": 13, "length": 16, "crc": 59, "stop": 12}


def data_of(seed: int) -> bytes:
    return bytes((seed * 31 + i * (seed % 7 + 1)) % 256 for i in range(BLOCK))


class Driver:
    """The driver over a wire, an operation at a time."""

    def __init__(self, card: FakeCard) -> None:
        self.wire = Wire(ffi, card)
        self.card = card
        self.state = ffi.new("struct sdcard *")
        self.steps_at_once = 0
        lib.sdcard_init(self.state, self.wire.device)

    def finish(self) -> int:
        in_a_row = 0
        for _ in range(200_000):
            result = lib.sdcard_step(self.state, self.wire.time)
            if result <= 0:
                return int(result)
            if result == lib.SDCARD_WAITS:
                self.wire.sleep()
                in_a_row = 0
            else:
                in_a_row += 1
                assert in_a_row < 10, "it never lets go"
        pytest.fail("an operation without an end")

    def identify(self) -> int:
        lib.sdcard_identify(self.state)
        return self.finish()

    def read(self, block: int) -> int:
        lib.sdcard_read(self.state, block)
        return self.finish()

    def check(self) -> int:
        lib.sdcard_check(self.state)
        return self.finish()

    def open(self, block: int) -> int:
        lib.sdcard_open(self.state, block)
        return self.finish()

    def write(self, data: bytes) -> int:
        ffi.memmove(self.block, data, BLOCK)
        lib.sdcard_write(self.state)
        return self.finish()

    def close(self) -> int:
        lib.sdcard_close(self.state)
        return self.finish()

    @property
    def block(self) -> Any:
        return lib.sdcard_block(self.state)

    @property
    def content(self) -> bytes:
        return bytes(ffi.buffer(self.block, BLOCK))


def ready(card: FakeCard | None = None) -> Driver:
    driver = Driver(card or FakeCard())
    assert driver.identify() == OK
    return driver


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


@given(st.binary(min_size=BLOCK, max_size=BLOCK), st.integers(0, (1 << 20) - 1))
def test_what_is_written_is_read(data, block):
    for card in (FakeCard(), FakeCard(is_sdhc=False)):
        driver = ready(card)
        assert driver.open(block) == OK
        assert driver.write(data) == OK
        assert driver.close() == OK
        assert card.content[block] == data
        assert driver.read(block) == OK
        assert driver.content == data
        assert lib.sdcard_is_idle(driver.state)


def test_a_run_is_one_command():
    driver = ready()
    assert driver.open(40) == OK
    for i in range(9):
        assert not lib.sdcard_is_idle(driver.state)
        assert driver.write(data_of(i)) == OK
    assert driver.close() == OK
    assert driver.card.runs == [(40, 9)]
    assert [driver.card.content[40 + i] for i in range(9)] == [*map(data_of, range(9))]
    assert driver.card.commands[-2:] == [25, 13]


@pytest.mark.parametrize("after_us", [0.0, 60.0, 1000.0, 99_000.0])
@pytest.mark.parametrize("pause", range(1, 9))
def test_a_read_waits_for_its_token_wherever_it_falls(after_us, pause):
    driver = ready()
    driver.card.read_us = after_us
    driver.card.pause = pause
    for i in range(20):
        driver.card.content[i] = data_of(i)
        assert driver.read(i) == OK
        assert driver.content == data_of(i)


def test_a_garbled_read_is_tried_again_and_counted():
    driver = ready()
    driver.card.content[3] = data_of(3)
    driver.card.garbled_reads = 2
    assert driver.read(3) == OK
    assert driver.content == data_of(3)
    assert driver.state.faults == 2
    driver.card.garbled_reads = 3
    assert driver.read(3) == GARBLED
    assert driver.state.faults == 5
    assert driver.read(3) == OK


def test_a_garbled_command_is_tried_again_and_counted():
    driver = ready()
    driver.card.garbled_commands = 2
    assert driver.check() == OK
    assert driver.state.faults == 2
    driver.card.garbled_commands = 3
    assert driver.check() == GARBLED


@pytest.mark.parametrize("garbled", range(1, 3))
def test_identification_survives_garbled_commands(garbled):
    card = FakeCard()
    card.garbled_commands = garbled
    assert Driver(card).identify() == OK


def test_an_unreadable_block_is_told_from_a_broken_card():
    driver = ready()
    driver.card.unreadable = {9}
    assert driver.read(9) == FAILED
    assert driver.read(8) == OK


def test_beyond_the_end_is_refused():
    driver = ready()
    assert driver.read(driver.card.size) == REFUSED
    assert driver.open(driver.card.size) == REFUSED
    assert driver.check() == OK


def test_a_read_without_data_ends_in_time():
    driver = ready()
    driver.card.read_us = 1e9
    begun = driver.wire.now_us
    assert driver.read(1) == TIMEOUT
    assert driver.wire.now_us - begun < 3_100_000


@pytest.mark.parametrize("stage", ["block", "stop"])
@pytest.mark.parametrize("busy_us", [0.0, 3.0, 99.0, 250_000.0, 999_000.0])
def test_a_busy_card_is_waited_for_and_measured(stage, busy_us):
    driver = ready()
    if stage == "block":
        driver.card.busy_us = lambda _: busy_us
    else:
        driver.card.stop_us = busy_us
    assert driver.open(5) == OK
    assert driver.write(data_of(5)) == OK
    if stage == "stop":
        assert driver.close() == OK
    # From a poll or two before to one behind.
    assert busy_us - 10 <= driver.state.busy_us <= busy_us + 200


def test_a_command_waits_for_a_card_that_is_busy():
    driver = ready()
    driver.card.busy_until = driver.wire.now_us + 50_000
    begun = driver.wire.now_us
    assert driver.read(3) == OK
    assert driver.wire.now_us - begun > 50_000
    assert driver.state.faults == 0


@pytest.mark.parametrize("stage", ["block", "stop"])
def test_a_card_that_stays_busy_is_a_fault(stage):
    driver = ready()
    driver.card.busy_us = lambda _: 2e6 if stage == "block" else 0
    driver.card.stop_us = 2e6
    assert driver.open(5) == OK
    begun = driver.wire.now_us
    result = driver.write(data_of(5))
    if stage == "stop":
        assert result == OK
        result = driver.close()
    assert result == TIMEOUT
    assert 1_000_000 <= driver.wire.now_us - begun < 1_100_000
    # It is taken up again, once it is done.
    driver.card.run = None
    assert driver.identify() == OK


@pytest.mark.parametrize(
    ("answer", "result"), [(WRITE_ERROR, FAILED), (BAD_CRC, GARBLED)]
)
def test_a_refused_block_ends_the_run_by_its_command(answer, result):
    driver = ready()
    driver.card.refuse = lambda block, _: answer if block == 6 else ACCEPTED
    assert driver.open(5) == OK
    assert driver.write(data_of(5)) == OK
    assert driver.write(data_of(6)) == result
    assert driver.card.commands[-2:] == [12, 13]
    assert lib.sdcard_is_idle(driver.state)
    assert driver.state.faults == 1
    assert driver.open(7) == OK
    assert driver.write(data_of(7)) == OK
    assert driver.close() == OK


def test_what_the_status_says_behind_a_run_counts():
    driver = ready()
    for bit in range(8):
        driver.card.status.append(1 << bit)
        assert driver.open(5) == OK
        assert driver.write(data_of(5)) == OK
        assert driver.close() == FAILED
    assert driver.state.faults == 8


@pytest.mark.parametrize("at", range(40))
def test_a_pull_at_any_exchange_is_told_and_the_card_taken_back(at):
    card = FakeCard()
    driver = ready(card)
    begun = driver.wire.exchanges

    def look(number: int) -> None:
        if number == begun + 1 + at:
            card.pull()

    driver.wire.on_exchange = look
    results = [driver.read(1), driver.open(2)]
    for block in range(2, 5):
        if results[-1] == OK:
            results.append(driver.write(data_of(block)))
    if results[-1] == OK:
        results.append(driver.close())
    results.append(driver.check())
    assert card.is_in or results[-1] == ABSENT
    assert not {*results} & {REFUSED, FAILED, TIMEOUT}
    card.power_up()
    assert driver.identify() == OK
    assert driver.check() == OK


def test_a_card_that_was_reset_by_itself_is_refused_until_identified():
    driver = ready()
    driver.card.is_ready = False
    assert driver.check() == REFUSED
    assert driver.identify() == OK
    assert driver.check() == OK


@pytest.mark.parametrize("operation", ["identify", "read", "open", "check"])
def test_a_bus_that_hangs_is_given_up(operation):
    driver = ready()
    driver.wire.is_stuck = True
    begun = driver.wire.now_us
    calls = {
        "identify": driver.identify,
        "read": lambda: driver.read(1),
        "open": lambda: driver.open(1),
        "check": driver.check,
    }
    assert calls[operation]() == TIMEOUT
    assert driver.wire.now_us - begun < 120_000
    driver.wire.is_stuck = False
    assert driver.identify() == OK


def test_time_may_wrap_amid_anything():
    card = FakeCard()
    driver = Driver(card)
    driver.wire.now_us = 2.0**32 - 1500
    assert driver.identify() == OK
    driver.wire.now_us = 2.0**33 - 500_000
    card.busy_us = lambda _: 900_000.0
    assert driver.open(1) == OK
    assert driver.write(data_of(1)) == OK
    assert 900_000 <= driver.state.busy_us < 901_000


@pytest.mark.parametrize("rate", [0.001, 0.05, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_noise_on_the_line_never_hangs_it(seed, rate):
    noise = random.Random(seed)  # noqa: S311, no secret

    class Noisy(FakeCard):
        def exchange(self, out: bytes, *rest: Any, **more: Any) -> bytes:
            said = bytearray(super().exchange(out, *rest, **more))
            for i in range(len(said)):
                if noise.random() < rate:
                    said[i] = noise.randrange(256)
            return bytes(said)

    card = Noisy()
    driver = Driver(card)
    driver.card.busy_us = lambda _: 0.0
    begun = driver.wire.now_us
    for operation in (driver.identify, lambda: driver.read(1), driver.check):
        assert operation() in (OK, ABSENT, TIMEOUT, REFUSED, GARBLED, FAILED)
    assert driver.wire.now_us - begun < 12_000_000
