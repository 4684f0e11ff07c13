# SPDX-License-Identifier: MIT
"""The driver of a joined sensor on a desk: an LSM6DSOX and a LIS3MDL, as the module
4517 has them."""

from __future__ import annotations

from typing import Any

from core.joined_chip import Chips, ffi, lib
from core.sensor_desk import RegisterBench, axes


class Bench(RegisterBench):
    """The driver with its chips."""

    def __init__(
        self, chips: Any = None, start_us: int = 0, config: Any = None
    ) -> None:
        self.config = config or ffi.addressof(lib.adafruit_4517)
        driver = ffi.new("struct joined *", {"config": self.config})
        super().__init__(ffi, lib, driver, chips or Chips(), start_us)

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
