# SPDX-License-Identifier: MIT
"""The probe of main.py at 760 samples a second."""

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run

run(
    LSM9DS0(I2C(1, freq=400_000), fast=True),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Pin("X17", Pin.IN, Pin.PULL_UP),
    storage=f405,
)
