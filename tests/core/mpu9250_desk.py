# SPDX-License-Identifier: MIT
"""The MPU-9250's driver on a desk, with the chip's model."""

from __future__ import annotations

from typing import Any

from core.sensor_desk import DEGREE, G, SensorBench, ffi, lib
from sim.chips.sensor_desk import SensorDesk

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
        chip = SensorDesk("mpu9250", ffi, lib, **config)
        chips = {0x68: chip}
        super().__init__(ffi.new("struct mpu9250 *"), chips, start_us, read, write)

    def read_chip(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        if data == ffi.addressof(self.driver, "read"):
            assert length == 1, "a byte beyond it is another member"
        return super().read_chip(_, address, reg, data, length)

    def settled(self) -> Any:
        """Return the last of enough samples for all filters to forget the past."""
        return self.samples(12)[-1]

    def settled_mag(self) -> Any:
        return [sample for sample in self.samples(16) if sample.has_mag][-1].mag


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
