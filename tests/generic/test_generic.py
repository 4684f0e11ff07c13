# SPDX-License-Identifier: MIT
"""Shared by boards: the order of freeing a bus, and slots between interrupts and main
loop."""

from __future__ import annotations

from typing import Any

import pytest

import native

ffi, lib = native.load()


def recover(sda_clocks: int = 0, scl_waits: int = 0) -> int:
    for name in ("clocks", "half_clocks", "stops"):
        setattr(lib.lines, name, 0)
    lib.lines.pulled = 0
    lib.lines.sda_clocks, lib.lines.scl_waits = sda_clocks, scl_waits
    return int(lib.bus_recovery_run())


def test_a_free_bus_gets_a_stop_and_no_clock_before_it() -> None:
    assert recover() == lib.BUS_OK
    assert (lib.lines.clocks, lib.lines.stops) == (1, 1)


@pytest.mark.parametrize("clocks", range(1, 10))
def test_a_device_is_clocked_to_the_end_of_its_byte(clocks: int) -> None:
    assert recover(clocks) == lib.BUS_OK
    assert (lib.lines.clocks, lib.lines.stops) == (clocks + 1, 1)


def test_a_line_that_is_never_let_go_is_told() -> None:
    assert recover(sda_clocks=-1) == lib.BUS_STUCK
    assert lib.lines.half_clocks <= 30
    assert recover(scl_waits=-1) == lib.BUS_STUCK
    assert lib.lines.half_clocks <= 60


@pytest.mark.parametrize(("waits", "result"), [(1, 0), (51, 0), (52, -3)])
def test_a_clock_may_be_held_for_a_while(waits: int, result: int) -> None:
    assert recover(scl_waits=waits) == result


COUNT = 2


class Slots:
    def __init__(self) -> None:
        self.c = ffi.new("struct slots *")
        self.readings = ffi.new("struct reading[]", COUNT)
        self.out = ffi.new("struct reading *")

    def fill(self, time_us: int) -> None:
        assert not lib.slots_are_full(self.c, COUNT)
        lib.slots_stamp(self.c, self.slot, time_us)
        self.c.filled = (self.c.filled + 1) % 256

    @property
    def slot(self) -> Any:
        return ffi.addressof(self.readings[self.c.filled % COUNT])

    def take(self) -> tuple[int, int] | None:
        found = lib.slots_take(self.c, self.readings, COUNT, self.out)
        return (self.out.time_us, self.out.missed) if found else None


def test_readings_come_in_order_also_past_256() -> None:
    slots = Slots()
    for time_us in range(0, 600, 2):
        slots.fill(time_us)
        slots.fill(time_us + 1)
        assert lib.slots_are_full(slots.c, COUNT)
        assert [slots.take(), slots.take()] == [(time_us, 0), (time_us + 1, 0)]
        assert slots.take() is None


def test_what_was_missed_goes_with_the_next_reading_and_never_overflows() -> None:
    slots = Slots()
    lib.slots_miss_one(slots.c)
    lib.slots_miss(slots.c, 2)
    slots.fill(1)
    lib.slots_miss(slots.c, 65000)
    lib.slots_miss(slots.c, 65000)
    lib.slots_miss_one(slots.c)
    slots.fill(2)
    assert [slots.take(), slots.take()] == [(1, 3), (2, 65535)]


def test_a_failure_is_told_once_and_after_the_readings_before_it() -> None:
    slots = Slots()
    slots.fill(1)
    slots.c.is_running, slots.c.failure = True, lib.BUS_NACK
    assert lib.slots_failure(slots.c) == lib.READING_NONE
    slots.take()
    assert lib.slots_failure(slots.c) == lib.READING_NACK
    assert lib.slots_failure(slots.c) == lib.READING_NONE


def test_a_restart_counts_what_nobody_will_take() -> None:
    slots = Slots()
    slots.fill(1)
    lib.slots_restart(slots.c, 4)
    assert slots.take() is None
    assert not slots.c.is_running
    slots.fill(2)
    assert slots.take() == (2, 5)
