# SPDX-License-Identifier: MIT
"""An LSM6DSOX and a LIS3MDL as register files typed from their documents, on one bus,
apart from the models of sim/chips.

DS: data sheets of the LSM6DSO32, DocID032891 revision 1, and of the LIS3MDL,
DocID024204.
"""

from __future__ import annotations

from typing import Any

import native
from core.sensor_desk import Clock

ffi, lib = native.load()
Triple = tuple[float, float, float]
BIT_US = 2.5  # 400 kHz

ACC_HZ = {0x30: 52, 0x50: 208}  # CTRL1_XL, DS table 44
GYR_HZ = {0x50: 208}  # CTRL2_G, DS table 48
G_LSB = {0x00: 0.061e-3, 0x04: 0.488e-3, 0x08: 0.122e-3, 0x0C: 0.244e-3}
DPS_LSB = {0x00: 0.00875, 0x04: 0.0175, 0x08: 0.035, 0x0C: 0.07}
GAUSS_LSB = {0x00: 1 / 6842, 0x20: 1 / 3421, 0x40: 1 / 2281, 0x60: 1 / 1711}


def words(values: tuple[float, ...]) -> bytes:
    return b"".join(
        max(-32768, min(32767, round(value))).to_bytes(2, "little", signed=True)
        for value in values
    )


def added(value: Triple, response: Triple, sign: int) -> Triple:
    x, y, z = (v + sign * r for v, r in zip(value, response, strict=True))
    return x, y, z


class Inertial:
    """LSM6DSOX."""

    def __init__(self, address: int = 0x6A, who: int = 0x6C) -> None:
        self.address, self.who = address, who
        self.acc, self.gyr = Clock(), Clock()
        self.acc_g: Triple = (0, 0, 1)
        self.gyr_dps: Triple = (0, 0, 0)
        self.temperature = 0  # counts
        self.acc_response: Triple = (0.5, 0.5, 0.5)  # g
        self.gyr_response: Triple = (400, 400, 400)  # deg/s
        self.g_lsb = dict(G_LSB)
        self.reset_us = 100.0  # that a reset takes
        self.resets_until_us = 0.0
        self.power_up()

    def power_up(self) -> None:
        self.registers = bytearray(0x80)
        self.registers[0x0F] = self.who
        self.registers[0x12] = 0x04  # IF_INC
        self.registers[0x18] = 0xE0

    def update(self, now_us: float) -> None:
        r = self.registers
        if r[0x12] & 0x01 and now_us >= self.resets_until_us:
            self.power_up()
            r = self.registers
        self.acc.run(ACC_HZ.get(r[0x10] & 0xF0, 0), now_us)
        self.gyr.run(GYR_HZ.get(r[0x11] & 0xF0, 0), now_us)

    def read(self, reg: int, length: int, now_us: float) -> bytes:
        self.update(now_us)
        r = bytearray(self.registers)
        acc_is_new = self.acc.made(now_us) > self.acc.seen
        gyr_is_new = self.gyr.made(now_us) > self.gyr.seen
        r[0x1E] = acc_is_new | gyr_is_new << 1
        r[0x20:0x22] = words((self.temperature,))
        sign = {0: 0, 0x04: 1, 0x0C: -1}[r[0x14] & 0x0C]
        rates = added(self.gyr_dps, self.gyr_response, sign)
        lsb = DPS_LSB[r[0x11] & 0x0C]
        r[0x22:0x28] = words(tuple(rate / lsb for rate in rates))
        sign = {0: 0, 0x01: 1, 0x02: -1}[r[0x14] & 0x03]
        forces = added(self.acc_g, self.acc_response, sign)
        lsb = self.g_lsb[r[0x10] & 0x0C]
        r[0x28:0x2E] = words(tuple(force / lsb for force in forces))
        moves = bool(self.registers[0x12] & 0x04)
        where = [reg + i * moves for i in range(length)]
        if 0x27 in where:
            self.gyr.seen = self.gyr.made(now_us)
        if 0x2D in where:
            self.acc.seen = self.acc.made(now_us)
        return bytes(r[at] for at in where)

    def write(self, reg: int, value: int, now_us: float) -> None:
        assert reg in (0x0B, 0x0D, 0x0E, *range(0x10, 0x1A)), f"{reg:#x}"
        self.registers[reg] = value
        if reg == 0x12 and value & 0x01:
            self.resets_until_us = now_us + self.reset_us
        self.update(now_us)


