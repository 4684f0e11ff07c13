# SPDX-License-Identifier: MIT
"""The MPU-9250's model on a desk, for its tests."""

from __future__ import annotations

import functools
from typing import Any

import chips
from sim import sensor_desk
from sim.sensor_desk import MS, SensorDesk

MPU, AK = 0x68, 0x0C

ffi, lib = chips.load("mpu9250", core=False)
recorder = functools.partial(sensor_desk.recorder, ffi)


class Chip(SensorDesk):
    """A chip that answers at once; registers are the MPU's unless told otherwise."""

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
        return bool(self.call("int_is_high"))

    def peek(self, reg: int) -> int:
        return int(self.call("peek", reg))

    def peek_ak8963(self, reg: int) -> int:
        return int(self.call("peek_ak8963", reg))

    def edges(self, ms: float) -> list[int]:
        """When INT rises within the time, in ns."""
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
        """Go on to the next rise of INT."""
        while self.int_is_high():
            self.advance(self.next_event())
        while not self.int_is_high():
            self.advance(self.next_event())

    def sample(self, divider: int = 4, dlpf: int = 3) -> None:
        """Samples and interrupts from now on, by default at 200 Hz."""
        self.write(26, dlpf)
        self.write(25, divider)
        self.write(56, 0x01)

    def bypass(self) -> None:
        """The host reaches the AK8963."""
        self.write(106, 0x00)
        self.write(55, 0x02)

    def ak_mode(self, mode: int) -> None:
        """AK 6.3: through power-down, with 100 us in it; by the bypass."""
        self.write(0x0A, 0x00, address=AK)
        self.wait(0.1)
        self.write(0x0A, mode, address=AK)

    def burst_of_22(self, ctrl: int = 0x4D) -> None:
        """ST1, the data and ST2 of the AK8963 behind the chip's own 14 bytes."""
        self.bypass()
        self.ak_mode(0x16)
        self.write(55, 0x00)
        self.write(106, 0x20)
        self.write(36, ctrl)
        self.write(37, 0x80 | AK, 0x02, 0x80 | 8)
        self.sample()
