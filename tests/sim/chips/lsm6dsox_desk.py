# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any, ClassVar

import pytest

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import StDesk

IMU = 0x6A
HZ = [6667 / 2**n for n in range(9, -1, -1)]  # by the codes of ODR, from 1 on

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)

GYR, ACC = sensor_desk.GYR, sensor_desk.ACC

# Of each sensor: first output register, its bit of STATUS_REG, register of its rate.
PLACES = {GYR: (0x22, 0x02, 0x11), ACC: (0x28, 0x01, 0x10)}

every_sensor = pytest.mark.parametrize("quantity", [GYR, ACC])


class Chip(StDesk):
    """A chip without start-up time, whose gyroscope turns on at once."""

    PLACES: ClassVar = {q: (IMU, out, 0x1E, new) for q, (out, new, _) in PLACES.items()}
    ON = 0

    def __init__(self, **config: Any) -> None:
        at_once = {"startup_ns": 0, "gyr_turn_on_ns": 0}
        super().__init__("lsm6dsox", ffi, lib, **(at_once | config))

    def read(self, reg: int) -> int:
        return self.get(IMU, reg)[0]

    def write(self, reg: int, *values: int) -> None:
        self.put(IMU, reg, *values)

    def seen(self, quantity: int, axis: int, count: int) -> list[int]:
        """One axis of the next samples."""
        values = []
        for _ in range(count):
            self.sample(quantity)
            values.append(self.counts(quantity)[axis])
        return values

    def settle(self, quantity: int) -> None:
        """Let the samples pass that come before the filters have settled."""
        self.times(quantity, 6)

    def run(
        self, quantity: int, *, code: int = 5, low: int = 0, bdu: bool = True
    ) -> None:
        """Turn on a sensor: by default 208 Hz, 250 deg/s or 2 g, BDU, data-ready on
        INT1.
        """
        self.write(0x0D, PLACES[quantity][1])
        self.write(0x12, 0x44 if bdu else 0x04)
        self.write(PLACES[quantity][2], code << 4 | low)

    def bdu_off(self, _: int) -> None:
        self.write(0x12, 0x04)
