# SPDX-License-Identifier: MIT
"""The model of the LIS3MDL with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import SensorDesk

MAG = 0x1C
ON = 0x80  # bit 7 of the sub-address: increment it after each byte

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)


class Chip(SensorDesk):
    """A chip without start-up time."""

    def __init__(self, **config: Any) -> None:
        super().__init__("lis3mdl", ffi, lib, **({"startup_ns": 0} | config))

    def read(self, reg: int) -> int:
        return self.get(MAG, reg)[0]

    def write(self, reg: int, *values: int) -> None:
        self.put(MAG, ON | reg, *values)

    def words(self, reg: int, count: int) -> list[int]:
        data = bytes(self.get(MAG, ON | reg, 2 * count))
        return [
            int.from_bytes(data[i : i + 2], "little", signed=True)
            for i in range(0, 2 * count, 2)
        ]

    def counts(self) -> list[int]:
        """The three axes, read in one burst."""
        return self.words(0x28, 3)

    def status(self) -> int:
        return self.read(0x27)

    def samples(self) -> int:
        return int(self.call("samples"))

    def is_high(self) -> bool:
        return bool(self.call("drdy_is_high"))

    def sample(self) -> int:
        """Let time pass until the next sample; return its time in ns."""
        before = self.samples()
        while self.samples() == before:
            self.advance(self.next_event())
        return int(self.now[0])

    def times(self, count: int) -> list[int]:
        return [self.sample() for _ in range(count)]

    def run(self, ctrl1: int = 0xFC, ctrl2: int = 0x00, *, bdu: bool = True) -> None:
        """By default 80 Hz, ultra-high performance, temperature, 4 gauss, BDU."""
        self.write(0x20, ctrl1, ctrl2)
        self.write(0x23, ctrl1 >> 3 & 0x0C, 0x40 if bdu else 0x00)
        self.write(0x22, 0x00)
