# SPDX-License-Identifier: MIT
"""The probe of main.py without the module, with Madgwick's filter in floats."""

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, run
from probe.madgwick import Madgwick

run(
    LSM9DS0(I2C(1, freq=400_000)),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Pin("X17", Pin.IN, Pin.PULL_UP),
    storage=f405,
    plain=True,
    filter=Madgwick(),
)
