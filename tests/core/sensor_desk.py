# SPDX-License-Identifier: MIT
"""A sensor's driver on a desk, with the models of its chips, whichever it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import native
from sim.chips.sensor_desk import SensorDesk, Triple

ffi, lib = native.load()
G = 9.80665
DEGREE = math.pi / 180
FIELD = (0.0, 0.2, -0.4)  # gauss
RESULTS = {0: int(lib.BUS_OK), -1: int(lib.BUS_NACK), -3: int(lib.BUS_STUCK)}

STEP_US = 1000  # between two calls of set-up
SETUP_MAX_US = 2_000_000  # what set-up takes in the worst case, refusals included


class SensorBench:
    """A driver with models of its chips on one clock, and on one wire that can be
    pulled at a transaction.
    """

    def __init__(
        self,
        driver: Any,
        chips: dict[int, SensorDesk],
        start_us: int = 0,
        read: Callable[..., int] | None = None,
        write: Callable[..., int] | None = None,
    ) -> None:
        """`driver` is a struct of a driver; `chips` are by address, and pin 0 of the
        first one signals data; `read` and `write` move registers in place of theirs.
        """
        self.chips = chips
        self.chip = next(iter(chips.values()))
        for chip in chips.values():
            chip.now = self.chip.now
        self.driver = driver
        self.name = ffi.typeof(driver).item.cname.removeprefix("struct ")
        self.start_us = start_us
        self.edge_us = 0  # device time of the last one
        self.transactions = 0
        self.pulled_at: int | None = None
        self.pulled = (0, 0)  # address and register of the pulled transaction
        self.longest_step_ns = 0
        # us, "read" or "write", address, register, length
        self.log: list[tuple[float, str, int, int, int]] = []
        self._read = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, uint8_t *, uint8_t)",
            self._wired(read or self.read_chip),
        )
        self._write = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, const uint8_t *, uint8_t)",
            self._wired(write or self.write_chip),
        )
        self.bus = ffi.new(
            "struct bus_device *", {"read": self._read, "write": self._write}
        )

    @property
    def now_ns(self) -> int:
        return int(self.chip.now[0])

    @now_ns.setter
    def now_ns(self, now_ns: int) -> None:
        self.chip.now[0] = now_ns

    def let_pass(self, us: float) -> None:
        """Lets the clock and the chips run on."""
        for chip in self.chips.values():
            chip.call("advance", self.now_ns + round(us * 1000))
        self.now_ns += round(us * 1000)

    def read_chip(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.log.append((self.now_ns / 1e3, "read", address, reg, length))
        chip = self.chips.get(address, self.chip)
        made = ffi.new("uint8_t[]", length)
        result = chip.try_get(address, reg, made)
        if result == 0:
            ffi.memmove(data, made, length)
        return RESULTS[result]

    def write_chip(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.log.append((self.now_ns / 1e3, "write", address, reg, length))
        chip = self.chips.get(address, self.chip)
        return RESULTS[chip.try_put(address, reg, *ffi.buffer(data, length)[:])]

    def _wired(self, move: Callable[..., int]) -> Callable[..., int]:
        def transfer(*arguments: Any) -> int:
            self.transactions += 1
            if self.transactions == self.pulled_at:
                self.pulled = arguments[1:3]
                return int(lib.BUS_NACK)
            return int(move(*arguments))

        return transfer

    def call(self, verb: str, *arguments: Any) -> Any:
        """Call a function of the driver."""
        return getattr(lib, f"{self.name}_{verb}")(self.driver, *arguments)

    @property
    def now_us(self) -> int:
        return (self.now_ns // 1000 + self.start_us) & 0xFFFFFFFF

    def step(self) -> int:
        before = self.now_ns
        result = self.call("setup", self.bus, self.now_us)
        self.longest_step_ns = max(self.longest_step_ns, self.now_ns - before)
        return int(result)

    def set_up(self, step_us: int = STEP_US, bound_us: int = SETUP_MAX_US) -> int:
        """Begin, step until it is decided, return how."""
        self.call("begin")
        deadline_ns = self.now_ns + bound_us * 1000
        while (result := self.step()) == lib.SENSOR_BUSY:
            assert self.now_ns < deadline_ns, "set-up has no bound"
            self.let_pass(step_us)
        return result

    @property
    def bursts(self) -> list[tuple[int, int, int]]:
        """Address, register and length of each."""
        bursts = self.driver.bursts
        return [(b.address, b.reg, b.length) for b in bursts if b.length > 0]

    def parse(self, data: bytes, time_us: int = 0) -> Any:
        out = ffi.new("struct sample *")
        assert self.call("parse", data, time_us, out)
        return out

    def is_refused(self, data: bytes) -> bool:
        out = ffi.new("struct sample *")
        size = ffi.sizeof(out[0])
        ffi.memmove(out, b"\xa5" * size, size)
        if self.call("parse", data, 0, out):
            return False
        assert set(bytes(ffi.buffer(out))) == {0xA5}, "written anyway"
        return True

    def next_edge(self) -> None:
        """Let time pass until data are ready."""
        deadline_ns = self.now_ns + 20_000_000
        while not self.chip.call("pin_is_high", 0):
            event_ns = self.chip.next_event()
            assert event_ns <= deadline_ns, "no data-ready within 20 ms"
            self.chip.advance(max(self.now_ns, event_ns))
        self.edge_us = self.now_us

    def take(self) -> bytes:
        """Read the bursts that the next data-ready edge starts."""
        self.next_edge()
        taken = b""
        for address, reg, length in self.bursts:
            data = ffi.new("uint8_t[]", length)
            assert self.read_chip(None, address, reg, data, length) == lib.BUS_OK
            taken += bytes(data)
        return taken

    def sample(self) -> Any:
        data = self.take()
        return self.parse(data, self.edge_us)

    def samples(self, count: int) -> list[Any]:
        return [self.sample() for _ in range(count)]

    @property
    def identity(self) -> Any:
        return self.driver.identity

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

    def hold(
        self, dps: Triple = (0, 0, 0), g: Triple = (0, 0, 1), gauss: Triple = FIELD
    ) -> None:
        """The motion and the field from now on."""
        units = ((dps, DEGREE), (g, G), (gauss, 100.0))
        world = [[unit * value for value in values] for values, unit in units]
        for chip in self.chips.values():
            chip.hold(*world)

    def flip(self, chip: SensorDesk, reg: int, value: int, die: int = 0) -> None:
        """Have a register change by itself."""
        chip.fault("REGISTER_FLIP", from_ns=self.now_ns, reg=reg, value=value, die=die)
        self.let_pass(1)

    @property
    def complaint(self) -> str | None:
        """The first thing that the driver did against the documents."""
        complaints = (chip.complaint() for chip in self.chips.values())
        return next((each for each in complaints if each), None)


def axes(counts: Any) -> tuple[int, int, int]:
    return counts.x, counts.y, counts.z
