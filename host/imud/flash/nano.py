# SPDX-License-Identifier: MIT
"""Writes an image into an Arduino Nano by the bootloader that it was sold with."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping

from imud.flash import OnProgress, pages, serial_port
from imud.flash.stk500 import BootWire, NoBootloader, Stk500

# ATmega328P and ATmega328PB.
FITTING = (bytes((0x1E, 0x95, 0x0F)), bytes((0x1E, 0x95, 0x16)))

PAGE = 128  # bytes (ATmega328P, table 27-9)
BAUDS = (115_200, 57_600)  # of Optiboot, and of ATmegaBOOT on older Nanos
ROUNDS = 2  # of both: a busy machine may miss the second in which one listens
# Where each of them begins, and the first version that is Optiboot's.
OPTIBOOT_AT, ATMEGABOOT_AT = 0x7E00, 0x7800
OPTIBOOT_FROM = 4

# Opens the port at a rate and resets the board by it.
Reset = Callable[[int], contextlib.AbstractContextManager[BootWire]]


@contextlib.contextmanager
def reached(reset: Reset) -> Iterator[tuple[Stk500, int]]:
    """The bootloader, at the first rate where one answers, and where it begins."""
    for baud in ROUNDS * BAUDS:
        with reset(baud) as wire:
            bootloader = Stk500(wire)
            try:
                bootloader.sync()
            except NoBootloader:
                continue
            major, _ = bootloader.version()
            is_optiboot = major >= OPTIBOOT_FROM
            yield bootloader, OPTIBOOT_AT if is_optiboot else ATMEGABOOT_AT
            return
    raise NoBootloader(
        f"no bootloader answers at {' or '.join(map(str, BAUDS))} baud; is it an "
        "Arduino Nano with a bootloader?"
    )


def flash(port: str, image: Mapping[int, int], on_progress: OnProgress) -> int:
    """Writes an image to the Nano on a port, has it started, and returns how many pages
    there were. FlashError with what to do if that did not end well.
    """
    with reached(lambda baud: serial_port.reset(port, baud)) as (bootloader, begins_at):
        check_chip(bootloader)
        count = write(bootloader, begins_at, image, on_progress)
        pages.leave(bootloader)
    return count


def check_chip(bootloader: Stk500) -> str:
    """The chip's name; WrongChip if the image can't run on it."""
    return pages.check_chip(bootloader, FITTING)


def write(
    bootloader: Stk500,
    begins_at: int,
    image: Mapping[int, int],
    on_progress: OnProgress = lambda _done, _all: None,
) -> int:
    """As pages.write()."""
    return pages.write(bootloader, begins_at, PAGE, image, on_progress)
