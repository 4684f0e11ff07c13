# SPDX-License-Identifier: MIT
"""The probe of main.py with a battery at X19."""

import f405
from machine import ADC, I2C, UART, Pin
from probe import LSM9DS0, Battery, run

run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    storage=f405,
    battery=Battery(ADC("X19"), full_mv=6600),
)
