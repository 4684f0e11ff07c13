# SPDX-License-Identifier: MIT
"""The SD card's driver with an emulated card on a desk."""

from __future__ import annotations

from typing import Any

import pytest

import native
from core.fake_card import BLOCK, FakeCard
from core.fake_spi import Wire

ffi, lib = native.load()
OK, ABSENT, TIMEOUT = lib.SDCARD_OK, lib.SDCARD_ABSENT, lib.SDCARD_TIMEOUT
REFUSED, GARBLED, FAILED = lib.SDCARD_REFUSED, lib.SDCARD_GARBLED, lib.SDCARD_FAILED


class Driver:
    """The driver over a wire, an operation at a time."""

    def __init__(self, card: FakeCard) -> None:
        self.wire = Wire(ffi, card)
        self.card = card
        self.state = ffi.new("struct sdcard *")
        self.steps_at_once = 0
        lib.sdcard_init(self.state, self.wire.device)

    def finish(self) -> int:
        in_a_row = 0
        for _ in range(200_000):
            result = lib.sdcard_step(self.state, self.wire.time)
            if result <= 0:
                return int(result)
            if result == lib.SDCARD_WAITS:
                self.wire.sleep()
                in_a_row = 0
            else:
                in_a_row += 1
                assert in_a_row < 10, "it never lets go"
        pytest.fail("an endless operation")

    def identify(self) -> int:
        lib.sdcard_identify(self.state)
        return self.finish()

    def read(self, block: int) -> int:
        lib.sdcard_read(self.state, block)
        return self.finish()

    def check(self) -> int:
        lib.sdcard_check(self.state)
        return self.finish()

    def open(self, block: int) -> int:
        lib.sdcard_open(self.state, block)
        return self.finish()

    def write(self, data: bytes) -> int:
        ffi.memmove(self.block, data, BLOCK)
        lib.sdcard_write(self.state)
        return self.finish()

    def close(self) -> int:
        lib.sdcard_close(self.state)
        return self.finish()

    @property
    def block(self) -> Any:
        return lib.sdcard_block(self.state)

    @property
    def content(self) -> bytes:
        return bytes(ffi.buffer(self.block, BLOCK))


def ready(card: FakeCard | None = None) -> Driver:
    driver = Driver(card or FakeCard())
    assert driver.identify() == OK
    return driver
