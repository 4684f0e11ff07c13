# SPDX-License-Identifier: MIT
"""Tells as its supply the longest turn of its loop in the last second, microseconds."""

from time import ticks_diff, ticks_us

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run


class Button:
    """Never pressed; asked once in each turn."""

    def __init__(self, pin):
        self.pin = pin
        self.last = ticks_us()
        self.worst = 0

    def value(self):
        now = ticks_us()
        self.worst = max(self.worst, ticks_diff(now, self.last))
        self.last = now
        return self.pin.value()

    def told(self):
        worst, self.worst = self.worst, 0
        return min(worst, 60000)


button = Button(Pin("X17", Pin.IN, Pin.PULL_UP))
run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=button,
    storage=f405,
    supply=button.told,
)
