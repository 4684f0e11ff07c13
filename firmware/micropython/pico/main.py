# SPDX-License-Identifier: MIT
"""The probe of docs/pico.md: its sensor on GP4 and GP5, the host on USB."""

import sys

from machine import ADC, I2C, Pin
from probe import LSM6DSOX, MPU9250, Bus, FileStorage, run

vsys = ADC(29)  # a third of what feeds the board


def supply_mv():
    return vsys.read_u16() * 9900 >> 16


def answers(i2c, address, who_am_i):
    try:
        i2c.readfrom_mem(address, who_am_i, 1)
    except OSError:
        return False
    return True


def detected(bus):
    """Looks for sensors in the order of the Pico's firmware in C."""
    if answers(bus.i2c, 0x68, 0x75):
        return MPU9250(bus)
    if answers(bus.i2c, 0x6A, 0x0F) or answers(bus.i2c, 0x6B, 0x0F):
        return LSM6DSOX(bus)
    return MPU9250(bus)  # waits for it


run(
    detected(Bus(lambda: I2C(0, scl=Pin(5), sda=Pin(4), freq=400_000), scl=5, sda=4)),
    ready=Pin(6, Pin.IN, Pin.PULL_DOWN),
    wire=sys.stdin.buffer,
    button=Pin(15, Pin.IN, Pin.PULL_UP),
    led=Pin(25, Pin.OUT),
    storage=FileStorage("probe.settings"),
    supply=supply_mv,
)
