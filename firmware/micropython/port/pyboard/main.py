# SPDX-License-Identifier: MIT
"""The probe of docs/f405.md: an LSM9DS0 on X9 and X10, the host on X3 and X4."""

import f405
from machine import I2C, UART, Pin
from probe import LSM9DS0, Bus, run

run(
    LSM9DS0(Bus(lambda: I2C(1, freq=400_000), scl="X9", sda="X10")),
    ready=Pin("Y11", Pin.IN, Pin.PULL_DOWN),
    wire=UART(2, 921_600),
    button=Pin("X17", Pin.IN, Pin.PULL_UP),
    led=Pin("LED_BLUE", Pin.OUT),
    storage=f405,
    supply=f405.supply_mv,
)
