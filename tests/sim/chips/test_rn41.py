# SPDX-License-Identifier: MIT
"""The model of the RN-41 against the manufacturer's documents: start, data, rates of
the UART, reset, faults.

Words and numbers are typed from the user's guide (RN-BT-DATA-UG 1.0r), the manual of
firmware 4.77 and the data sheet (DS50002280B), not taken from the model.
"""

from __future__ import annotations

import itertools

import pytest

from length import choose
from sim.chips.rn41_desk import FACTORY, LINK, SECOND, UP, Radio, lib, linked, settings


def test_no_pin_is_driven_until_it_is_ready() -> None:
    radio = Radio()
    for at in (0.0, 0.5, 0.999):
        radio.until(at)
        assert (radio.rts, radio.pio2) == (-1, -1)
    radio.until(UP)
    assert (radio.rts, radio.pio2) == (0, 0)


def test_a_host_connects_two_seconds_later() -> None:
    radio = Radio()
    radio.until(LINK - 0.001)
    assert radio.pio2 == 0
    radio.until(LINK)
    assert radio.pio2 == 1
    assert radio.counters.links == 1
    assert radio.output == b""  # status strings are off (UG, SO)


def test_bytes_while_it_starts_are_lost() -> None:
    radio = Radio()
    radio.send(b"abc")
    radio.until(LINK + 1)
    assert radio.heard == b""
    assert radio.counters.lost_to_host == 3


def test_data_goes_both_ways() -> None:
    radio = linked()
    sent = bytes(range(256))
    radio.send(sent)
    radio.host(sent[::-1])
    radio.wait(0.2)
    assert radio.heard == sent
    assert radio.output == sent[::-1]
    assert radio.rates == {FACTORY}
    counters = radio.counters
    assert (counters.to_host, counters.from_host) == (256, 256)
    assert (counters.lost_to_host, counters.lost_from_host) == (0, 0)


def test_without_a_host_data_is_lost_and_counted() -> None:
    radio = Radio()
    radio.until(UP + 0.5)
    radio.send(b"nobody hears this")
    radio.host(b"nor this")
    radio.until(LINK + 1)
    assert radio.heard == b""
    assert radio.output == b""
    assert radio.counters.lost_to_host == 17
    assert radio.counters.lost_from_host == 8


@pytest.mark.long
def test_240_kbit_a_second_go_through_for_long() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    start = radio.now
    sent = 0
    seconds = choose(everyday=1, long=5)
    while radio.now - start < seconds * SECOND:
        if radio.rts == 0:
            radio.send(b"x")
            sent += 1
        else:
            radio.wait(0.0001)
    assert len(radio.heard) / seconds == pytest.approx(30_000, rel=0.01)
    assert radio.counters.lost_to_host == 0
    radio.wait(1)
    assert len(radio.heard) == sent


def test_without_flow_control_what_has_no_room_falls_out() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    radio.send(b"x" * 10_000)
    radio.wait(1)
    lost = radio.counters.lost_to_host
    # 10,000 bytes come in 108.5 ms. The link carries 3255 of them; about 2 KB stay in
    # the buffer.
    assert 10_000 - 3255 - 2048 - 75 <= lost <= 10_000 - 3255 - 2048 + 150
    assert len(radio.heard) == 10_000 - lost


def test_rts_rises_before_the_buffer_is_full() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    while radio.rts == 0:
        radio.send(b"x")
    # There is still room for what a UART sends before it stops, even with a FIFO of
    # 16 bytes.
    radio.send(b"y" * 64)
    radio.wait(1)
    assert radio.rts == 0
    assert radio.counters.lost_to_host == 0


def test_cts_holds_it_after_the_byte_under_way() -> None:
    radio = linked()
    radio.host(bytes(75))
    radio.wait(0.0026)
    radio.cts(True)
    radio.wait(0.1)
    before = len(radio.output)
    assert before <= 2
    radio.cts(False)
    radio.wait(0.1)
    assert len(radio.output) == 75


def test_a_slow_probe_holds_the_host_up_and_loses_nothing() -> None:
    radio = linked()
    radio.cts(True)
    total = 0
    while lib.rn41_chip_host_room(radio.chip) > 0:
        radio.host(b"z")
        total += 1
        radio.wait(0.0001)
    assert total >= 4000  # the buffers of the module itself
    radio.cts(False)
    radio.wait(2)
    assert len(radio.output) == total
    assert radio.counters.lost_from_host == 0


