# SPDX-License-Identifier: MIT
"""A Mega's bootloader as AVR068 and its source describe it, in memory: what a cut
leaves can be looked at after each message.
"""

from __future__ import annotations

from functools import reduce
from operator import xor

PAGE = 256
SIZE = 256 * 1024
BOOTLOADER = 0x3E000


class Stk500v2Board:
    """A chip with that bootloader. Flash is as it is: writing only clears bits."""

    def __init__(
        self, flash: bytes = b"", *, signature: bytes = b"\x1e\x98\x01"
    ) -> None:
        self.flash = bytearray(flash.ljust(SIZE, b"\xff"))
        self.writes = 0  # of pages
        self.keeps = True  # False: a page that is written stays as it was
        self.erase_says = 0xC0  # STATUS_CMD_FAILED; older ones said 0
        self.has_left = False
        self._signature = signature
        self._heard = b""
        self._said = b""
        self._at = 0
        self._erased = 0  # the page that is erased next

    def read(self, size: int = 1, /) -> bytes:
        said, self._said = self._said[:size], self._said[size:]
        return said

    def write(self, data: bytes, /) -> int:
        self._heard += data
        while len(self._heard) >= 6:
            size = int.from_bytes(self._heard[2:4], "big")
            message, self._heard = self._heard[: size + 6], self._heard[size + 6 :]
            assert len(message) == size + 6
            if reduce(xor, message) == 0 and message[0] == 0x1B and message[4] == 0x0E:
                self.say(message[1], self._answer(message[5:-1]))
        return len(data)

    def say(self, number: int, body: bytes) -> None:
        answer = bytes((0x1B, number)) + len(body).to_bytes(2, "big") + b"\x0e" + body
        self._said += answer + bytes((reduce(xor, answer),))

    def _answer(self, body: bytes) -> bytes:
        match body[0]:
            case 0x01:
                return b"\x01\0\x08AVRISP_2"
            case 0x06:
                words = int.from_bytes(body[1:5], "big")
                assert words >> 31 == 1  # AVR068: more than 64 KB
                self._at = 2 * (words & 0x7FFF_FFFF)
            case 0x11:
                self.has_left = True
            case 0x12:
                self._erased = 0
                return bytes((0x12, self.erase_says))
            case 0x13:
                self._program(body[10:])
            case 0x14:
                size = int.from_bytes(body[1:3], "big")
                return b"\x14\0" + self.flash[self._at : self._at + size] + b"\0"
            case 0x1B:
                return bytes((0x1B, 0, self._signature[body[4]], 0))
        return bytes((body[0], 0))

    def _program(self, page: bytes) -> None:
        self.writes += 1
        if not self.keeps:
            return
        if self._erased < BOOTLOADER:
            self.flash[self._erased : self._erased + PAGE] = PAGE * b"\xff"
            self._erased += PAGE
        for i, byte in enumerate(page):
            self.flash[self._at + i] &= byte
