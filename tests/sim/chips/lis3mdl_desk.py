# SPDX-License-Identifier: MIT
"""The model of the LIS3MDL with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any, ClassVar

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import StDesk

MAG = 0x1C
ON = StDesk.ON
FIELD = sensor_desk.MAG  # the quantity

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)


class Chip(StDesk):
    """A chip without start-up time."""

    PLACES: ClassVar = {FIELD: (MAG, 0x28, 0x27, 0x09)}

    def __init__(self, **config: Any) -> None:
        super().__init__("lis3mdl", ffi, lib, **({"startup_ns": 0} | config))

    def read(self, reg: int) -> int:
        return self.get(MAG, reg)[0]

    def write(self, reg: int, *values: int) -> None:
        self.put(MAG, ON | reg, *values)

    def run(
        self,
        _: int = FIELD,
        *,
        ctrl1: int = 0xFC,
        ctrl2: int = 0x00,
        bdu: bool = True,
    ) -> None:
        """By default 80 Hz, ultra-high performance, temperature, 4 gauss, BDU."""
        self.write(0x20, ctrl1, ctrl2)
        self.write(0x23, ctrl1 >> 3 & 0x0C, 0x40 if bdu else 0x00)
        self.write(0x22, 0x00)

    def bdu_off(self, _: int) -> None:
        self.write(0x24, 0x00)
