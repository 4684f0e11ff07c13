# SPDX-License-Identifier: MIT
"""The C module imuprobe; docs/micropython.md explains its methods."""

from collections.abc import Callable
from typing import Final, Protocol

LSM6DSOX: Final[int]
LSM9DS0: Final[int]
MPU9250: Final[int]

class Storage(Protocol):
    def load(self, cells: bytearray, /) -> object: ...
    def save(self, cells: bytearray, /) -> object: ...

class Bus(Protocol):
    def readfrom_mem_into(
        self, address: int, register: int, data: bytearray, /
    ) -> object: ...
    def writeto_mem(
        self, address: int, register: int, data: bytearray, /
    ) -> object: ...

class Level(Protocol):
    def value(self) -> object: ...

class Stream(Protocol):
    def read(self, length: int, /) -> bytes | None: ...
    def write(self, data: bytes, /) -> int | None: ...

class Probe:
    def __init__(
        self,
        storage: Storage | None = None,
        *,
        id: bytes,
        firmware: str,
        board: int = ...,
        reset_cause: int = 0,
        mhz: int = 1,
        room: int = 4096,
        time_us: int | None = None,
    ) -> None: ...
    def attach(
        self,
        kind: int,
        i2c: Bus,
        ready: Level,
        recover: Callable[[], bool] | None = None,
        *,
        gyr: int = 0,
        xm: int = 0,
        fast: bool = False,
    ) -> None: ...
    def edge(self, pin: object, /) -> None: ...
    def acquire(self) -> bool: ...
    def sensor(
        self,
        kind: int,
        rate_hz: int,
        acc_lsb: int,
        gyr_lsb: int,
        mag_lsb: int,
        who_am_i: int = 0,
        time_us: int = ...,
        /,
    ) -> None: ...
    def sample(self, values: object, time_us: int = ..., /) -> bool: ...
    def receive(self, source: Stream | bytes, time_us: int = ..., /) -> int: ...
    def send(self, stream: Stream, most: int = ..., /) -> int: ...
    def take(self, buffer: bytearray, /) -> int: ...
    def step(self, is_down: bool, time_us: int = ..., /) -> bool: ...
    def tell(
        self, event: int, cause: int, detail: int, time_us: int = ..., /
    ) -> None: ...
    def supply(self, mv: int, /) -> None: ...
    def battery(self, mv: int, is_low: bool, /) -> None: ...
    def wants_reset(self) -> bool: ...
