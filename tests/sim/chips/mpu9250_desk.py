# SPDX-License-Identifier: MIT
"""The model of the MPU-9250 with an I2C master, for its tests."""

from __future__ import annotations

import functools
from typing import Any

import native
from sim.chips import sensor_desk
from sim.chips.sensor_desk import MS, SensorDesk

MPU, AK = 0x68, 0x0C

ffi, lib = native.load()
recorder = functools.partial(sensor_desk.recorder, ffi)


class Chip(SensorDesk):
    """A chip without start-up time. Without an address, registers are the MPU's."""

    def __init__(self, **config: Any) -> None:
        super().__init__("mpu9250", ffi, lib, **({"startup_ns": 0} | config))

    def read(self, reg: int, length: int = 1, address: int = MPU) -> list[int]:
        return self.get(address, reg, length)

    def try_read(self, reg: int, address: int = MPU) -> int:
        return self.try_get(address, reg)

    def write(self, reg: int, *values: int, address: int = MPU) -> None:
        self.put(address, reg, *values)

    def words(self, reg: int, count: int) -> list[int]:
        data = bytes(self.read(reg, 2 * count))
        return [
            int.from_bytes(data[i : i + 2], "big", signed=True)
            for i in range(0, len(data), 2)
        ]

    def int_is_high(self) -> bool:
        return bool(self.call("pin_is_high", 0))

    def peek_ak8963(self, reg: int) -> int:
        return self.peek(reg, lib.MPU9250_CHIP_AK8963)

    def edges(self, ms: float) -> list[int]:
        """The times in ns at which INT rises during the next `ms`."""
        end = self.now[0] + round(ms * MS)
        rises = []
        level = self.int_is_high()
        while (event := self.next_event()) <= end:
            self.advance(event)
            if self.int_is_high() and not level:
                rises.append(event)
            level = self.int_is_high()
        self.advance(end)
        return rises

    def edge(self) -> None:
        """Let time pass until INT rises."""
        while self.int_is_high():
            self.advance(self.next_event())
        while not self.int_is_high():
            self.advance(self.next_event())

    def sample(self, divider: int = 4, dlpf: int = 3) -> None:
        """Start samples and interrupts, by default at 200 Hz."""
        self.write(26, dlpf)
        self.write(25, divider)
        self.write(56, 0x01)

    def bypass(self) -> None:
        """Connect the AK8963 to the host's bus."""
        self.write(106, 0x00)
        self.write(55, 0x02)

    def ak_mode(self, mode: int) -> None:
        """Set a mode through the bypass, after 100 us of power-down (AK 6.3)."""
        self.write(0x0A, 0x00, address=AK)
        self.wait(0.1)
        self.write(0x0A, mode, address=AK)

    def burst_of_22(self, ctrl: int = 0x4D) -> None:
        """Have ST1, the data and ST2 of the AK8963 follow the chip's own 14 bytes."""
        self.bypass()
        self.ak_mode(0x16)
        self.write(55, 0x00)
        self.write(106, 0x20)
        self.write(36, ctrl)
        self.write(37, 0x80 | AK, 0x02, 0x80 | 8)
        self.sample()
