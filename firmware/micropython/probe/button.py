# SPDX-License-Identifier: MIT
"""A push button without its bounce, as core/drivers/button.h has it."""

from time import ticks_diff

from micropython import const

_STABLE_US = const(50_000)  # a new level counts after it was stable for so long
_STEP_MAX_US = const(10_000)  # between two steps the pin may bounce


class Button:
    def __init__(self, ticks):
        self.is_down = False
        self._level = False
        self._stable_us = 0
        self._stepped = ticks

    def step(self, level, ticks):
        """True where it was just pressed or released; call it every 10 ms."""
        elapsed_us = ticks_diff(ticks, self._stepped)
        self._stepped = ticks
        if level == self.is_down or level != self._level:
            self._level = level
            self._stable_us = 0
            return False
        self._stable_us += min(elapsed_us, _STEP_MAX_US)
        if self._stable_us < _STABLE_US:
            return False
        self.is_down = level
        return True
