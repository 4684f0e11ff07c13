# SPDX-License-Identifier: MIT
"""The MPU-9250's driver on a desk, with the chip's model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import native
from core.sensor_desk import SensorBench

ffi, lib = native.load()
G = 9.80665
DEGREE = math.pi / 180
ACC_LSB = 16 * G / 32768
GYR_LSB = 2000 * DEGREE / 32768
MAG_LSB = 0.15
HOST_JUDGES = lib.SELF_TEST_HOST_JUDGES
AT_REST = (0, 0, 16384, 0, 0, 0)  # counts at 2 g and 250 deg/s


class Bench(SensorBench):
    """The driver with the model of its chip."""

    def __init__(
        self, start_us: int = 0, read: Any = None, write: Any = None, **config: Any
    ) -> None:
        settings = lib.mpu9250_chip_defaults()
        for name, value in config.items():
            setattr(settings, name, value)
        self.chip = ffi.gc(
            lib.mpu9250_chip_new(ffi.new("struct mpu9250_chip_config *", settings)),
            lib.sensor_chip_free,
        )
        self.now_ns = 0
        self.log: list[tuple[float, str, int]] = []  # ms, "read" or "write", register
        driver = ffi.new("struct mpu9250 *")
        super().__init__(
            *(ffi, lib, driver),
            *(read or self._read_chip, write or self._write_chip, start_us),
        )

    @property
    def clock_ns(self) -> int:
        return self.now_ns

    def let_pass(self, us: int) -> None:
        self.now_ns += us * 1000
        lib.sensor_chip_advance(self.chip, self.now_ns)

    def _read_chip(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.log.append((self.now_ns / 1e6, "read", reg))
        if data == ffi.addressof(self.driver, "read"):
            assert length == 1, "a byte beyond it is another member"
        return self._transfer(lib.i2c_slave_read_registers, address, reg, data, length)

    def _write_chip(
        self, _: Any, address: int, reg: int, data: Any, length: int
    ) -> int:
        self.log.append((self.now_ns / 1e6, "write", reg))
        return self._transfer(lib.i2c_slave_write_registers, address, reg, data, length)

    def _transfer(
        self, move: Callable[..., int], address: int, reg: int, data: Any, length: int
    ) -> int:
        now = ffi.new("uint64_t *", self.now_ns)
        result = move(lib.sensor_chip_wire(self.chip), now, address, reg, data, length)
        self.now_ns = now[0]
        return {0: lib.BUS_OK, -1: lib.BUS_NACK, -3: lib.BUS_STUCK}[result]

    def hold(
        self,
        gyr: tuple[float, float, float] = (0, 0, 0),
        acc: tuple[float, float, float] = (0, 0, G),
        mag: tuple[float, float, float] = (0, 20, -40),
    ) -> None:
        lib.sensor_chip_hold(self.chip, gyr, acc, mag)

    def fault(self, kind: int, **fields: Any) -> None:
        fault = ffi.new("struct chip_fault *", {"kind": kind, **fields})
        assert lib.i2c_slave_add_fault(lib.sensor_chip_wire(self.chip), fault)

    def next_edge(self) -> None:
        """Let time pass to the next rising edge of INT."""
        was_high = lib.sensor_chip_pin_is_high(self.chip, 0)
        deadline_ns = self.now_ns + 20_000_000
        while True:
            event_ns = lib.sensor_chip_next_event(self.chip)
            assert event_ns <= deadline_ns, "no data-ready within 20 ms"
            self.now_ns = max(self.now_ns, event_ns)
            lib.sensor_chip_advance(self.chip, self.now_ns)
            is_high = lib.sensor_chip_pin_is_high(self.chip, 0)
            if is_high and not was_high:
                return
            was_high = is_high

    def sample(self) -> Any:
        """Take the burst that the next data-ready edge starts."""
        self.next_edge()
        time_us = self.now_us
        burst = self.burst
        data = ffi.new("uint8_t[]", burst.length)
        result = self._read_chip(None, burst.address, burst.reg, data, burst.length)
        assert result == lib.BUS_OK
        return self.parse(bytes(data), time_us)

    @property
    def burst(self) -> Any:
        (burst,) = self.driver.bursts
        return burst

    def settled(self) -> Any:
        """Return the last of enough samples for all filters to forget the past."""
        return self.samples(12)[-1]

    def settled_mag(self) -> Any:
        return [sample for sample in self.samples(16) if sample.has_mag][-1].mag

    def check(self) -> int:
        """Look after the sensor, a second after the last sample."""
        return int(self.call("check", self.bus))

    def checks(self, count: int) -> list[int]:
        """The results of some checks, with samples between them."""
        results = []
        for _ in range(count):
            self.samples(4)
            results.append(self.check())
        return results

    @property
    def complaint(self) -> str | None:
        text = lib.sensor_chip_complaint(self.chip)
        return ffi.string(text).decode() if text != ffi.NULL else None

    def register(self, reg: int) -> int:
        return int(lib.sensor_chip_peek(self.chip, 1, reg))

    def mag_register(self, reg: int) -> int:
        return int(lib.sensor_chip_peek(self.chip, 2, reg))


def running(**config: Any) -> Bench:
    bench = Bench(**config)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


class Scripted:
    """A chip that answers the self-test just as it is told, and little else."""

    def __init__(self) -> None:
        self.response = [0] * 6  # counts that the stimulus adds; acc, gyr
        self.rest = list(AT_REST)
        self.codes = [0] * 6
        self.mag_test: tuple[int, int, int] | None = (0, 0, -2000)
        self.name, self.mag_id = 0x71, 0x48
        self.refusals = 0  # transfers that the AK8963 does not acknowledge
        self.is_master_dead = False
        self.deaf: set[int] = set()  # registers that keep nothing
        self.registers = bytearray(128)
        self.mag_registers = bytearray(32)
        self.mag_registers[0x10:0x13] = b"\x80\x80\x80"

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        if address == 0x0C:
            return self._read_mag(reg, data, length)
        assert address == 0x68
        if reg == 0x3B:
            is_on = self.registers[0x1B] == 0xE0
            values = [
                rest + (added if is_on else 0)
                for rest, added in zip(self.rest, self.response, strict=True)
            ]
            values.insert(3, 0)
            made = b"".join(value.to_bytes(2, "big", signed=True) for value in values)
        elif reg == 0x75:
            made = bytes([self.name])
        elif reg in range(3):
            made = bytes(self.codes[3 + reg :])
        elif reg in range(0x0D, 0x10):
            made = bytes(self.codes[reg - 0x0D :])
        elif reg == 0x36:
            made = b"\0" if self.is_master_dead else b"\x40"
        else:
            made = bytes(self.registers[reg : reg + length])
        ffi.memmove(data, made, length)
        return int(lib.BUS_OK)

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        value = bytes(ffi.buffer(data, length))
        if address == 0x0C:
            return self._write_mag(reg, *value)
        assert address == 0x68
        if reg not in self.deaf:
            self.registers[reg : reg + length] = value
        self.registers[0x3A] = self.registers[0x38]  # ready as soon as enabled
        return int(lib.BUS_OK)

    def _answers(self) -> bool:
        assert self.registers[0x37] == 0x02, "no bypass"
        assert self.registers[0x6A] == 0x00, "two masters"
        self.refusals -= self.refusals > 0
        return self.refusals == 0

    def _read_mag(self, reg: int, data: Any, length: int) -> int:
        if not self._answers():
            return int(lib.BUS_NACK)
        self.mag_registers[0x00] = self.mag_id
        ffi.memmove(data, bytes(self.mag_registers[reg : reg + length]), length)
        return int(lib.BUS_OK)

    def _write_mag(self, reg: int, value: int) -> int:
        if not self._answers():
            return int(lib.BUS_NACK)
        self.mag_registers[reg] = value
        if reg == 0x0A and value == 0x18 and self.mag_test is not None:
            assert self.mag_registers[0x0C] == 0x40, "the field is not on"
            for axis, count in enumerate(self.mag_test):
                place = slice(3 + 2 * axis, 5 + 2 * axis)
                self.mag_registers[place] = count.to_bytes(2, "little", signed=True)
        return int(lib.BUS_OK)


def scripted(**settings: Any) -> Bench:
    chip = Scripted()
    for name, value in settings.items():
        setattr(chip, name, value)
    return Bench(read=chip.read, write=chip.write)
