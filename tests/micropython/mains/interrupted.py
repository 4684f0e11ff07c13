# SPDX-License-Identifier: MIT
"""A bus whose transfers raise KeyboardInterrupt once, as by Ctrl-C in their midst."""

from time import ticks_diff, ticks_ms

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run

begun_ms = ticks_ms()


class Interrupted:
    def __init__(self, bus):
        self.bus = bus
        self.is_due = True

    def readfrom_mem_into(self, address, register, buffer):
        if self.is_due and ticks_diff(ticks_ms(), begun_ms) > 2000:
            self.is_due = False
            raise KeyboardInterrupt
        self.bus.readfrom_mem_into(address, register, buffer)

    def writeto_mem(self, address, register, data):
        self.bus.writeto_mem(address, register, data)


run(
    LSM9DS0(Interrupted(I2C(1, freq=400_000))),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    storage=f405,
)
