# SPDX-License-Identifier: MIT
"""Writes an image into an Arduino Nano by the bootloader that it was sold with.

A cut leaves no half image that runs. The first page, where the processor begins, is
written first so that it leads back into the bootloader, and with its own bytes only
when all the others were read back and are right.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping

from imud.errors import FlashError
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
# Where each of them begins, and the first version that is Optiboot's.
OPTIBOOT_AT, ATMEGABOOT_AT = 0x7E00, 0x7800
OPTIBOOT_FROM = 4
_JMP = 0x940C  # AVR instruction set manual, JMP: then the address in words

# Opens the port at a rate and resets the board by it.
Reset = Callable[[int], contextlib.AbstractContextManager[BootWire]]
# How many bytes of how many are done.
OnProgress = Callable[[int, int], None]


class WrongChip(FlashError):
    """It is not the chip that the image is for."""


@contextlib.contextmanager
def reached(reset: Reset) -> Iterator[tuple[Stk500, int]]:
    """The bootloader, at the first rate where one answers, and where it begins."""
    for baud in BAUDS:
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
    last = max(image)
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
        guard = _jump(begins_at).ljust(PAGE, bytes((BLANK,)))
        for chosen in ({0: guard}, others, {0: first}):
            for at, page in chosen.items():
                bootloader.write(at, page)
                step()
            for at, page in chosen.items():
                _compare(at, page, bootloader.read(at, PAGE))
                step()
    except FlashError as error:
        raise FlashError(
            f"{error}: the board has no firmware that runs now; run imud flash again"
        ) from error
    return len(pages)


def _compare(at: int, page: bytes, found: bytes) -> None:
    if found != page:
        raise FlashError(f"the page at {at:#06x} was not kept")


def _jump(address: int) -> bytes:
    words = address // 2
    return _JMP.to_bytes(2, "little") + words.to_bytes(2, "little")
