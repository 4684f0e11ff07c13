# SPDX-License-Identifier: MIT
"""The probe of docs/pico.md: its sensor on GP4 and GP5, the host on USB."""

import sys
import time

from machine import ADC, I2C, Pin
from probe import LSM6DSOX, MPU9250, Bus, FileStorage, run

vsys = ADC(29)  # a third of what feeds the board
led = Pin(25)
SUPPLY_LEAST = 5920  # half of what the least supply gives, 1.8 V


def gates_supply():
    """Whether the LED's pin connects VSYS to its pin, as on a Pico W (board.c). Then it
    stays high: the radio is not selected.
    """
    read = []
    for level in (0, 1):
        led.init(Pin.OUT, value=level)
        time.sleep_ms(1)
        read.append(vsys.read_u16() >= SUPPLY_LEAST)
    return read == [False, True]


# On a board with a radio GP25 and GP29 are the radio's, and the LED hangs on it. Of a
# Pico's image on such a board MicroPython does not know that.
has_radio = " W " in sys.implementation._machine or gates_supply()


def supply_mv():
    return vsys.read_u16() * 9900 >> 16


def name(i2c, address, who_am_i):
    try:
        return i2c.readfrom_mem(address, who_am_i, 1)[0]
    except OSError:
        return 0


def detected(bus):
    """Looks for sensors by their names: something else may be at 0x68."""
    if not 0x70 <= name(bus.i2c, 0x68, 0x75) <= 0x74:
        for address in (0x6A, 0x6B):
            if name(bus.i2c, address, 0x0F):  # or it says who answers there
                return LSM6DSOX(bus)
    return MPU9250(bus)  # or waits for it


run(
    detected(Bus(lambda: I2C(0, scl=Pin(5), sda=Pin(4), freq=400_000), scl=5, sda=4)),
    ready=Pin(6, Pin.IN, Pin.PULL_DOWN),
    wire=sys.stdin.buffer,
    button=Pin(15, Pin.IN, Pin.PULL_UP),
    led=None if has_radio else led,
    storage=FileStorage("probe.settings"),
    supply=None if has_radio else supply_mv,
)
