# SPDX-License-Identifier: MIT
"""Writes an image into an Arduino Mega 2560 by the bootloader that it was sold with."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping

from imud.errors import FlashError
from imud.flash import OnProgress, pages, serial_port
from imud.flash.firmware import MEGA_MAX
from imud.flash.stk500 import BootWire, NoBootloader
from imud.flash.stk500v2 import MONITOR, Stk500v2

FITTING = (bytes((0x1E, 0x98, 0x01)),)  # ATmega2560
PAGE = 256  # bytes (ATmega2560, table 30-7)
BAUD = 115_200
TRIES = 3  # a busy machine may miss the second in which it listens

# Opens the port and resets the board by it.
Reset = Callable[[], contextlib.AbstractContextManager[BootWire]]


@contextlib.contextmanager
def reached(reset: Reset) -> Iterator[Stk500v2]:
    """The bootloader, once it answers."""
    for _ in range(TRIES):
        with reset() as wire:
            bootloader = Stk500v2(wire)
            try:
                bootloader.sync()
            except NoBootloader:
                continue
            yield bootloader
            return
    raise NoBootloader(
        f"no bootloader answers at {BAUD} baud; is it an Arduino Mega 2560 with a "
        "bootloader?"
    )


def flash(port: str, image: Mapping[int, int], on_progress: OnProgress) -> int:
    """Writes an image to the Mega on a port, has it started, and returns how many pages
    there were. FlashError with what to do if that did not end well.
    """
    with reached(lambda: serial_port.reset(port, BAUD)) as bootloader:
        pages.check_chip(bootloader, FITTING)
        count = write(bootloader, image, on_progress)
        pages.leave(bootloader)
    return count


def write(
    bootloader: Stk500v2,
    image: Mapping[int, int],
    on_progress: OnProgress = lambda _done, _all: None,
) -> int:
    """As pages.write()."""
    size = max(image, default=-1) + 1
    for at in range(0, size, PAGE):
        page = bytes(image.get(at + i, 0) for i in range(PAGE))
        if MONITOR in page:
            raise FlashError(
                f"the image has {MONITOR.decode()} at {at + page.find(MONITOR):#x}, at "
                "which older bootloaders of a Mega hang: change it, or use a programmer"
            )
    return pages.write(bootloader, MEGA_MAX, PAGE, image, on_progress)
