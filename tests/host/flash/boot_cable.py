# SPDX-License-Identifier: MIT
"""What tests of bootloaders share: a cable that is pulled, nobody at its end, and the
page that stands for an image that is not whole.
"""

from __future__ import annotations

# AVR instruction set manual, RJMP: 1100 kkkk kkkk kkkk, to PC + k + 1 with k = -1.
LOOP = (0b1100_1111_1111_1111).to_bytes(2, "little")


class Cut(Exception):
    """The cable was pulled."""


class Mute:
    """Nobody."""

    def write(self, data: bytes, /) -> int:
        return len(data)

    def read(self, _: int = 1, /) -> bytes:
        return b""