class Magnetic:
    """LIS3MDL."""

    def __init__(self, address: int = 0x1C, who: int = 0x3D) -> None:
        self.address, self.who = address, who
        self.clock = Clock()
        self.gauss: Triple = (0.2, 0, -0.4)
        self.response: Triple = (2, 2, 0.5)
        self.reset_us = 100.0
        self.resets_until_us = 0.0
        self.power_up()

    def power_up(self) -> None:
        self.registers = bytearray(0x40)
        self.registers[0x0F] = self.who
        self.registers[0x20], self.registers[0x22] = 0x10, 0x03

    def update(self, now_us: float) -> None:
        r = self.registers
        if r[0x21] & 0x04 and now_us >= self.resets_until_us:
            self.power_up()
            r = self.registers
        is_on = r[0x22] & 0x03 == 0 and r[0x20] & 0x1E == 0x1C
        self.clock.run(80 if is_on else 0, now_us)

    def read(self, reg: int, length: int, now_us: float) -> bytes:
        self.update(now_us)
        r = bytearray(self.registers)
        waiting = self.clock.made(now_us) - self.clock.seen
        r[0x27] = (0x0F if waiting > 0 else 0) | (0xF0 if waiting > 1 else 0)
        field = added(self.gauss, self.response, r[0x20] & 0x01)
        lsb = GAUSS_LSB[r[0x21] & 0x60]
        r[0x28:0x2E] = words(tuple(value / lsb for value in field))
        moves = bool(reg & 0x80)
        where = [(reg & 0x7F) + i * moves for i in range(length)]
        if 0x2D in where:
            self.clock.seen = self.clock.made(now_us)
        return bytes(r[at] for at in where)

    def write(self, reg: int, value: int, now_us: float) -> None:
        assert 0x20 <= reg <= 0x24, f"{reg:#x}"
        self.registers[reg] = value
        if reg == 0x21 and value & 0x04:
            self.resets_until_us = now_us + self.reset_us
        self.update(now_us)


class Chips:
    """Both on a bus, and what the world does to them."""

    def __init__(
        self, inertial: Inertial | None = None, magnetic: Magnetic | None = None
    ) -> None:
        self.inertial = inertial or Inertial()
        self.magnetic = magnetic or Magnetic()
        self.absent: set[Any] = set()
        self.held: set[Any] = set()  # it holds the bus when it is addressed
        self.now_us = 0.0
        self.log: list[tuple[float, str, int, int, int]] = []

    def await_edge(self) -> None:
        """Let time pass to the next data-ready of the gyroscope."""
        self.now_us = max(self.now_us, self.inertial.gyr.next_us() + 1)

    def _at(self, what: str, address: int, reg: int, length: int) -> Any:
        self.log.append((self.now_us, what, address, reg, length))
        self.now_us += (9 * (length + (3 if what == "read" else 2)) + 3) * BIT_US
        for chip in (self.inertial, self.magnetic):
            if chip.address == address and chip not in self.absent:
                return chip
        return None

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        asked_us = self.now_us
        chip = self._at("read", address, reg, length)
        if chip is None:
            return int(lib.BUS_NACK)
        if chip in self.held:
            return int(lib.BUS_STUCK)
        ffi.memmove(data, chip.read(reg, length, asked_us), length)
        return int(lib.BUS_OK)

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        assert length == 1
        chip = self._at("write", address, reg, length)
        if chip is None:
            return int(lib.BUS_NACK)
        if chip in self.held:
            return int(lib.BUS_STUCK)
        chip.write(reg, data[0], self.now_us)
        return int(lib.BUS_OK)
