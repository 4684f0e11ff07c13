# SPDX-License-Identifier: MIT
"""The models of sim/chips of an LSM6DSOX and a LIS3MDL on one wire, behind what a bench
of a joined sensor uses of chips."""

from __future__ import annotations

from typing import Any

from core.joined_chip import Triple, ffi, lib

BYTE_NS = 22_500  # 400 kHz
G = 9.80665


class Models:
    """Both on a bus, by its bytes."""

    def __init__(
        self,
        inertial: dict[str, Any] | None = None,
        magnetic: dict[str, Any] | None = None,
    ) -> None:
        config = lib.lsm6dsox_chip_defaults()
        for name, value in (inertial or {}).items():
            setattr(config, name, value)
        self.inertial = ffi.gc(
            lib.lsm6dsox_chip_new(ffi.new("struct lsm6dsox_chip_config *", config)),
            lib.lsm6dsox_chip_free,
        )
        config = lib.lis3mdl_chip_defaults()
        for name, value in (magnetic or {}).items():
            setattr(config, name, value)
        self.magnetic = ffi.gc(
            lib.lis3mdl_chip_new(ffi.new("struct lis3mdl_chip_config *", config)),
            lib.lis3mdl_chip_free,
        )
        self.bus = ffi.new("struct i2c_bus *")
        self.bus.slaves[0] = lib.lsm6dsox_chip_wire(self.inertial)
        self.bus.slaves[1] = lib.lis3mdl_chip_wire(self.magnetic)
        self.bus.count = 2
        self._now_ns = 0

    @property
    def now_us(self) -> float:
        return self._now_ns / 1000

    @now_us.setter
    def now_us(self, now_us: float) -> None:
        self._now_ns = round(now_us * 1000)
        lib.lsm6dsox_chip_advance(self.inertial, self._now_ns)
        lib.lis3mdl_chip_advance(self.magnetic, self._now_ns)

    def _pass(self) -> int:
        self._now_ns += BYTE_NS
        return self._now_ns

    def _end(self, result: int) -> int:
        lib.i2c_bus_stop(self.bus, self._pass())
        return result

    def _to(self, address: int, *values: int) -> int:
        if lib.i2c_bus_holds_sda(self.bus, self._now_ns):
            return int(lib.BUS_STUCK)
        ok = lib.i2c_bus_start(self.bus, self._pass(), address, False)
        for value in values:
            ok = ok and lib.i2c_bus_write(self.bus, self._pass(), value)
        return int(lib.BUS_OK if ok else lib.BUS_NACK)

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        if (result := self._to(address, reg)) != lib.BUS_OK:
            return result if result == lib.BUS_STUCK else self._end(result)
        if not lib.i2c_bus_start(self.bus, self._pass(), address, True):
            return self._end(int(lib.BUS_NACK))
        for i in range(length):
            data[i] = lib.i2c_bus_read(self.bus, self._pass(), i + 1 < length)
        return self._end(int(lib.BUS_OK))

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        result = self._to(address, reg, *(data[i] for i in range(length)))
        return result if result == lib.BUS_STUCK else self._end(result)

    @property
    def is_ready(self) -> bool:
        pin = lib.LSM6DSOX_CHIP_INT1
        return bool(lib.lsm6dsox_chip_pin_is_high(self.inertial, pin))

    def await_edge(self) -> None:
        """Let time pass to the next rising edge of INT1."""
        assert not self.is_ready, "the edge has been"
        deadline_ns = self._now_ns + 20_000_000
        while not self.is_ready:
            self._now_ns = lib.lsm6dsox_chip_next_event(self.inertial)
            assert self._now_ns <= deadline_ns, "no data-ready within 20 ms"
            self.now_us = self._now_ns / 1000

    def hold(
        self,
        gyr: Triple = (0, 0, 0),
        acc: Triple = (0, 0, G),
        mag: Triple = (0, 20, -40),
    ) -> None:
        lib.lsm6dsox_chip_hold(self.inertial, gyr, acc, mag)
        lib.lis3mdl_chip_hold(self.magnetic, gyr, acc, mag)

    def fault(self, wire: int, kind: int, **fields: Any) -> None:
        """Of the chip whose number on the wire that is."""
        fault = ffi.new("struct chip_fault *", {"kind": kind, **fields})
        assert lib.i2c_slave_add_fault(self.bus.slaves[wire], fault)

    def mend(self) -> None:
        for slave in self.bus.slaves:
            lib.i2c_slave_clear_faults(slave)

    @property
    def complaints(self) -> list[str]:
        texts = (
            lib.lsm6dsox_chip_complaint(self.inertial),
            lib.lis3mdl_chip_complaint(self.magnetic),
        )
        return [ffi.string(text).decode() for text in texts if text != ffi.NULL]
