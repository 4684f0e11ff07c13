# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver on a desk, with the chip's model or with the register file of
lsm9ds0_chip.py."""

from __future__ import annotations

from typing import Any

from core.lsm9ds0_chip import XM, Chip, G, Triple, ffi, lib
from core.sensor_desk import SensorBench


class Model:
    """The model of sim/chips behind what a bench uses of a Chip."""

    def __init__(self, **config: Any) -> None:
        settings = lib.lsm9ds0_chip_defaults()
        for name, value in config.items():
            setattr(settings, name, value)
        self.c = ffi.gc(
            lib.lsm9ds0_chip_new(ffi.new("struct lsm9ds0_chip_config *", settings)),
            lib.lsm9ds0_chip_free,
        )
        self.halves = {0x6B: G, 0x1D: XM}
        self._now_ns = 0

    @property
    def now_us(self) -> float:
        return self._now_ns / 1000

    @now_us.setter
    def now_us(self, now_us: float) -> None:
        self._now_ns = round(now_us * 1000)
        lib.lsm9ds0_chip_advance(self.c, self._now_ns)

    def _move(
        self, transfer: Any, address: int, reg: int, data: Any, length: int
    ) -> int:
        now = ffi.new("uint64_t *", self._now_ns)
        result = transfer(
            lib.lsm9ds0_chip_wire(self.c), now, address, reg, data, length
        )
        self._now_ns = now[0]
        return {0: lib.BUS_OK, -1: lib.BUS_NACK, -3: lib.BUS_STUCK}[result]

    def read(self, _: Any, *transfer: Any) -> int:
        return self._move(lib.i2c_slave_read_registers, *transfer)

    def write(self, _: Any, *transfer: Any) -> int:
        return self._move(lib.i2c_slave_write_registers, *transfer)

    def await_edge(self) -> None:
        assert not self.is_ready, "the edge has been"
        deadline_ns = self._now_ns + 20_000_000
        while not self.is_ready:
            self._now_ns = lib.lsm9ds0_chip_next_event(self.c)
            assert self._now_ns <= deadline_ns, "no data-ready within 20 ms"
            lib.lsm9ds0_chip_advance(self.c, self._now_ns)

    @property
    def is_ready(self) -> bool:
        return bool(lib.lsm9ds0_chip_pin_is_high(self.c, lib.LSM9DS0_CHIP_DRDY_G))

    def hold(
        self,
        gyr: Triple = (0, 0, 0),
        acc: Triple = (0, 0, 9.80665),
        mag: Triple = (0, 20, -40),
    ) -> None:
        lib.lsm9ds0_chip_hold(self.c, gyr, acc, mag)

    def fault(self, kind: int, **fields: Any) -> None:
        fault = ffi.new("struct chip_fault *", {"kind": kind, **fields})
        assert lib.i2c_slave_add_fault(lib.lsm9ds0_chip_wire(self.c), fault)

    @property
    def complaint(self) -> str | None:
        text = lib.lsm9ds0_chip_complaint(self.c)
        return ffi.string(text).decode() if text != ffi.NULL else None


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
