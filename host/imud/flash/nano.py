# SPDX-License-Identifier: MIT
"""Writes an image into an Arduino Nano by the bootloader that it was sold with.

A cut leaves no half image that runs. The first page, where the processor begins, is
written first as an endless loop, and with its own bytes only when all the others were
read back and are right. The next reset by DTR starts the bootloader.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping

from imud.errors import FlashError
from imud.flash import OnProgress, serial_port
from imud.flash.errors import HalfWritten, WrongChip
from imud.flash.stk500 import BootWire, NoBootloader, Stk500

ATMEGA328P = bytes((0x1E, 0x95, 0x0F))  # and ATmega328PB: 1e 95 16
KNOWN_CHIPS = {
    ATMEGA328P: "ATmega328P",
    bytes((0x1E, 0x95, 0x14)): "ATmega328",
    bytes((0x1E, 0x95, 0x16)): "ATmega328PB",
    bytes((0x1E, 0x94, 0x06)): "ATmega168",
    bytes((0x1E, 0x94, 0x0B)): "ATmega168P",
    bytes((0x1E, 0x98, 0x01)): "ATmega2560",
    bytes((0x1E, 0x95, 0x87)): "ATmega32U4",
}
FITTING = (ATMEGA328P, bytes((0x1E, 0x95, 0x16)))

PAGE = 128  # bytes (ATmega328P, table 27-9)
BLANK = 0xFF
BAUDS = (115_200, 57_600)  # of Optiboot, and of ATmegaBOOT on older Nanos
ROUNDS = 2  # of both: a busy machine may miss the second in which one listens
# Where each of them begins, and the first version that is Optiboot's.
OPTIBOOT_AT, ATMEGABOOT_AT = 0x7E00, 0x7800
OPTIBOOT_FROM = 4
# AVR instruction set manual, RJMP: to itself. Not a jump into the bootloader: without a
# reset, Optiboot starts the firmware, each time with less room on the stack.
LOOP = b"\xff\xcf"

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
        "Arduino Nano, and has it one?"
    )


def flash(port: str, image: Mapping[int, int], on_progress: OnProgress) -> int:
    """Writes an image to the Nano on a port, has it started, and returns how many pages
    there were. FlashError with what to do if that did not end well.
    """
    with reached(lambda baud: serial_port.reset(port, baud)) as (bootloader, begins_at):
        check_chip(bootloader)
        pages = write(bootloader, begins_at, image, on_progress)
        bootloader.leave()
    return pages


def check_chip(bootloader: Stk500) -> str:
    """The chip's name; WrongChip if the image can't run on it."""
    signature = bootloader.signature()
    name = KNOWN_CHIPS.get(signature, f"an unknown chip ({signature.hex(' ')})")
    if signature not in FITTING:
        raise WrongChip(f"the board has {name}, and the image is for an ATmega328P")
    return name


def write(
    bootloader: Stk500,
    begins_at: int,
    image: Mapping[int, int],
    on_progress: OnProgress = lambda _done, _all: None,
) -> int:
    """Writes the bytes of `image`, by their addresses, and reads them back; returns how
    many pages there were. FlashError with what to do if that did not end well.
    """
    last = max(image, default=-1)
    if last < 0:
        raise FlashError("the image has no bytes")
    if last >= begins_at:
        raise FlashError(
            f"the image has {last + 1} bytes, and the bootloader begins at {begins_at}"
        )
    pages = {
        at: bytes(image.get(at + i, BLANK) for i in range(PAGE))
        for at in range(0, last + 1, PAGE)
    }
    first, others = pages[0], {at: page for at, page in pages.items() if at > 0}
    steps = 2 * len(others) + 4
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        on_progress(done, steps)

    try:
        guard = LOOP.ljust(PAGE, bytes((BLANK,)))
        for chosen in ({0: guard}, others, {0: first}):
            for at, page in chosen.items():
                bootloader.write(at, page)
                step()
            for at, page in chosen.items():
                _compare(at, page, bootloader.read(at, PAGE))
                step()
    except (FlashError, OSError) as error:
        raise HalfWritten(str(error)) from error
    return len(pages)


def _compare(at: int, page: bytes, found: bytes) -> None:
    if found != page:
        raise FlashError(f"the page at {at:#06x} was not kept")
