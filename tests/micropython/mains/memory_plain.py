# SPDX-License-Identifier: MIT
"""Tells as its supply how many bytes of heap were taken in the last second, and 1,
without the module."""

import gc

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run

taken = 0


def bytes_taken():
    global taken
    before = taken
    taken = gc.mem_alloc()
    return min(max(taken - before, 0), 60000) + 1


run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Pin("X17", Pin.IN, Pin.PULL_UP),
    storage=f405,
    supply=bytes_taken,
    plain=True,
)
