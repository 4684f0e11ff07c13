# SPDX-License-Identifier: MIT
"""Writes an image page by page through a bootloader in the chip's own flash.

A cut leaves no half image that runs. The first page, where the processor begins, is
written first as an endless loop, and with its own bytes only when all the others were
read back and are right. The next reset by DTR starts the bootloader.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Protocol

from imud.errors import FlashError
from imud.flash import OnProgress
from imud.flash.errors import HalfWritten, WrongChip

BLANK = 0xFF
# AVR instruction set manual, RJMP: to itself. Not a jump into the bootloader: without a
# reset, Optiboot starts the firmware, each time with less room on the stack.
LOOP = b"\xff\xcf"

KNOWN_CHIPS = {
    bytes((0x1E, 0x95, 0x0F)): "ATmega328P",
    bytes((0x1E, 0x95, 0x14)): "ATmega328",
    bytes((0x1E, 0x95, 0x16)): "ATmega328PB",
    bytes((0x1E, 0x94, 0x06)): "ATmega168",
    bytes((0x1E, 0x94, 0x0B)): "ATmega168P",
    bytes((0x1E, 0x97, 0x03)): "ATmega1280",
    bytes((0x1E, 0x98, 0x01)): "ATmega2560",
    bytes((0x1E, 0x95, 0x87)): "ATmega32U4",
}


class Paged(Protocol):
    """A bootloader that writes pages, and may erase them in their order."""

    def signature(self) -> bytes: ...
    def rewind(self) -> None: ...
    def write(self, address: int, page: bytes, /) -> None: ...
    def read(self, address: int, size: int, /) -> bytes: ...
    def leave(self) -> None: ...


def check_chip(bootloader: Paged, fitting: tuple[bytes, ...]) -> str:
    """The chip's name; WrongChip if it is none of these, of which the first one gives
    the image its name.
    """
    signature = bootloader.signature()
    name = KNOWN_CHIPS.get(signature, f"an unknown chip ({signature.hex(' ')})")
    if signature not in fitting:
        wanted = KNOWN_CHIPS[fitting[0]]
        raise WrongChip(f"the board has {name}, and the image is for an {wanted}")
    return name


def write(
    bootloader: Paged,
    begins_at: int,
    size: int,
    image: Mapping[int, int],
    on_progress: OnProgress,
) -> int:
    """Writes the bytes of `image`, by their addresses, in pages of that size, and reads
    them back; returns how many pages there were. FlashError with what to do if that did
    not end well.
    """
    last = max(image, default=-1)
    if last < 0:
        raise FlashError("the image has no bytes")
    if last >= begins_at:
        raise FlashError(
            f"the image has {last + 1} bytes, but the bootloader starts at {begins_at}"
        )
    pages = {
        at: bytes(image.get(at + i, BLANK) for i in range(size))
        for at in range(0, last + 1, size)
    }
    first, others = pages[0], {at: page for at, page in pages.items() if at > 0}
    steps = 2 * len(others) + 4
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        on_progress(done, steps)

    def put(chosen: Mapping[int, bytes]) -> None:
        for at, page in chosen.items():
            bootloader.write(at, page)
            step()
        for at, page in chosen.items():
            _compare(at, page, bootloader.read(at, size))
            step()

    bootloader.rewind()  # if that fails, nothing was written
    try:
        put({0: LOOP.ljust(size, bytes((BLANK,)))})
        put(others)
        bootloader.rewind()
        put({0: first})
    except (FlashError, OSError) as error:
        raise HalfWritten(str(error)) from error
    return len(pages)


def leave(bootloader: Paged) -> None:
    """Has the image started. All of it was read back: if there is no answer any
    more, the next reset starts it.
    """
    with contextlib.suppress(FlashError, OSError):
        bootloader.leave()


def _compare(at: int, page: bytes, found: bytes) -> None:
    if found != page:
        raise FlashError(f"the page at {at:#06x} reads back wrong")