def test_another_rate_is_garbage_both_ways() -> None:
    radio = Radio()
    radio.baud = 921_600
    radio.until(UP + 0.1)
    radio.send(b"$$$")
    radio.wait(2)
    assert radio.output == b""
    radio.until(LINK + 0.1)
    radio.send(b"hello, can you hear me at all?")
    radio.wait(1)
    # Eight frames at 921,600 baud last as long as one at 115,200.
    assert 0 < len(radio.heard) <= 6
    assert b"hello" not in radio.heard
    radio.baud = 9600
    heard = len(radio.heard)
    radio.send(b"slow")
    radio.wait(1)
    assert len(radio.heard) == heard + 4
    assert b"slow" not in radio.heard


@pytest.mark.parametrize(
    ("percent", "good"), [(0, True), (3.3, True), (-3.3, True), (3.4, False)]
)
def test_the_rates_may_differ_a_little(percent: float, good: bool) -> None:
    radio = linked()
    radio.baud = round(FACTORY * (1 + percent / 100))
    radio.send(bytes(range(100)))
    radio.wait(0.2)
    assert (radio.heard == bytes(range(100))) is good
    assert len(radio.heard) == 100


def test_a_reset_pulse_restarts_it() -> None:
    radio = linked()
    radio.send(b"x" * 100)
    radio.reset_pulse(10)
    assert (radio.rts, radio.pio2) == (-1, -1)
    counters = radio.counters
    assert counters.resets == 1
    assert counters.to_host + counters.lost_to_host == 100
    radio.wait(0.999)
    assert radio.pio2 == -1
    radio.wait(0.002)
    assert radio.pio2 == 0
    radio.wait(2)
    assert radio.pio2 == 1
    assert radio.complaint() is None


def test_it_stays_in_reset_while_the_pin_is_low() -> None:
    radio = linked()
    lib.rn41_chip_set_reset(radio.chip, radio.now, True)
    radio.wait(0.0039)
    assert radio.pio2 == 1
    radio.wait(0.0002)
    assert radio.pio2 == -1
    radio.wait(100)
    assert radio.pio2 == -1


@pytest.mark.parametrize(("ms", "resets"), [(1, 0), (3.9, 0), (4.5, 1)])
def test_a_short_pulse_is_a_complaint(ms: float, resets: int) -> None:
    radio = linked()
    radio.reset_pulse(ms)
    assert radio.counters.resets == resets
    assert radio.complaint() == "a reset pulse of less than 5 ms"


def test_a_dip_of_the_power_restarts_it() -> None:
    radio = linked()
    lib.rn41_chip_power_cycle(radio.chip, radio.now)
    assert radio.pio2 == -1
    radio.wait(LINK)
    assert radio.pio2 == 1


def test_a_dropped_link_loses_what_is_in_the_buffer() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    radio.fault("DROP", radio.now / SECOND + 0.01, 5)
    radio.send(b"x" * 1000)  # takes 10.85 ms; the link drops after 10
    radio.host(b"y")
    radio.wait(0.1)
    assert radio.pio2 == 0
    counters = radio.counters
    assert len(radio.heard) == counters.to_host == 3 * 75
    assert counters.lost_to_host == 775
    assert counters.lost_from_host == 1
    radio.wait(4.8)
    assert radio.pio2 == 0
    radio.wait(0.2)
    assert radio.pio2 == 1
    assert counters.resets == 0
    assert radio.counters.links == 2


def test_a_host_that_is_away_comes_later() -> None:
    radio = Radio()
    radio.fault("AWAY", 0, 30)
    radio.until(29.9)
    assert radio.pio2 == 0
    radio.until(30.1)
    assert radio.pio2 == 1


def test_a_deaf_module_answers_nothing() -> None:
    radio = Radio()
    radio.fault("DEAF", 0, 10)
    radio.until(UP + 0.1)
    radio.send(b"$$$")
    radio.until(10)
    assert radio.output == b""
    assert radio.counters.lost_to_host == 3
    radio.command(11)


def test_one_that_restarts_by_itself_connects_again() -> None:
    radio = linked()
    radio.fault("RESET", LINK + 1)
    radio.until(LINK + 1.5)
    assert radio.pio2 == -1
    radio.until(LINK + 1 + LINK + 0.1)
    assert radio.pio2 == 1
    assert radio.counters.resets == 1


def test_what_has_no_model_is_a_complaint() -> None:
    radio = Radio()
    radio.command()
    assert radio.ask("SW,0320") == "?\r\n"
    assert radio.complaint() == "a setting that is not modelled"


def test_time_in_any_steps_is_the_same() -> None:
    runs = []
    for step in (0.0001, 0.0013, 1.0):
        radio = linked()
        radio.host(bytes(500))
        for _ in itertools.repeat(None, round(1.3 / step) + 1):
            radio.wait(step)
        runs.append((len(radio.output), radio.counters.from_host))
    assert runs == [(500, 500)] * 3
