# SPDX-License-Identifier: MIT
"""Two chips on one I2C wire."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from sim.chips import lis3mdl_desk, lsm6dsox_desk
from sim.chips.lis3mdl_desk import MAG, ffi, lib
from sim.chips.lsm6dsox_desk import IMU

WHO = {IMU: 0x6C, MAG: 0x3D}


class Pair:
    """An LSM6DSOX and a LIS3MDL, and an I2C master byte by byte."""

    def __init__(self) -> None:
        self.imu, self.mag = lsm6dsox_desk.Chip(), lis3mdl_desk.Chip()
        self.bus = ffi.new("struct i2c_bus *")
        self.bus.slaves = [self.imu.wire, self.mag.wire]
        self.bus.count = 2
        self.now = 0

    def _do(self, function: Callable[..., Any], *arguments: Any) -> Any:
        self.now += 25_000
        return function(self.bus, self.now, *arguments)

    def begin(self, address: int, reg: int) -> bool:
        return bool(
            self._do(lib.i2c_bus_start, address, False)
            and self._do(lib.i2c_bus_write, reg)
        )

    def read(self, address: int, reg: int) -> int | None:
        value = None
        if self.begin(address, reg) and self._do(lib.i2c_bus_start, address, True):
            value = int(self._do(lib.i2c_bus_read, False))
        self._do(lib.i2c_bus_stop)
        return value

    def write(self, address: int, reg: int, value: int) -> bool:
        ack = self.begin(address, reg) and bool(self._do(lib.i2c_bus_write, value))
        self._do(lib.i2c_bus_stop)
        return ack

    def pulse(self) -> None:
        self._do(lib.i2c_bus_scl_pulse)

    def is_held(self) -> bool:
        return bool(self._do(lib.i2c_bus_holds_sda))


def test_each_chip_answers_for_itself() -> None:
    pair = Pair()
    found = {a: pair.read(a, 0x0F) for a in range(128)}
    assert {a: who for a, who in found.items() if who is not None} == WHO
    assert pair.write(MAG, 0x20, 0x7C)
    assert pair.write(IMU, 0x10, 0x48)
    assert pair.mag.peek(0x20) == 0x7C
    assert pair.imu.peek(0x10) == 0x48
    assert pair.imu.peek(0x20) == pair.mag.peek(0x10) == 0


def test_both_count_the_same_transactions() -> None:
    pair = Pair()
    for address in (IMU, MAG, 0x50, IMU):
        pair.read(address, 0x0F)
    assert pair.imu.transactions() == pair.mag.transactions() == 4
    pair.mag.fault("NACK", first=6, transactions=1, at_byte=1)
    assert [pair.read(MAG, 0x0F) for _ in range(3)] == [0x3D, None, 0x3D]


@pytest.mark.parametrize("holder", ["imu", "mag"])
def test_a_line_that_one_holds_is_held_for_both(holder: str) -> None:
    pair = Pair()
    getattr(pair, holder).fault("STUCK_SDA", clocks=5)
    assert pair.is_held()
    assert [pair.read(address, 0x0F) for address in (IMU, MAG)] == [None, None]
    for _ in range(5):
        assert pair.is_held()
        pair.pulse()
    assert not pair.is_held()
    assert [pair.read(address, 0x0F) for address in (IMU, MAG)] == [0x6C, 0x3D]


def test_nobody_takes_a_byte_that_was_sent_on_a_held_line() -> None:
    pair = Pair()
    pair.mag.fault("STUCK_SDA", first=1, transactions=1, at_byte=2, clocks=9)
    assert not pair.write(IMU, 0x10, 0x48)
    assert pair.imu.peek(0x10) == 0x00


def test_a_line_held_while_one_is_read_gives_zeros() -> None:
    pair = Pair()
    pair.imu.fault("STUCK_SDA", first=1, transactions=1, at_byte=3, clocks=9)
    assert pair.read(MAG, 0x0F) == 0x00
