# SPDX-License-Identifier: MIT
"""An I2C bus that can be freed: a device that was interrupted while it sent a 0 holds
SDA until it has seen the rest of its byte clocked (UM10204, "Bus clear").
"""

from time import sleep_us

from machine import Pin

from micropython import const

_HALF_CLOCK_US = const(5)  # 100 kHz, which every device follows
_CLOCKS = const(9)  # eight bits and their acknowledge
_STRETCH_MAX = const(50)  # half clocks that a device may hold SCL down


class Bus:
    """`make` returns the machine.I2C, as often as it is called; `scl` and `sda` are the
    names of its pins.
    """

    def __init__(self, make, scl, sda):
        self._make = make
        self._names = scl, sda
        self.i2c = make()

    def recover(self):
        """Clocks until SDA is high, then makes a STOP. True when both lines are high.

        At most 5 ms, 0.2 ms where nobody holds SCL.
        """
        scl, sda = (Pin(name, Pin.OPEN_DRAIN, value=1) for name in self._names)
        is_free = _raised(scl)
        for _ in range(_CLOCKS):
            if not is_free or sda.value():
                break
            _lower(scl)
            is_free = _raised(scl)
        if is_free:
            # STOP: SDA rises while SCL is high.
            _lower(scl)
            _lower(sda)
            _raised(scl)
            sda.value(1)
            sleep_us(_HALF_CLOCK_US)
        is_free = bool(scl.value() and sda.value())
        self._make()  # takes the pins back
        return is_free


def _lower(pin):
    pin.value(0)
    sleep_us(_HALF_CLOCK_US)


def _raised(scl):
    scl.value(1)
    for _ in range(_STRETCH_MAX):
        sleep_us(_HALF_CLOCK_US)
        if scl.value():
            return True
    return False
