# SPDX-License-Identifier: MIT
"""A Nano's bootloader as AVR061 and its sources describe it, in memory: what a cut
leaves can be looked at after each byte.
"""

from __future__ import annotations

PAGE = 128
SIZE = 32 * 1024


class Stk500Board:
    """A chip with a bootloader of that version, which begins at `begins_at`."""

    def __init__(
        self,
        flash: bytes = b"",
        *,
        major: int = 4,
        signature: bytes = b"\x1e\x95\x0f",
    ) -> None:
        self.flash = bytearray(flash.ljust(SIZE, b"\xff"))
        self.writes = 0  # of pages
        self.keeps = True  # False: a page that is written stays as it was
        self._major = major
        self._signature = signature
        self._heard = b""
        self._said = b""
        self._at = 0

    def read(self, size: int = 1, /) -> bytes:
        said, self._said = self._said[:size], self._said[size:]
        return said

    def write(self, data: bytes, /) -> int:
        self._heard += data
        while (length := self._length()) and len(self._heard) >= length:
            command, self._heard = self._heard[:length], self._heard[length:]
            self._said += self._answer(command)
        return len(data)

    def _length(self) -> int:
        """Of the command that was begun, with the 0x20 at its end."""
        if not self._heard:
            return 0
        fixed = {0x30: 2, 0x41: 3, 0x51: 2, 0x55: 4, 0x74: 5, 0x75: 2}
        if self._heard[0] == 0x64 and len(self._heard) >= 3:
            return 5 + int.from_bytes(self._heard[1:3], "big")
        return fixed.get(self._heard[0], 0)

    def _answer(self, command: bytes) -> bytes:
        if command[-1] != 0x20:
            return b"\x15"  # STK_NOSYNC
        body = b""
        match command[0]:
            case 0x41:
                body = bytes((self._major if command[1] == 0x81 else 0,))
            case 0x55:
                self._at = 2 * int.from_bytes(command[1:3], "little")
            case 0x64:
                self.writes += 1
                if self.keeps:
                    page = command[4:-1]
                    self.flash[self._at : self._at + len(page)] = page
            case 0x74:
                size = int.from_bytes(command[1:3], "big")
                body = bytes(self.flash[self._at : self._at + size])
            case 0x75:
                body = self._signature
        return b"\x14" + body + b"\x10"
