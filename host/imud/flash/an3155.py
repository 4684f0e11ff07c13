# SPDX-License-Identifier: MIT
"""The bootloader in the ROM of STM32s, over a serial port: ST's application note
AN3155, "USART protocol used in the STM32 bootloader". 8 data bits, even parity.

No I/O of its own: `wire` is a port.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Protocol

from imud.errors import FlashError

# AN3155, "Bootloader command set" and the sections of its commands.
ACK, NACK, INIT = 0x79, 0x1F, 0x7F
GET_ID, READ, GO, WRITE, EXTENDED_ERASE = 0x02, 0x11, 0x21, 0x31, 0x44

BLOCK_MAX = 256  # bytes of a read or write
ANSWER_S = 1.0
SYNC_S = 0.2
# RM0090 has no times; DS8626, "Flash memory programming": a sector of 128 KB takes 4 s
# at most with 8-bit parallelism.
ERASE_S = 4.0


class NoRom(FlashError):
    """No answer from the ROM."""


class RomWire(Protocol):
    """A port, as pyserial has it."""

    def write(self, data: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def reset_input_buffer(self) -> None: ...


class An3155:
    """A ROM that listens, from sync() on. Each function raises FlashError for a wrong
    answer.
    """

    def __init__(self, wire: RomWire) -> None:
        self._wire = wire

    def sync(self, seconds: float) -> None:
        """Has it measure the baud rate; NoRom if it does not answer in that time. A ROM
        that has measured it before refuses the byte, which is as good an answer.
        """
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            self._wire.reset_input_buffer()
            self._wire.write(bytes((INIT,)))
            if self._listen(1, SYNC_S) in (bytes((ACK,)), bytes((NACK,))):
                return
        raise NoRom(f"no bootloader of an STM32 answered for {seconds:g} s")

    def chip(self) -> int:
        """The product's id: 0x413 is an STM32F405 or F407 (AN2606)."""
        self._command(GET_ID, "its id")
        found = self._listen(4, ANSWER_S)
        if len(found) != 4 or found[0] != 1 or found[3] != ACK:
            raise FlashError("the bootloader did not send its id")
        return int.from_bytes(found[1:3], "big")

    def erase(self, sectors: Sequence[int]) -> None:
        self._command(EXTENDED_ERASE, "erasing")
        words = (len(sectors) - 1, *sectors)
        self._send(b"".join(each.to_bytes(2, "big") for each in words))
        self._expect("erasing", ERASE_S * len(sectors))

    def write(self, address: int, data: bytes) -> None:
        """Up to BLOCK_MAX bytes, a multiple of four."""
        what = f"the bytes at {address:#010x}"
        self._command(WRITE, what)
        self._address(address, what)
        self._send(bytes((len(data) - 1,)) + data)
        self._expect(what, ANSWER_S)

    def read(self, address: int, size: int) -> bytes:
        """Up to 256 bytes of flash or RAM from an address; FlashError without an
        answer.
        """
        what = f"the bytes at {address:#010x}"
        self._command(READ, what)
        self._address(address, what)
        self._wire.write(bytes((size - 1, (size - 1) ^ 0xFF)))
        self._expect(what, ANSWER_S)
        found = self._listen(size, ANSWER_S)
        if len(found) != size:
            raise FlashError(f"the bootloader did not answer for {what}")
        return found

    def go(self, address: int) -> None:
        """Starts the image there."""
        self._command(GO, "the start")
        self._address(address, "the start")

    def _command(self, command: int, what: str) -> None:
        self._wire.write(bytes((command, command ^ 0xFF)))
        self._expect(what, ANSWER_S)

    def _address(self, address: int, what: str) -> None:
        self._send(address.to_bytes(4, "big"))
        self._expect(what, ANSWER_S)

    def _send(self, data: bytes) -> None:
        """With its checksum: the exclusive or of all bytes."""
        self._wire.write(data + bytes((reduce(xor, data),)))

    def _expect(self, what: str, seconds: float) -> None:
        answer = self._listen(1, seconds)
        if answer == bytes((NACK,)):
            raise FlashError(f"the bootloader refused {what}")
        if answer != bytes((ACK,)):
            raise FlashError(f"the bootloader did not answer for {what}")

    def _listen(self, size: int, seconds: float) -> bytes:
        heard = b""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and len(heard) < size:
            heard += self._wire.read(size - len(heard))
        return heard
