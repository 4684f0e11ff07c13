# SPDX-License-Identifier: MIT
"""The peripherals of the virtual STM32F405, each used by a bare program of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

import bare

pytestmark = pytest.mark.sampled(2)

REGISTERS = [0x0F, 0x00, 0x08, 0x30, 0x00, 0x00]  # CTRL_REG1_G and on, set by i2c.c
AF, ARLO, BERR = 1 << 10, 1 << 9, 1 << 8
FAULTY = 19  # the transaction of i2c.c that the faults hit


# I2C


def test_one_to_six_bytes_come_as_the_manual_reads_them(tmp_path: Path) -> None:
    lines = bare.ended("i2c", tmp_path)
    assert set(lines["good"]) == {1}
    assert lines["who"] == [0xD449]
    assert lines["length"] == [1, 2, 3, 4, 5, 6, 3, 2]
    expected = [byte for n in lines["length"] for byte in REGISTERS[:n]]
    assert lines["data"] == expected
    assert lines["faulty"] == [1]


def test_a_late_nack_costs_a_third_byte(tmp_path: Path) -> None:
    assert bare.ended("i2c", tmp_path)["late"] == [0x0F0008]


def test_a_read_takes_the_time_of_its_bits(tmp_path: Path) -> None:
    # START, two bytes, START, two bytes, STOP: 39 bits at 320 kHz, plus some code.
    assert 122 <= bare.ended("i2c", tmp_path)["us"][0] <= 135


def test_an_address_that_nobody_has_is_refused(tmp_path: Path) -> None:
    lines = bare.ended("i2c", tmp_path)
    assert lines["nobody"] == [0]
    assert lines["af"] == [AF]
    assert lines["status"] == [0]


@pytest.mark.parametrize("byte", [0, 1])
def test_a_refused_byte_is_told(tmp_path: Path, byte: int) -> None:
    nack = {"kind": "nack", "transaction": FAULTY, "byte": byte}
    lines = bare.ended("i2c", tmp_path, *bare.faults(tmp_path, nack))
    assert lines["faulty"] == [0]
    assert lines["errors"] == [AF]
    assert lines["busy"] == [0]
    assert lines["length"][-1] == 2  # the next read works


@pytest.mark.parametrize("byte", range(9))
def test_a_held_line_is_clocked_free_by_hand(tmp_path: Path, byte: int) -> None:
    held = {"kind": "stuck_sda", "transaction": FAULTY, "byte": byte, "clocks": 4}
    lines = bare.ended("i2c", tmp_path, *bare.faults(tmp_path, held))
    assert lines["faulty"] == [0]
    assert lines["busy"] == [1]
    assert lines["pulses"] == [4]
    assert lines["free"] == [3]
    assert lines["length"][-1] == 2


def test_an_arbitration_lost_to_a_held_line_is_told(tmp_path: Path) -> None:
    # A held line turns the ones of the address after the second START into zeros.
    held = {"kind": "stuck_sda", "transaction": FAULTY, "byte": 2, "clocks": 4}
    lines = bare.ended("i2c", tmp_path, *bare.faults(tmp_path, held))
    assert lines["errors"] == [ARLO]


def test_a_stop_waits_for_a_held_line(tmp_path: Path) -> None:
    lines = bare.ended("i2c", tmp_path)
    assert lines["zero"] == [1]
    assert lines["zero_us"][0] < 120
    # The line is held for a millisecond, from the third byte on.
    held = {"kind": "stuck_sda", "at_us": lines["zero_at"][0] + 80, "for_us": 1000}
    lines = bare.ended("i2c", tmp_path, *bare.faults(tmp_path, held))
    assert lines["zero"] == [1]
    assert 1080 <= lines["zero_us"][0] <= 1100
    assert lines["faulty"] == [1]


def test_a_start_within_a_byte_is_a_bus_error(tmp_path: Path) -> None:
    at = bare.ended("i2c", tmp_path)["at"][0]
    glitch = {"kind": "glitch", "at_us": at + 300}
    lines = bare.ended("i2c", tmp_path, *bare.faults(tmp_path, glitch))
    assert lines["errors"] == [BERR]
    assert lines["faulty"] == [0]
    assert lines["length"][-1] == 2


def test_samples_by_interrupt_and_dma_at_each_edge(tmp_path: Path) -> None:
    lines = bare.ended("i2c_dma", tmp_path)
    assert lines["done"] == [50]
    assert lines["failed"] == [0]
    assert lines["edges"][0] in (49, 50)
    # Periods of 760 Hz that TIM3 captures in microseconds.
    assert lines["shortest"] == [1315]
    assert lines["longest"] == [1316]
    assert lines["axis"] == [0, 0, 0]  # the sensor lies still


# USART and DMA


def test_bytes_come_back_by_dma_when_the_line_falls_idle(tmp_path: Path) -> None:
    more = ("--send", "20000:48656c6c6f0a", "--send", "40000:313233340a")
    more += ("--send", "150000:414243")
    output = bare.run("usart", tmp_path, *more)
    assert output.data.startswith(b"Hello\n1234\n")
    assert output.lines["idles"] == [2]
    assert output.lines["sent"] == [2]
    # Overrun, idle and a byte, the first of three. Reading it clears the flags.
    assert output.lines["flags"] == [0x38, 0]
    assert output.lines["byte"] == [0x41]
    assert output.summary["uart_overruns"] == 2


def test_dma_can_not_reach_the_core_coupled_memory(tmp_path: Path) -> None:
    output = bare.run("usart", tmp_path)
    assert output.lines["dma"] == [1 << 3]  # TEIF
    assert output.lines["enabled"] == [0]
    assert output.summary["firmware_complaint"] == "DMA where it can't reach"


def test_the_ring_takes_more_than_its_length(tmp_path: Path) -> None:
    text = bytes(range(0x41, 0x41 + 26)) * 2
    more = [f"{20_000 + 2000 * i}:{text.hex()}" for i in range(3)]
    sends = [part for item in more for part in ("--send", item)]
    output = bare.run("usart", tmp_path, *sends)
    assert output.data.startswith(text * 3)
    assert output.summary["uart_overruns"] == 0


# Pins, timers


def test_the_button_is_seen_by_exti_and_capture(tmp_path: Path) -> None:
    lines = bare.ended("pins", tmp_path, "--press", "100000:200000")
    assert lines["floating"] == [0]
    assert lines["pulled"] == [1]
    assert lines["edge"] == [100_000, 200_000]
    assert lines["capture"] == [100_000]


# Flash


def test_flash_is_erased_and_programmed_in_its_time(tmp_path: Path) -> None:
    lines = bare.run("flash", tmp_path).lines
    assert lines["before"] == lines["erased"] == [0xFFFFFFFF]
    assert lines["erase_us"] == [pytest.approx(1_000_000, abs=10)] * 3
    assert lines["program_us"][0] == pytest.approx(8 * 16, abs=16)
    assert lines["first"] == [0xC0DE0000]
    assert lines["last"] == [0xC0DE0007]


@pytest.mark.nightly
def test_flash_without_an_erase_only_loses_ones(tmp_path: Path) -> None:
    output = bare.run("flash", tmp_path)
    assert output.lines["anded"] == [0x00DE0000]
    assert output.summary["firmware_complaint"] == "flash programmed that is not erased"


def test_a_store_of_another_width_is_refused(tmp_path: Path) -> None:
    lines = bare.run("flash", tmp_path).lines
    assert lines["errors"] == [1 << 6]  # PGPERR
    assert lines["byte"] == [0xFFFFFFFF]


def test_an_erase_stops_the_code_in_flash(tmp_path: Path) -> None:
    lines = bare.run("flash", tmp_path).lines
    assert lines["stall_us"][0] == pytest.approx(1_000_000, abs=10)
    assert lines["busy"] == [0]
    assert lines["ticks"] == [1]  # of the 1000 in that second
    assert lines["return_us"][0] == pytest.approx(1_000_000, abs=10)


def test_code_in_flash_becomes_other_code(tmp_path: Path) -> None:
    lines = bare.run("flash", tmp_path).lines
    assert lines["code"] == [1, 1, 2, 2]
    assert lines["gone"] == [1 << 16]  # UNDEFINSTR


def test_flash_is_locked_until_its_keys_come(tmp_path: Path) -> None:
    assert bare.run("flash", tmp_path).lines["locked"] == [1, 0, 1 << 31]


# ADC, SPI


def test_the_reference_is_what_its_calibration_says(tmp_path: Path) -> None:
    lines = bare.ended("adc", tmp_path)
    assert lines["reference"] == lines["calibration"] == [1502]
    assert lines["sum"] == [8 * 1502]
    assert lines["floating"] == [1]
    assert lines["signature"] == [1024]


def test_an_empty_socket_answers_ones(tmp_path: Path) -> None:
    lines = bare.ended("spi", tmp_path)
    assert lines["ready"] == [2]
    assert lines["busy"] == [0x80]
    assert lines["byte"] == [0xFF]
    assert lines["overrun"] == [0x43]
    assert lines["cleared"] == [2]
