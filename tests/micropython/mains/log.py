# SPDX-License-Identifier: MIT
"""Tells as its supply how many bytes its log got, modulo 60000."""

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run


class Log:
    def __init__(self):
        self.length = 0

    def open(self, probe):
        pass

    def write(self, _data, _at, length):
        self.length = (self.length + length) % 60000

    def step(self, probe):
        pass

    def close(self):
        pass


log = Log()
run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Pin("X17", Pin.IN, Pin.PULL_UP),
    storage=f405,
    supply=lambda: log.length,
    log=log,
)
