# SPDX-License-Identifier: MIT
"""The model of the LSM6DSV16X with an I2C master, for its tests."""

from __future__ import annotations

from typing import Any

from sim.chips import lsm6dsox_desk
from sim.chips.lsm6dsox_desk import ACC, GYR, IMU, PLACES, ffi, lib, recorder

__all__ = ["ACC", "GYR", "IMU", "PLACES", "Chip", "ffi", "lib", "recorder"]


class Chip(lsm6dsox_desk.Chip):
    """A chip without start-up time, whose gyroscope turns on at once."""

    def __init__(self, **config: Any) -> None:
        super().__init__(relative="lsm6dsv16x", **config)

    def run(
        self, quantity: int, *, code: int = 7, low: int = 0, bdu: bool = True
    ) -> None:
        """Turn on a sensor: by default 240 Hz, 125 deg/s or 2 g, BDU, data-ready on
        INT1. `low`: the range's code.
        """
        self.write(0x0D, PLACES[quantity][1])
        self.write(0x12, 0x44 if bdu else 0x04)
        self.write({GYR: 0x15, ACC: 0x17}[quantity], low)
        self.write(PLACES[quantity][2], code)
