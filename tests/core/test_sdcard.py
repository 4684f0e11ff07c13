# SPDX-License-Identifier: MIT
"""The SD card's driver: blocks read and written, and every way in which that fails."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.fake_card import ACCEPTED, BAD_CRC, BLOCK, WRITE_ERROR, FakeCard
from core.sdcard_desk import (
    ABSENT,
    FAILED,
    GARBLED,
    OK,
    REFUSED,
    TIMEOUT,
    Driver,
    lib,
    ready,
)

pytestmark = pytest.mark.sampled(3)


def data_of(seed: int) -> bytes:
    return bytes((seed * 31 + i * (seed % 7 + 1)) % 256 for i in range(BLOCK))


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


@pytest.mark.parametrize("byte", [0, 512, 513])
def test_a_garbled_read_is_tried_again_and_counted(byte):
    driver = ready()
    driver.card.content[3] = data_of(3)
    driver.card.garbled_byte = byte
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
            answer = bytearray(super().exchange(out, *rest, **more))
            for i in range(len(answer)):
                if noise.random() < rate:
                    answer[i] = noise.randrange(256)
            return bytes(answer)

    card = Noisy()
    driver = Driver(card)
    driver.card.busy_us = lambda _: 0.0
    begun = driver.wire.now_us
    for operation in (driver.identify, lambda: driver.read(1), driver.check):
        assert operation() in (OK, ABSENT, TIMEOUT, REFUSED, GARBLED, FAILED)
    assert driver.wire.now_us - begun < 12_000_000
