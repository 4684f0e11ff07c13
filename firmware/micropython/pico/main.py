# SPDX-License-Identifier: MIT
"""The probe of docs/pico.md: an MPU-9250 on GP4 and GP5, the host on USB."""

import sys

from machine import ADC, I2C, Pin
from probe import MPU9250, Bus, FileStorage, run

vsys = ADC(29)  # a third of what feeds the board


def supply_mv():
    return vsys.read_u16() * 9900 >> 16


run(
    MPU9250(Bus(lambda: I2C(0, scl=Pin(5), sda=Pin(4), freq=400_000), scl=5, sda=4)),
    ready=Pin(6, Pin.IN, Pin.PULL_DOWN),
    wire=sys.stdin.buffer,
    button=Pin(15, Pin.IN, Pin.PULL_UP),
    led=Pin(25, Pin.OUT),
    storage=FileStorage("probe.settings"),
    supply=supply_mv,
)
