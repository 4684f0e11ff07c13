# SPDX-License-Identifier: MIT
"""The probe on a MicroPython board: main.py calls run() with its sensor and pins."""

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
