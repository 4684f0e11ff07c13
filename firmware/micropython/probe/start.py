# SPDX-License-Identifier: MIT
"""Starts a probe by its pins, as the main.py of `imud flash` names them."""

import sys

from machine import I2C, Pin

from micropython import const, kbd_intr

from . import wifi
from .bus import Bus
from .loop import run
from .sensors import detected
from .storage import FileStorage

_CTRL_C = const(3)


def start(i2c, sda, scl, ready, button, led=None, supply=None):
    """Runs the probe with the sensor that it finds: over the network of wifi.json where
    there is such a file, else over USB. Returns to the prompt if the button is held
    down: then nothing else runs, and `imud flash` can write the board.
    """
    button = Pin(button, Pin.IN, Pin.PULL_UP)
    if not button.value():
        kbd_intr(_CTRL_C)
        return

    def make():
        if sys.platform == "pyboard":  # whose I2C has its own pins
            return I2C(i2c, freq=400_000)
        return I2C(i2c, scl=Pin(scl), sda=Pin(sda), freq=400_000)

    network = wifi.of_file()
    run(
        detected(Bus(make, scl=scl, sda=sda)),
        ready=Pin(ready, Pin.IN, Pin.PULL_DOWN),
        wire=_usb() if network is None else network.wire,
        button=button,
        led=None if led is None else Pin(led, Pin.OUT),
        storage=FileStorage("probe.settings"),
        supply=supply,
        hook=None if network is None else network.step,
    )


def _usb():
    if sys.platform == "pyboard":
        from pyb import USB_VCP

        return USB_VCP()
    return sys.stdin.buffer
