# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver on a desk, with the register file of lsm9ds0_chip.py."""

from __future__ import annotations

from typing import Any

from core.lsm9ds0_chip import Chip, ffi, lib
from core.sensor_desk import RegisterBench


class Bench(RegisterBench):
    """The driver with its chip."""

    def __init__(
        self,
        chip: Any = None,
        start_us: int = 0,
        *,
        is_fast: bool = False,
    ) -> None:
        chip = chip or Chip()
        gyr_address, xm_address = chip.halves
        config = {"gyr_address": gyr_address, "xm_address": xm_address}
        driver = ffi.new("struct lsm9ds0 *", {"config": config})
        driver.config.is_fast = is_fast
        super().__init__(ffi, lib, driver, chip, start_us)


def running(chip: Any = None, *, is_fast: bool = False) -> Bench:
    bench = Bench(chip, is_fast=is_fast)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


def block(
    gyr: tuple[int, int, int] = (1, 2, 3),
    acc: tuple[int, int, int] = (0, 0, 1366),
    mag: tuple[int, int, int] = (10, 20, 30),
    gyr_status: int = 0x0F,
    acc_status: int = 0x0F,
    mag_status: int = 0x0F,
) -> bytes:
    """Return the bytes of a sample's bursts."""

    def part(status: int, values: tuple[int, int, int]) -> bytes:
        rows = (value.to_bytes(2, "little", signed=True) for value in values)
        return bytes([status]) + b"".join(rows)

    temperature = bytes([0x10, 0x00])
    return (
        part(gyr_status, gyr)
        + part(acc_status, acc)
        + temperature
        + part(mag_status, mag)
    )
