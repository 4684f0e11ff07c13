# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver on a desk, with the chip's model."""

from __future__ import annotations

from typing import Any

from core.sensor_desk import SensorBench, ffi, lib
from sim.chips.sensor_desk import SensorDesk

G, XM = lib.LSM9DS0_CHIP_G, lib.LSM9DS0_CHIP_XM  # its dies
ACC_PASSED, GYR_PASSED = lib.SELF_TEST_ACC_PASSED, lib.SELF_TEST_GYR_PASSED
ACC_FAILED, GYR_FAILED = lib.SELF_TEST_ACC_FAILED, lib.SELF_TEST_GYR_FAILED
BOTH_PASSED = ACC_PASSED | GYR_PASSED


class Bench(SensorBench):
    """The driver with its chip."""

    def __init__(
        self, start_us: int = 0, *, is_fast: bool = False, **config: Any
    ) -> None:
        chip = SensorDesk("lsm9ds0", ffi, lib, **config)
        self.g_at = 0x6B if chip.config.sa0_g else 0x6A
        self.xm_at = 0x1D if chip.config.sa0_xm else 0x1E
        where = {"gyr_address": self.g_at, "xm_address": self.xm_at}
        driver = ffi.new("struct lsm9ds0 *", {"config": where})
        driver.config.is_fast = is_fast
        super().__init__(driver, {self.g_at: chip, self.xm_at: chip}, start_us)


def running(**options: Any) -> Bench:
    bench = Bench(**options)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


def block(
    gyr: tuple[int, int, int] = (1, 2, 3),
    acc: tuple[int, int, int] = (0, 0, 1366),
    mag: tuple[int, int, int] = (10, 20, 30),
    gyr_status: int = 0x0F,
    acc_status: int = 0x0F,
    mag_status: int = 0x0F,
    temperature: int = 0x10,
) -> bytes:
    """Return the bytes of a sample's bursts."""

    def part(status: int, values: tuple[int, int, int]) -> bytes:
        rows = (value.to_bytes(2, "little", signed=True) for value in values)
        return bytes([status]) + b"".join(rows)

    return (
        part(gyr_status, gyr)
        + part(acc_status, acc)
        + temperature.to_bytes(2, "little")
        + part(mag_status, mag)
    )
