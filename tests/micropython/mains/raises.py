# SPDX-License-Identifier: MIT
"""A program that ends with an exception two seconds after its start."""

from time import ticks_diff, ticks_ms

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run

begun_ms = ticks_ms()


class Button:
    def value(self):
        if ticks_diff(ticks_ms(), begun_ms) > 2000:
            raise RuntimeError("planted")
        return 1


run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Button(),
    storage=f405,
)
