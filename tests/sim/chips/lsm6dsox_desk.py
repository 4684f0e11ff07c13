# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any

import pytest

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import SensorDesk

IMU = 0x6A
HZ = [6667 / 2**n for n in range(9, -1, -1)]  # by the codes of ODR, from 1 on

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)

GYR, ACC = lib.CHIP_GYR, lib.CHIP_ACC
INT1, INT2 = lib.LSM6DSOX_CHIP_INT1, lib.LSM6DSOX_CHIP_INT2
# Of each sensor: first output register, its bit of STATUS_REG, register of its rate.
PLACES = {GYR: (0x22, 0x02, 0x11), ACC: (0x28, 0x01, 0x10)}

every_sensor = pytest.mark.parametrize("quantity", [GYR, ACC])


class Chip(SensorDesk):
    """A chip without start-up time, whose gyroscope turns on at once."""

    def __init__(self, *, kind: str = "defaults", **config: Any) -> None:
        self.kind = kind
        at_once = {"startup_ns": 0, "gyr_turn_on_ns": 0}
        super().__init__("lsm6dsox", ffi, lib, **(at_once | config))

    def call(self, what: str, *arguments: Any, of_chip: bool = True) -> Any:
        what = self.kind if what == "defaults" else what
        return super().call(what, *arguments, of_chip=of_chip)

    def read(self, reg: int) -> int:
        return self.get(IMU, reg)[0]

    def write(self, reg: int, *values: int) -> None:
        self.put(IMU, reg, *values)

    def counts(self, quantity: int) -> list[int]:
        """The three axes, read in one burst."""
        data = bytes(self.get(IMU, PLACES[quantity][0], 6))
        return [
            int.from_bytes(data[i : i + 2], "little", signed=True) for i in (0, 2, 4)
        ]

    def has_new(self, quantity: int) -> bool:
        return bool(self.read(0x1E) & PLACES[quantity][1])

    def samples(self, quantity: int) -> int:
        return int(self.call("samples", quantity))

    def is_high(self, pin: int = INT1) -> bool:
        return bool(self.call("pin_is_high", pin))

    def sample(self, quantity: int) -> int:
        """Let time pass until the next sample of a sensor; return its time in ns."""
        before = self.samples(quantity)
        while self.samples(quantity) == before:
            self.advance(self.next_event())
        return int(self.now[0])

    def times(self, quantity: int, count: int) -> list[int]:
        return [self.sample(quantity) for _ in range(count)]

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
