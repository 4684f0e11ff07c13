# SPDX-License-Identifier: MIT
"""The LSM9DS0 as a register file typed from the data sheet, apart from the model of
sim/chips."""

from __future__ import annotations

from typing import Any

import native
from core.sensor_desk import Clock

ffi, lib = native.load()
Triple = tuple[float, float, float]
BIT_US = 2.5  # 400 kHz
ACC_PASSED, GYR_PASSED = lib.SELF_TEST_ACC_PASSED, lib.SELF_TEST_GYR_PASSED
ACC_FAILED, GYR_FAILED = lib.SELF_TEST_ACC_FAILED, lib.SELF_TEST_GYR_FAILED
BOTH_PASSED = ACC_PASSED | GYR_PASSED
G, XM = "gyroscope", "accelerometer and magnetometer"


# Data sheet, table 3: counts.
DPS_LSB = {0x00: 0.00875, 0x10: 0.0175, 0x20: 0.070}  # CTRL_REG4_G, FS
G_LSB = {0x00: 0.061e-3, 0x08: 0.122e-3, 0x10: 0.183e-3, 0x18: 0.244e-3, 0x20: 0.732e-3}
GAUSS_LSB = {0x00: 0.08e-3, 0x20: 0.16e-3, 0x40: 0.32e-3, 0x60: 0.48e-3}
GYR_HZ = {0x00: 95, 0x40: 190, 0x80: 380, 0xC0: 760}  # CTRL_REG1_G, DR
ACC_HZ = {0x80: 400, 0x90: 800, 0xA0: 1600}  # CTRL_REG1_XM, AODR
MAG_HZ = {0x10: 50, 0x14: 100}  # CTRL_REG5_XM, M_ODR


class Sensor(Clock):
    """One of the three: data that are overwritten unread are told."""

    def __init__(self, status: int) -> None:
        super().__init__()
        self.status = status  # register; the axes follow
        self.value = (0, 0, 0)

    def registers(self, now_us: float) -> bytes:
        waiting = self.made(now_us) - self.seen
        status = (0x0F if waiting > 0 else 0) | (0xF0 if waiting > 1 else 0)
        return bytes([status]) + b"".join(
            max(-32768, min(32767, value)).to_bytes(2, "little", signed=True)
            for value in self.value
        )


class Chip:
    """Two register files on a bus, and what the world does to them."""

    def __init__(self, gyr_address: int = 0x6B, xm_address: int = 0x1D) -> None:
        self.halves = {gyr_address: G, xm_address: XM}
        self.files = {G: bytearray(0x40), XM: bytearray(0x40)}
        self.files[G][0x0F], self.files[G][0x20] = 0xD4, 0x07
        self.files[XM][0x0F], self.files[XM][0x20] = 0x49, 0x07
        self.files[XM][0x24:0x27] = bytes([0x18, 0x20, 0x03])
        self.gyr, self.acc, self.mag = Sensor(0x27), Sensor(0x27), Sensor(0x07)
        self.gyr_dps: Triple = (0, 0, 0)
        self.acc_g: Triple = (0, 0, 1)
        self.mag_gauss: Triple = (0.2, 0, -0.4)
        self.temperature = 0  # 12 bits, as read
        self.gyr_response: Triple = (400, -400, -400)  # deg/s, at ST 01
        self.acc_response: Triple = (0.3, 0.3, 0.3)  # g, at AST 01
        self.absent: set[str] = set()
        self.now_us = 0.0
        self.log: list[tuple[float, str, str, int, int]] = []

    def await_edge(self) -> None:
        """Let time pass to the next rising edge of DRDY_G."""
        self.now_us = max(self.now_us, self.gyr.next_us() + 1)

    def update(self) -> None:
        g, xm = self.files[G], self.files[XM]
        gyr_is_on = g[0x20] & 0x0F == 0x0F
        self.gyr.run(GYR_HZ[g[0x20] & 0xC0] if gyr_is_on else 0, self.now_us)
        acc_hz = ACC_HZ.get(xm[0x20] & 0xF0, 0) if xm[0x20] & 7 == 7 else 0
        self.acc.run(acc_hz, self.now_us)
        mag_hz = MAG_HZ.get(xm[0x24] & 0x1C, 0) if xm[0x26] & 0x03 == 0 else 0
        self.mag.run(mag_hz, self.now_us)
        is_tested = g[0x23] & 0x06 == 0x02
        self.gyr.value = counted(
            self.gyr_dps, self.gyr_response, is_tested, DPS_LSB[g[0x23] & 0x30]
        )
        is_tested = xm[0x21] & 0x06 == 0x02
        self.acc.value = counted(
            self.acc_g, self.acc_response, is_tested, G_LSB[xm[0x21] & 0x38]
        )
        lsb = GAUSS_LSB[xm[0x25] & 0x60]
        x, y, z = self.mag_gauss  # figure 1: its z is the others' turned round
        self.mag.value = counted((x, y, -z), (0, 0, 0), False, lsb)

    def transfer(self, what: str, address: int, reg: int, length: int) -> str | None:
        half = self.halves.get(address)
        self.log.append((self.now_us, what, half or "nobody", reg & 0x7F, length))
        # Address, sub-address, address once more where it reads; START and STOP.
        count = length + (3 if what == "read" else 2)
        self.now_us += (9 * count + 3) * BIT_US
        return None if half in self.absent else half

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.update()
        first = reg & 0x7F
        half = self.halves.get(address)
        sensors = {G: [self.gyr], XM: [self.acc, self.mag]}.get(half or "", [])
        image = bytearray(self.files[half]) if half else bytearray()
        for sensor in sensors:
            start = sensor.status
            image[start : start + 7] = sensor.registers(self.now_us)
        if half == XM and self.files[XM][0x24] & 0x80:
            image[0x05:0x07] = self.temperature.to_bytes(2, "little")
        if self.transfer("read", address, reg, length) is None:
            return int(lib.BUS_NACK)
        where = [first + i if reg & 0x80 else first for i in range(length)]
        ffi.memmove(data, bytes(image[at] for at in where), length)
        for sensor in sensors:
            if sensor.status + 6 in where:
                sensor.seen = sensor.made(self.now_us)
        return int(lib.BUS_OK)

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        half = self.transfer("write", address, reg, length)
        if half is None:
            return int(lib.BUS_NACK)
        for i, value in enumerate(bytes(ffi.buffer(data, length))):
            at = (reg & 0x7F) + (i if reg & 0x80 else 0)
            assert at >= 0x12, f"{at:#x} is read only"
            self.files[half][at] = value
        self.update()
        return int(lib.BUS_OK)


def counted(
    value: Triple, response: Triple, is_tested: bool, lsb: float
) -> tuple[int, int, int]:
    sums = [v + r * is_tested for v, r in zip(value, response, strict=True)]
    x, y, z = (round(s / lsb) for s in sums)
    return x, y, z
