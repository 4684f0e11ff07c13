# SPDX-License-Identifier: MIT
"""The SPI that the card's driver sees, with a FakeCard at its other end, and the time
that passes on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from core.fake_card import FakeCard

SLOW_HZ, FAST_HZ = 328_125, 21_000_000


class Wire:
    """A `struct spi_device` for the driver, and the time that passes on it."""

    def __init__(self, ffi: Any, card: FakeCard) -> None:
        self._ffi = ffi
        self.card = card
        self.now_us = card.now_us  # the card lives on, the host starts
        self.is_selected = False
        self.is_fast = False
        self.is_stuck = False
        self.exchanges = 0
        self.on_exchange: Callable[[int], None] = lambda _: None
        self._done_us = 0.0
        self._pending: tuple[Any, bytes] | None = None
        self._keep = {
            "select": ffi.callback("void(void *, bool)", self._select),
            "set_fast": ffi.callback("void(void *, bool)", self._set_fast),
            "begin": ffi.callback(
                "void(void *, const uint8_t *, uint8_t *, uint16_t)", self._begin
            ),
            "is_done": ffi.callback("bool(void *)", self._is_done),
        }
        self.device = ffi.new("struct spi_device *", self._keep)

    def _select(self, _: Any, is_selected: bool) -> None:
        self.is_selected = is_selected

    def _set_fast(self, _: Any, is_fast: bool) -> None:
        self.is_fast = is_fast

    def _begin(self, _: Any, out: Any, into: Any, length: int) -> None:
        assert length > 0
        self.exchanges += 1
        self.on_exchange(self.exchanges)
        sent = (
            bytes(self._ffi.buffer(out, length))
            if out != self._ffi.NULL
            else b"\xff" * length
        )
        card = self.card
        byte_us = 8e6 / (FAST_HZ if self.is_fast else SLOW_HZ)
        answer = card.exchange(sent, self.now_us, byte_us, is_selected=self.is_selected)
        self._done_us = self.now_us + length * byte_us
        self._pending = (into, answer) if into != self._ffi.NULL else None

    def _is_done(self, _: Any) -> bool:
        if self.is_stuck or self.now_us < self._done_us:
            return False
        if self._pending is not None:
            into, answer = self._pending
            self._ffi.memmove(into, answer, len(answer))
            self._pending = None
        return True

    @property
    def time(self) -> int:
        return int(self.now_us) & 0xFFFFFFFF

    def sleep(self, tick_us: float = 1000.0) -> None:
        """Until the exchange is over, or to the tick."""
        until = self.now_us + tick_us
        if self.now_us < self._done_us and not self.is_stuck:
            until = min(until, self._done_us)
        self.now_us = max(until, self.now_us + 1)
