# SPDX-License-Identifier: MIT
"""The driver of a joined sensor on a desk: an LSM6DSOX and a LIS3MDL, as the module
4517 has them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from core.sensor_desk import SensorBench, axes, ffi, lib
from sim.chips.sensor_desk import SensorDesk

ALL_PASSED = (
    lib.SELF_TEST_ACC_PASSED | lib.SELF_TEST_GYR_PASSED | lib.SELF_TEST_MAG_PASSED
)


class Bench(SensorBench):
    """The driver with its chips."""

    def __init__(
        self,
        start_us: int = 0,
        config: Any = None,
        inertial: dict[str, Any] | None = None,
        magnetic: dict[str, Any] | None = None,
        relative: str = "",
    ) -> None:
        """`config` is the driver's, `inertial` and `magnetic` those of the models;
        `relative`: the inertial chip, if it is no LSM6DSOX.
        """
        self.config = config or ffi.addressof(lib.adafruit_4517)
        driver = ffi.new("struct joined *", {"config": self.config})
        chip = {"relative": relative, **(inertial or {})}
        self.inertial = SensorDesk("lsm6dsox", ffi, lib, **chip)
        self.magnetic = SensorDesk("lis3mdl", ffi, lib, **(magnetic or {}))
        self.inertial_at = 0x6B if self.inertial.config.sa0 else 0x6A
        self.magnetic_at = 0x1E if self.magnetic.config.sa1 else 0x1C
        chips = {self.inertial_at: self.inertial, self.magnetic_at: self.magnetic}
        super().__init__(driver, chips, start_us)

    def field(self) -> tuple[int, int, int]:
        """The next field that arrives."""
        sample = next(s for s in (self.sample() for _ in range(40)) if s.has_mag)
        return axes(sample.mag)


def dsv(**options: Any) -> Bench:
    """An LSM6DSV16X in its place, and the driver that takes either of them."""
    config = ffi.addressof(lib.lsm6dsv16x_lis3mdl)
    return Bench(**{"relative": "lsm6dsv16x", "config": config, **options})


every_family = pytest.mark.parametrize("make", [Bench, dsv], ids=["dsox", "dsv16x"])


def running(make: Callable[..., Bench] = Bench, **options: Any) -> Bench:
    bench = make(**options)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


def block(
    temperature: int = 0,
    gyr: tuple[int, int, int] = (1, 2, 3),
    acc: tuple[int, int, int] = (0, 0, 2049),
    mag: tuple[int, int, int] = (10, 20, 30),
    status: int = 0x0F,
) -> bytes:
    """Return the bytes of a sample's bursts."""
    values = (temperature, *gyr, *acc)
    inertial = b"".join(v.to_bytes(2, "little", signed=True) for v in values)
    field = b"".join(v.to_bytes(2, "little", signed=True) for v in mag)
    return inertial + bytes([status]) + field
