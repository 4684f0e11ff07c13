# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver on a desk, with the register file of lsm9ds0_chip.py."""

from __future__ import annotations

from typing import Any

from core.lsm9ds0_chip import Chip, ffi, lib
from core.sensor_desk import SensorBench


class Bench(SensorBench):
    """The driver with a chip that has `read`, `write` and a settable `now_us`."""

    def __init__(
        self,
        chip: Any = None,
        start_us: int = 0,
        *,
        is_fast: bool = False,
    ) -> None:
        self.chip = chip or Chip()
        gyr_address, xm_address = self.chip.halves
        config = {"gyr_address": gyr_address, "xm_address": xm_address}
        driver = ffi.new("struct lsm9ds0 *", {"config": config})
        driver.config.is_fast = is_fast
        super().__init__(ffi, lib, driver, self.chip.read, self.chip.write, start_us)

    @property
    def clock_ns(self) -> int:
        return int(self.chip.now_us * 1000)

    def let_pass(self, us: int) -> None:
        self.chip.now_us += us

    def take(self) -> bytes:
        """Read the bursts that the next data-ready edge starts."""
        self.chip.await_edge()
        taken = b""
        for address, reg, length in self.bursts:
            data = ffi.new("uint8_t[]", length)
            assert self.chip.read(None, address, reg, data, length) == lib.BUS_OK
            taken += bytes(data)
        return taken

    def is_refused(self, data: bytes) -> bool:
        out = ffi.new("struct sample *")
        ffi.memmove(out, b"\xa5" * ffi.sizeof(out[0]), ffi.sizeof(out[0]))
        if lib.lsm9ds0_parse(self.driver, data, 0, out):
            return False
        assert set(bytes(ffi.buffer(out))) == {0xA5}, "written anyway"
        return True

    def sample(self) -> Any:
        return self.parse(self.take())


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
