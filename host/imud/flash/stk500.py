# SPDX-License-Identifier: MIT
"""STK500, version 1: the protocol of the bootloaders of Arduinos.

Commands and answers are those of Atmel's application note AVR061 ("STK500
Communication Protocol"), of which ATmegaBOOT and Optiboot know the few below. No I/O of
its own: `wire` is a port.
"""

from __future__ import annotations

import time
from typing import Protocol

from imud.errors import FlashError

# AVR061, chapter "Parameter Definitions" and "Commands".
OK, FAILED, IN_SYNC, NO_SYNC, END = 0x10, 0x11, 0x14, 0x15, 0x20
GET_SYNC, GET_PARAMETER, LEAVE, LOAD_ADDRESS = 0x30, 0x41, 0x51, 0x55
PROGRAM_PAGE, READ_PAGE, READ_SIGNATURE = 0x64, 0x74, 0x75
FLASH = 0x46  # "F": the kind of memory
MAJOR, MINOR = 0x81, 0x82  # parameters: the version

# An answer takes its bytes' time, and the 4.5 ms of a page (ATmega328P, table 28-19); a
# busy machine may look for it later.
ANSWER_S = 1.0
# After a reset Optiboot blinks for 0.4 s, in which the UART keeps two bytes: a command.
# Of a second one it would get a half, and start the firmware. It listens for a second
# from the reset on, ATmegaBOOT for 1.3.
BEGIN_S = 0.1
SYNC_S = 0.45
SYNC_TRIES = 3
QUIET_S = 0.05  # after an answer: there may be another one, to a try before
ANSWER_MAX = 4096  # bytes of one read
_IN_SYNC = bytes((IN_SYNC, OK))


class NoBootloader(FlashError):
    """No answer from a bootloader."""


class BootWire(Protocol):
    """A port, as pyserial has it."""

    def write(self, data: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...  # as many as have come


class Stk500:
    """A bootloader that listens, from sync() on. Addresses and sizes are in bytes, and
    even. Each function raises FlashError for a wrong answer.
    """

    def __init__(self, wire: BootWire) -> None:
        self._wire = wire

    def sync(self) -> None:
        """Finds the beginning of an answer; NoBootloader if there is none. Bytes before
        it are the firmware's from before the reset, or an earlier answer.
        """
        self._listen(BEGIN_S)
        for _ in range(SYNC_TRIES):
            self._wire.write(bytes((GET_SYNC, END)))
            if self._listen(SYNC_S, end=_IN_SYNC).endswith(_IN_SYNC):
                self._listen(QUIET_S)
                return
        raise NoBootloader("no bootloader answers")

    def version(self) -> tuple[int, int]:
        """Of the bootloader: ATmegaBOOT has 1 or 2, Optiboot 4 and more."""
        major, minor = (
            self._ask("its version", bytes((GET_PARAMETER, which)), 1)[0]
            for which in (MAJOR, MINOR)
        )
        return major, minor

    def signature(self) -> bytes:
        """Three bytes that name the chip: 1e 95 0f is an ATmega328P."""
        return self._ask("the signature", bytes((READ_SIGNATURE,)), 3)

    def rewind(self) -> None:
        """Pages are erased as they are written, in any order."""

    def read(self, address: int, size: int) -> bytes:
        self._load(address)
        command = bytes((READ_PAGE, size // 256, size % 256, FLASH))
        return self._ask(f"the bytes at {address:#06x}", command, size)

    def write(self, address: int, page: bytes) -> None:
        """Erases a page and writes it."""
        self._load(address)
        head = bytes((PROGRAM_PAGE, len(page) // 256, len(page) % 256, FLASH))
        self._ask(f"the page at {address:#06x}", head + page, 0)

    def leave(self) -> None:
        """Makes it start the image."""
        self._ask("the end", bytes((LEAVE,)), 0)

    def _load(self, address: int) -> None:
        words = address // 2
        command = bytes((LOAD_ADDRESS, words % 256, words // 256))
        self._ask("the address", command, 0)

    def _ask(self, what: str, command: bytes, size: int) -> bytes:
        self._wire.write(command + bytes((END,)))
        answer = self._listen(ANSWER_S, size + 2)
        if (len(answer), answer[:1], answer[-1:]) != (
            size + 2,
            bytes((IN_SYNC,)),
            bytes((OK,)),
        ):
            raise FlashError(f"the bootloader did not answer for {what}")
        return answer[1:-1]

    def _listen(
        self, seconds: float, size: int = ANSWER_MAX, end: bytes | None = None
    ) -> bytes:
        """The bytes received in that time, at most `size`, or up to that end."""
        heard = b""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and len(heard) < size:
            heard += self._wire.read(size - len(heard))
            if end is not None and heard.endswith(end):
                break
        return heard
