# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any, ClassVar

import pytest

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import StDesk

G, XM = 0x6B, 0x1D
ON = StDesk.ON

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)

GYR, ACC, MAG = sensor_desk.GYR, sensor_desk.ACC, sensor_desk.MAG

DRDY_G = lib.LSM9DS0_CHIP_DRDY_G
INT1, INT2 = lib.LSM9DS0_CHIP_INT1_XM, lib.LSM9DS0_CHIP_INT2_XM
# Of each sensor: address, status register, first output register.
PLACES = {GYR: (G, 0x27, 0x28), ACC: (XM, 0x27, 0x28), MAG: (XM, 0x07, 0x08)}

every_sensor = pytest.mark.parametrize("quantity", [GYR, ACC, MAG])


class Chip(StDesk):
    """A chip without start-up time, whose gyroscope turns on at once."""

    PLACES: ClassVar = {
        q: (die, out, status, 0x09) for q, (die, status, out) in PLACES.items()
    }

    def __init__(self, **config: Any) -> None:
        at_once = {"startup_ns": 0, "gyr_turn_on_ns": 0}
        super().__init__("lsm9ds0", ffi, lib, **(at_once | config))

    def fault(self, kind: str, die: str = "BOTH", **fields: int) -> None:
        super().fault(kind, die=getattr(lib, f"LSM9DS0_CHIP_{die}"), **fields)

    def run_gyro(self, ctrl1: int = 0xBF, ctrl4: int = 0xA0) -> None:
        """By default 380 Hz, 100 Hz bandwidth, BDU, 2000 deg/s."""
        self.put(G, 0x22, 0x08)
        self.put(G, 0x23, ctrl4)
        self.put(G, 0x20, ctrl1)

    def run_accel(self, ctrl1: int = 0x8F, ctrl2: int = 0xA0) -> None:
        """By default 400 Hz, BDU, 362 Hz bandwidth, 16 g; data-ready on INT1_XM."""
        self.put(XM, 0x22, 0x04)
        self.put(XM, 0x21, ctrl2)
        self.put(XM, 0x20, ctrl1)

    def run_mag(self, ctrl5: int = 0xF4, ctrl6: int = 0x00, ctrl7: int = 0x00) -> None:
        """By default 100 Hz, high resolution, 2 gauss; data-ready on INT2_XM."""
        self.put(XM, 0x23, 0x04)
        self.put(XM, 0x24, ctrl5)
        self.put(XM, 0x25, ctrl6)
        self.put(XM, 0x26, ctrl7)

    def run(self, quantity: int, *, bdu: bool = True) -> None:
        """Turn on one of the three sensors with its defaults."""
        if quantity == GYR:
            self.run_gyro(ctrl4=0xA0 if bdu else 0x20)
        elif quantity == ACC:
            self.run_accel(ctrl1=0x8F if bdu else 0x87)
        else:
            self.put(XM, 0x20, 0x0F if bdu else 0x07)
            self.run_mag()

    def bdu_off(self, quantity: int) -> None:
        self.put(*{G: (G, 0x23, 0x20), XM: (XM, 0x20, 0x87)}[PLACES[quantity][0]])
