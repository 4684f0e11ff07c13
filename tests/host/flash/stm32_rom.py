# SPDX-License-Identifier: MIT
"""The bootloader in an STM32F405's ROM, as AN3155's flow charts and RM0090's flash
module describe it, on a pty.
"""

from __future__ import annotations

import os
import threading
import tty

BASE = 0x0800_0000
# RM0090, table 5: where each sector begins, and the end.
SECTOR_AT = (
    *(0x0000, 0x4000, 0x8000, 0xC000, 0x10000, 0x20000, 0x40000, 0x60000),
    *(0x80000, 0xA0000, 0xC0000, 0xE0000, 0x100000),
)
YES, NO = b"\x79", b"\x1f"


class Stm32Rom:
    """Answers until it is closed. `stops_after`: writes after which it is unplugged."""

    def __init__(
        self, flash: bytes = b"", *, chip: int = 0x413, stops_after: int | None = None
    ) -> None:
        self.flash = bytearray(flash.ljust(0x100000, b"\xff"))
        self.erased: list[int] = []
        self.started_at: int | None = None
        self.writes = 0
        self._chip = chip
        self._stops_after = stops_after
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def ended(self) -> None:
        """Waits until the image was started."""
        self._thread.join()

    def close(self) -> None:
        for descriptor in (self._theirs, self._ours):
            os.close(descriptor)
        self._thread.join()

    def _take(self, size: int) -> bytes:
        heard = b""
        while len(heard) < size:
            heard += os.read(self._ours, size - len(heard))
        return heard

    def _say(self, data: bytes) -> None:
        os.write(self._ours, data)

    def _serve(self) -> None:
        is_synced = False
        try:
            while True:
                byte = self._take(1)
                if not is_synced:
                    is_synced = byte == b"\x7f"
                    self._say(YES if is_synced else b"")
                elif self._take(1)[0] != byte[0] ^ 0xFF:
                    self._say(NO)
                elif not self._command(byte[0]):
                    return
        except OSError:
            return

    def _command(self, command: int) -> bool:
        """Whether it goes on."""
        match command:
            case 0x02:
                self._say(YES + b"\x01" + self._chip.to_bytes(2, "big") + YES)
            case 0x11:
                self._say(YES)
                at = self._address()
                size, complement = self._take(2)
                good = size ^ 0xFF == complement
                found = bytes(self.flash[at : at + size + 1])
                self._say(YES + found if good else NO)
            case 0x21:
                self._say(YES)
                self.started_at = BASE + self._address()
                return False
            case 0x31:
                self._say(YES)
                at = self._address()
                (size,) = self._take(1)
                data = self._take(size + 1)
                if self.writes == self._stops_after:
                    return False
                self.writes += 1
                is_good = self._is_sum(bytes((size,)) + data) and len(data) % 4 == 0
                if is_good:  # programming only clears bits
                    old = self.flash[at : at + len(data)]
                    kept = bytes(a & b for a, b in zip(old, data, strict=True))
                    self.flash[at : at + len(data)] = kept
                self._say(YES if is_good else NO)
            case 0x44:
                self._say(YES)
                count = self._take(2)
                numbers = self._take(2 * (int.from_bytes(count, "big") + 1))
                if self._is_sum(count + numbers):
                    for i in range(0, len(numbers), 2):
                        self._erase(int.from_bytes(numbers[i : i + 2], "big"))
                    self._say(YES)
                else:
                    self._say(NO)
            case _:
                self._say(NO)
        return True

    def _erase(self, sector: int) -> None:
        begin, end = SECTOR_AT[sector : sector + 2]
        self.flash[begin:end] = b"\xff" * (end - begin)
        self.erased.append(sector)

    def _address(self) -> int:
        raw = self._take(4)
        is_good = self._is_sum(raw)
        self._say(YES if is_good else NO)
        return int.from_bytes(raw, "big") - BASE

    def _is_sum(self, data: bytes) -> bool:
        found = 0
        for byte in data:
            found ^= byte
        return self._take(1)[0] == found
