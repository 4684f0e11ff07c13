# SPDX-License-Identifier: MIT
"""The probe on a MicroPython board: main.py calls run() with its sensor and pins."""

from micropython import kbd_intr

# First of all: frames hold any byte, Ctrl-C too, and a host may send some at once. An
# interrupt now would leave the board at its prompt. run() gives Ctrl-C back at its end,
# and a prompt at each line.
kbd_intr(-1)

from .battery import Battery
from .bus import Bus
from .log import FileLog
from .loop import run
from .sensors import LSM6DSOX, LSM9DS0, MPU9250
from .spi import SPIBus
from .storage import FileStorage

__all__ = (
    "LSM6DSOX",
    "LSM9DS0",
    "MPU9250",
    "Battery",
    "Bus",
    "FileLog",
    "FileStorage",
    "SPIBus",
    "run",
)
