# SPDX-License-Identifier: MIT
"""The probe of docs/pico.md: its sensor on GP4 and GP5, the host on USB."""

import sys
import time

from machine import ADC, Pin
from probe.start import start

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


start(
    i2c=0,
    sda=4,
    scl=5,
    ready=6,
    button=15,
    led=None if has_radio else 25,
    supply=None if has_radio else supply_mv,
)
