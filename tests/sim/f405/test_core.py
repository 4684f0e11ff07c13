# SPDX-License-Identifier: MIT
"""The core of the virtual STM32F405: exceptions, faults, FPU, sleep, clocks."""

from __future__ import annotations

from pathlib import Path

import pytest

import bare


def test_the_clock_comes_up_as_the_manual_says(tmp_path: Path) -> None:
    lines = bare.ended("clock", tmp_path)
    assert lines["reset"] == [0x83]
    assert lines["hse_us"][0] == pytest.approx(2000, abs=3)
    assert lines["pll_us"][0] == pytest.approx(150, abs=3)
    assert lines["sws"] == [2, 2]
    # 168 MHz, within one turn of the waiting loop.
    assert lines["cycles_a_ms"][0] == pytest.approx(168_000, abs=200)
    assert lines["alarms"] == [0]


def test_a_crystal_that_dies_leaves_hsi_and_an_alarm(tmp_path: Path) -> None:
    faults = bare.faults(tmp_path, {"kind": "crystal", "at_us": 4500})
    lines = bare.ended("clock", tmp_path, *faults)
    assert lines["alarms"] == [1]
    assert lines["sws"] == [2, 0]
    assert lines["hse"] == [1, 0]


def test_a_dead_crystal_never_is_ready(tmp_path: Path) -> None:
    faults = bare.faults(tmp_path, {"kind": "crystal"})
    lines = bare.ended("clock", tmp_path, *faults)
    assert lines["hse"] == [0]
    assert "pll_us" not in lines


# Ticks of HSI between captures by the divider and the prescaler of the program; the
# last asks for a divider that gives no clock, the first is before the crystal swings.
@pytest.mark.parametrize(
    ("mhz", "ticks"),
    [
        ("4", [0, 992, 124, 320, 0]),
        ("8", [0, 496, 62, 160, 0]),
        ("12", [0, 330.67, 41.33, 106.67, 0]),
        ("25", [0, 158.72, 19.84, 51.2, 0]),
    ],
)
def test_tim11_captures_the_divided_crystal(
    tmp_path: Path, mhz: str, ticks: list[float]
) -> None:
    lines = bare.ended("crystal", tmp_path, "--crystal", mhz)
    assert lines["ticks"] == pytest.approx(ticks, abs=1)
    assert lines["status"] == [0x202]  # a capture, and one over it


def test_tim11_counts_by_an_oscillator_that_is_off(tmp_path: Path) -> None:
    lines = bare.ended("crystal", tmp_path, "--crystal", "8", "--hsi", "16.64")
    assert lines["ticks"] == pytest.approx([0, 515.8, 64.5, 166.4, 0], abs=1)


def test_a_clock_that_stops_leaves_the_watchdog(tmp_path: Path) -> None:
    faults = bare.faults(tmp_path, {"kind": "crystal", "at_us": 50_000})
    output = bare.run("stopped", tmp_path, *faults)
    assert output.lines["cause"] == [0x0E, 0x24]
    # The program restarts its clock 2 ms after power-up, when the crystal is ready.
    assert output.lines["last_us"][0] == pytest.approx(47_800, abs=100)
    assert output.summary["seconds"] == pytest.approx(0.15, abs=0.001)


def test_exceptions_nest_by_priority(tmp_path: Path) -> None:
    lines = bare.ended("nvic", tmp_path)
    # 61 interrupts 60. 62 has the priority of 60 and comes after it, 63 comes last.
    # Then thread mode continues.
    high = [0x61, 0x1000 + 16 + 61, 0x161]
    assert lines["nesting"] == [0x60, *high, 0x160, 0x62, 0x63, 0xEE]
    assert lines["calls"] == [0xAA, 1, 0xBB, 2]
    assert lines["masks"] == [1, 0x63, 2, 3, 0x60, *high, 0x160, 0x62, 0x63, 4]


def test_a_window_without_a_barrier_lets_nothing_in(tmp_path: Path) -> None:
    lines = bare.ended("nvic", tmp_path)
    assert lines["window"] == [0]
    assert lines["window_isb"] == [1]


def test_an_interrupt_whose_cause_stays_comes_again(tmp_path: Path) -> None:
    assert bare.ended("nvic", tmp_path)["levels"] == [3]


def test_systick_counts_and_flags(tmp_path: Path) -> None:
    lines = bare.ended("nvic", tmp_path)
    assert lines["ticks"] == [16]
    assert lines["flag"] == [1, 0]
    assert lines["load"] == [1]


def test_sleep_takes_time_and_no_cycles(tmp_path: Path) -> None:
    output = bare.run("sleep", tmp_path)
    assert output.lines["us"][0] == pytest.approx(250_000, abs=10)
    assert output.lines["awake"][0] < 250 * 20
    assert output.summary["idle"] > 0.99


def test_a_masked_interrupt_wakes_and_waits(tmp_path: Path) -> None:
    lines = bare.run("sleep", tmp_path).lines
    assert lines["masked"] == [0]
    assert lines["unmasked"] == [1]


def test_the_fpu_faults_without_access_to_it(tmp_path: Path) -> None:
    lines = bare.ended("fpu", tmp_path)
    assert lines["faults"] == [1]
    assert lines["status"] == [1 << 19]  # NOCP


def test_fpu_registers_survive_handlers_that_use_them(tmp_path: Path) -> None:
    lines = bare.ended("fpu", tmp_path)
    assert lines["interrupts"] == [1]
    assert lines["alone"] == lines["together"] == [0x3FFFFFF0]
    assert lines["fpscr"] == [0]


def test_faults_say_what_and_where(tmp_path: Path) -> None:
    output = bare.run("fault", tmp_path)
    lines = output.lines
    forced, bus_read, bus_write = 1 << 30, 0x8200, 0x400
    undefined, division = 1 << 16, 1 << 25
    # A bus fault becomes a hard fault while its own handler is disabled.
    assert lines["hfsr"] == [forced, 0, 0, 0]
    assert lines["cfsr"] == [bus_read, bus_write, undefined, division]
    assert lines["bfar"][0] == 0x70000010
    # The bus refuses a store late: the processor is two bytes further.
    assert lines["pc"] == [0, 2, 0, 0]
    assert lines["after"] == [1]


def test_a_fault_in_the_handler_of_faults_locks_up(tmp_path: Path) -> None:
    output = bare.run("fault", tmp_path)
    assert "locked up" in output.errors
    assert output.summary["crashed"] is True
