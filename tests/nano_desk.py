# SPDX-License-Identifier: MIT
"""Runs of the virtual Nano with a firmware of a few orders, tests/sim/nano/desk.c."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import images
import native
from programs import ran

ROOT = Path(__file__).resolve().parent.parent
NANO = ROOT / "build" / "sim" / "nano"
SOURCE = ROOT / "tests" / "sim" / "nano" / "desk.c"
# Its orders, a byte each.
EEPROM, WILD, DEEP, ASLEEP, WORK, FLOOD, SAMPLES, TOO_MUCH = range(0xE0, 0xE8)
BOOT = b"R\x01\x00"  # power-on


def image() -> Path:
    """Build the firmware, and the emulator where it is not up to date."""
    images.emulators()
    flags = ("-std=gnu11", "-mmcu=atmega328p", "-Os", *native.WARNINGS)
    return images.program("avr-gcc", *flags, SOURCE)


def run(desk: Path, tmp_path: Path, *more: str, code: int = 0) -> tuple[bytes, Any]:
    """Run the firmware: the bytes that left the UART, and the summary."""
    record, summary = tmp_path / "bytes", tmp_path / "summary.json"
    done = ran(NANO, "--image", desk, "--record", record, "--summary", summary, *more)
    assert done.returncode == code, done.stderr
    return record.read_bytes(), json.loads(summary.read_text())


def faults(tmp_path: Path, *items: dict[str, Any]) -> str:
    """Write a file of faults. Return its path, for --faults."""
    path = tmp_path / "faults.json"
    path.write_text(json.dumps(items))
    return str(path)
