# SPDX-License-Identifier: MIT
"""Bootloaders that Nanos are sold with, as Intel HEX files for the virtual Nano.

They are in Debian's package arduino-core-avr and under the GPL: not part of the
project.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import images
from demanded import leave_out

PACKAGE = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
STUB = Path(__file__).resolve().parent / "system" / "bootloader_stub.S"

NONE = "none"
ATMEGABOOT = "ATmegaBOOT"
OPTIBOOT_4 = "Optiboot 4.4"
KEEPS_FLAGS = "Optiboot 8"  # a stand-in of ours
HANDS_OVER = "Optiboot 6"  # the same
EVERY = (NONE, ATMEGABOOT, OPTIBOOT_4, KEEPS_FLAGS, HANDS_OVER)

AT_7E00 = (
    *("avr-gcc", "-mmcu=atmega328p", "-nostartfiles", "-nostdlib"),
    "-Wl,-Ttext=0x7e00",
)
# Of its Makefile.
FLAGS_4 = (
    *("-w", "-Os", "-fno-inline-small-functions", "-fno-split-wide-types"),
    *("-mshort-calls", "-mrelax", "-DF_CPU=16000000L", "-DLED_START_FLASHES=3"),
    *("-DBAUD_RATE=115200", "-Wl,--section-start=.version=0x7ffe"),
)
# The hex file of the package is of no use: Debian's compiler makes 532 bytes, of which
# 20 are beyond the end of flash. With the attribute that Optiboot changed to it is 506.
FITS = "-Dnaked=OS_main"


def options(name: str) -> tuple[str, ...]:
    """Options that have the virtual Nano start with this bootloader."""
    return () if name == NONE else ("--bootloader", str(_hex(name)))


def _hex(name: str) -> Path:
    if name == ATMEGABOOT:
        return _of_package("atmega/ATmegaBOOT_168_atmega328.hex")
    if name == OPTIBOOT_4:
        source = _of_package("optiboot/optiboot.c")
        return _converted(images.program(*AT_7E00, *FLAGS_4, FITS, source))
    kind = ("-DKEEPS_FLAGS",) if name == KEEPS_FLAGS else ()
    return _converted(images.program(*AT_7E00, *kind, STUB))


def _converted(elf: Path) -> Path:
    made = elf.with_suffix(".hex")
    part = made.with_suffix(f".{os.getpid()}.part")
    subprocess.run(["avr-objcopy", "-O", "ihex", elf, part], check=True)
    return part.rename(made)


def _of_package(name: str) -> Path:
    path = PACKAGE / name
    if not path.exists():
        leave_out(f"{path} is not there")
    return path
