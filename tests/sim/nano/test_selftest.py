# SPDX-License-Identifier: MIT
"""The virtual Nano passes its self-test, and fails without a correction of simavr."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import images
from programs import ran

pytestmark = pytest.mark.sampled(2)

ROOT = Path(__file__).resolve().parents[3]
NANO = ROOT / "build" / "sim" / "nano"

CORRECTIONS = (
    "twi_byte_time",
    "twi_address_status",
    "twi_flag",
    "twi_bus_held",
    "bus_lines",
    "interrupt_entry",
    "interrupt_flags",
    "external_flag",
    "uart_byte_time",
    "uart_double_buffer",
    "uart_baud_order",
    "uart_polling",
    "sleep",
    "eeprom_time",
    "eeprom_ready",
    "timer_preload",
    "watchdog_reset",
    "watchdog_modes",
    "reset_cause",
    "floating_input",
)


@pytest.fixture(scope="module", autouse=True)
def built() -> None:
    images.emulators()


def nano(*arguments: str) -> subprocess.CompletedProcess[str]:
    return ran(NANO, *arguments)


def test_the_machine_does_what_the_data_sheet_says() -> None:
    done = nano("--self-test")
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout
    assert all(line.startswith("PASS ") for line in lines)
    proven = {line.split()[1].rstrip(",:") for line in lines}
    assert proven >= set(CORRECTIONS)


@pytest.mark.parametrize("name", CORRECTIONS)
def test_a_correction_left_out_is_noticed(name: str) -> None:
    done = nano("--self-test", "--without", name)
    assert done.returncode == 1, done.stdout
    assert f"FAIL {name}" in done.stdout


def test_every_correction_is_on_the_list() -> None:
    done = nano("--self-test", "--without", "no such thing")
    assert done.returncode == 2
    assert tuple(done.stderr.split("there are:")[1].split()) == CORRECTIONS
