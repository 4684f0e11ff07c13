# SPDX-License-Identifier: MIT
"""A sensor's driver and its chip on a desk, whichever sensor it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

STEP_US = 1000  # between two calls of set-up
SETUP_MAX_US = 2_000_000  # what set-up takes in the worst case, refusals included


class SensorBench(ABC):
    """One clock, and one wire that can be pulled at a transaction."""

    def __init__(
        self,
        ffi: Any,
        lib: Any,
        driver: Any,
        read: Callable[..., int],
        write: Callable[..., int],
        start_us: int,
    ) -> None:
        """`driver` is a struct of a driver; `read` and `write` move its registers."""
        self.ffi, self.lib, self.driver = ffi, lib, driver
        self.name = ffi.typeof(driver).item.cname.removeprefix("struct ")
        self.start_us = start_us
        self.transactions = 0
        self.pulled_at: int | None = None
        self.pulled = (0, 0)  # address and register of the pulled transaction
        self.longest_step_ns = 0
        self._read = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, uint8_t *, uint8_t)",
            self._wired(read),
        )
        self._write = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, const uint8_t *, uint8_t)",
            self._wired(write),
        )
        self.bus = ffi.new(
            "struct bus_device *", {"read": self._read, "write": self._write}
        )

    @property
    @abstractmethod
    def clock_ns(self) -> int:
        """Time on this bench."""

    @abstractmethod
    def let_pass(self, us: int) -> None:
        """Lets the clock and the chip run on."""

    @abstractmethod
    def sample(self) -> Any:
        """Take the sample that the next data-ready edge starts."""

    def _wired(self, move: Callable[..., int]) -> Callable[..., int]:
        def transfer(*arguments: Any) -> int:
            self.transactions += 1
            if self.transactions == self.pulled_at:
                self.pulled = arguments[1:3]
                return int(self.lib.BUS_NACK)
            return int(move(*arguments))

        return transfer

    def call(self, verb: str, *arguments: Any) -> Any:
        """Call a function of the driver."""
        return getattr(self.lib, f"{self.name}_{verb}")(self.driver, *arguments)

    @property
    def now_us(self) -> int:
        return (self.clock_ns // 1000 + self.start_us) & 0xFFFFFFFF

    def step(self) -> int:
        before = self.clock_ns
        result = self.call("setup", self.bus, self.now_us)
        self.longest_step_ns = max(self.longest_step_ns, self.clock_ns - before)
        return int(result)

    def set_up(self, step_us: int = STEP_US, bound_us: int = SETUP_MAX_US) -> int:
        """Begin, step until it is decided, return how."""
        self.call("begin")
        deadline_ns = self.clock_ns + bound_us * 1000
        while (result := self.step()) == self.lib.SENSOR_BUSY:
            assert self.clock_ns < deadline_ns, "set-up has no bound"
            self.let_pass(step_us)
        return result

    @property
    def bursts(self) -> list[tuple[int, int, int]]:
        """Address, register and length of each."""
        return [(b.address, b.reg, b.length) for b in self.driver.bursts]

    def parse(self, data: bytes, time_us: int = 0) -> Any:
        out = self.ffi.new("struct sample *")
        assert self.call("parse", data, time_us, out)
        return out

    def samples(self, count: int) -> list[Any]:
        return [self.sample() for _ in range(count)]

    @property
    def identity(self) -> Any:
        return self.driver.identity


class Clock:
    """Measures at a rate; data are ready until they are read."""

    def __init__(self) -> None:
        self.hz = 0.0  # 0: off
        self.error = 1.0  # of its rate
        self.begun_us = 0.0
        self.seen = 0  # measurements when its data were last read
        self.is_silent = False

    def run(self, hz: float, now_us: float) -> None:
        if hz != self.hz:
            self.hz, self.begun_us, self.seen = hz, now_us, 0

    def tune(self, error: float, now_us: float) -> None:
        self.error, self.begun_us, self.seen = error, now_us, 0

    def made(self, now_us: float) -> int:
        if self.is_silent or self.hz == 0:
            return 0
        return int((now_us - self.begun_us) * self.hz * self.error / 1e6 + 1e-6)

    def next_us(self) -> float:
        return self.begun_us + (self.seen + 1) * 1e6 / (self.hz * self.error)


class RegisterBench(SensorBench):
    """A driver with a register file that has `read`, `write`, `await_edge` and a
    settable `now_us`.
    """

    def __init__(self, ffi: Any, lib: Any, driver: Any, chip: Any, start_us: int):
        self.chip = chip
        super().__init__(ffi, lib, driver, chip.read, chip.write, start_us)

    @property
    def clock_ns(self) -> int:
        return int(self.chip.now_us * 1000)

    def let_pass(self, us: int) -> None:
        self.chip.now_us += us

    @property
    def bursts(self) -> list[tuple[int, int, int]]:
        return [burst for burst in super().bursts if burst[2] > 0]

    def take(self) -> bytes:
        """Read the bursts that the next data-ready edge starts."""
        self.chip.await_edge()
        taken = b""
        for address, reg, length in self.bursts:
            data = self.ffi.new("uint8_t[]", length)
            assert self.chip.read(None, address, reg, data, length) == self.lib.BUS_OK
            taken += bytes(data)
        return taken

    def is_refused(self, data: bytes) -> bool:
        out = self.ffi.new("struct sample *")
        size = self.ffi.sizeof(out[0])
        self.ffi.memmove(out, b"\xa5" * size, size)
        if self.call("parse", data, 0, out):
            return False
        assert set(bytes(self.ffi.buffer(out))) == {0xA5}, "written anyway"
        return True

    def sample(self) -> Any:
        return self.parse(self.take())


def axes(counts: Any) -> tuple[int, int, int]:
    return counts.x, counts.y, counts.z
