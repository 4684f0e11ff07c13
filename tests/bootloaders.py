# SPDX-License-Identifier: MIT
"""Bootloaders that boards are sold with, as Intel HEX files for virtual ones.

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
# Those of a Mega, and as it was until 2012, when it did not stop a watchdog.
STK500BOOT = "stk500boot"
STK500BOOT_OLD = "stk500boot of 2011"
# By processor, one that does not stop a watchdog.
RUNS_ON = {"atmega328p": ATMEGABOOT, "atmega2560": STK500BOOT_OLD}

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


AT_3E000 = (
    *("avr-gcc", "-mmcu=atmega2560", "-DF_CPU=16000000UL", "-D_MEGA_BOARD_", "-w"),
    *("-Os", "-funsigned-char", "-fpack-struct", "-fshort-enums", "-std=gnu99"),
    *("-Wl,--section-start=.text=3E000", "-I", str(PACKAGE / "stk500v2")),
)
STOPS_WATCHDOG = "#define\t_FIX_ISSUE_181_\n"


def options(name: str) -> tuple[str, ...]:
    """Options that have the virtual Nano start with this bootloader."""
    return () if name == NONE else ("--bootloader", str(_hex(name)))


def _hex(name: str) -> Path:
    if name == ATMEGABOOT:
        return _of_package("atmega/ATmegaBOOT_168_atmega328.hex")
    if name == STK500BOOT:
        return _of_package("stk500v2/stk500boot_v2_mega2560.hex")
    if name == STK500BOOT_OLD:
        return _converted(images.program(*AT_3E000, _old_stk500boot()))
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


def _old_stk500boot() -> Path:
    source = _of_package("stk500v2/stk500boot.c")
    text = source.read_text(errors="replace")
    assert text.count(STOPS_WATCHDOG) == 1
    made = images.CACHE / "stk500boot_old.c"
    part = made.with_suffix(f".{os.getpid()}.c")
    images.CACHE.mkdir(parents=True, exist_ok=True)
    part.write_text(text.replace(STOPS_WATCHDOG, ""))
    return part.rename(made)


def _of_package(name: str) -> Path:
    path = PACKAGE / name
    if not path.exists():
        leave_out(f"{path} is not there")
    return path
