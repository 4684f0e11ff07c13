# SPDX-License-Identifier: MIT
"""The driver of a joined sensor on a desk: an LSM6DSOX and a LIS3MDL, as the module
4517 has them."""

from __future__ import annotations

from typing import Any

from core.joined_chip import Chips, ffi, lib
from core.sensor_desk import SensorBench, axes


class Bench(SensorBench):
    """The driver with chips that have `read`, `write` and a settable `now_us`."""

    def __init__(
        self, chips: Any = None, start_us: int = 0, config: Any = None
    ) -> None:
        self.chips = chips or Chips()
        self.config = config or ffi.addressof(lib.adafruit_4517)
        driver = ffi.new("struct joined *", {"config": self.config})
        super().__init__(ffi, lib, driver, self.chips.read, self.chips.write, start_us)

    @property
    def clock_ns(self) -> int:
        return int(self.chips.now_us * 1000)

    def let_pass(self, us: int) -> None:
        self.chips.now_us += us

    @property
    def bursts(self) -> list[tuple[int, int, int]]:
        return [burst for burst in super().bursts if burst[2] > 0]

    def take(self) -> bytes:
        """Read the bursts that the next data-ready edge starts."""
        self.chips.await_edge()
        taken = b""
        for address, reg, length in self.bursts:
            data = ffi.new("uint8_t[]", length)
            assert self.chips.read(None, address, reg, data, length) == lib.BUS_OK
            taken += bytes(data)
        return taken

    def is_refused(self, data: bytes) -> bool:
        out = ffi.new("struct sample *")
        ffi.memmove(out, b"\xa5" * ffi.sizeof(out[0]), ffi.sizeof(out[0]))
        if lib.joined_parse(self.driver, data, 0, out):
            return False
        assert set(bytes(ffi.buffer(out))) == {0xA5}, "written all the same"
        return True

    def sample(self) -> Any:
        return self.parse(self.take())

    def field(self) -> tuple[int, int, int]:
        """The next field that arrives."""
        sample = next(s for s in (self.sample() for _ in range(40)) if s.has_mag)
        return axes(sample.mag)

    def check(self) -> int:
        return int(self.call("check", self.bus))

    def checks(self, count: int) -> list[int]:
        """The results of some checks, with samples between them."""
        results = []
        for _ in range(count):
            self.samples(4)
            results.append(self.check())
        return results


def running(chips: Any = None, **options: Any) -> Bench:
    bench = Bench(chips, **options)
    assert bench.set_up() == lib.SENSOR_OK
    return bench
