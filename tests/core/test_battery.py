# SPDX-License-Identifier: MIT
"""The battery's claims, from readings a tenth of a second apart."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native

ffi, lib = native.load()

UNKNOWN = lib.BATTERY_UNKNOWN
LOW, EXTERNAL, CHARGING = lib.POWER_LOW, lib.POWER_EXTERNAL, lib.POWER_CHARGING
Reading = tuple[int, bool, bool]


class Battery:
    def __init__(self) -> None:
        self.state = ffi.new("struct battery *")
        lib.battery_init(self.state)
        self.low_at: list[int] = []  # the readings, from 1, at which it got low
        self.count = 0

    def take(
        self,
        mv: int,
        seconds: float = 0.1,
        *,
        supply: bool = False,
        charge: bool = False,
    ) -> Battery:
        for _ in range(round(seconds * 10)):
            self.feed([(mv, supply, charge)])
        return self

    def feed(self, readings: Iterable[Reading]) -> Battery:
        for mv, supply, charge in readings:
            reading = ffi.new("struct battery_reading *", (mv, supply, charge))
            self.count += 1
            if lib.battery_step(self.state, reading):
                self.low_at.append(self.count)
        return self

    @property
    def power(self) -> int:
        return int(lib.battery_power(self.state))


def test_nothing_is_known_before_a_reading():
    battery = Battery()
    assert (battery.state.mv, battery.power) == (UNKNOWN, 0)


@pytest.mark.parametrize("mv", [0, 1999, 4601, 6600, UNKNOWN])
def test_what_no_cell_brings_is_not_known_and_never_low(mv):
    battery = Battery().take(mv, 60)
    assert (battery.state.mv, battery.power, battery.low_at) == (UNKNOWN, 0, [])


@pytest.mark.parametrize("mv", [2000, 3299, 3300, 4600])
def test_the_first_reading_counts_at_once_and_a_steady_one_stays(mv):
    battery = Battery().take(mv)
    assert battery.state.mv == mv
    assert battery.take(mv, 60).state.mv == mv


def test_a_step_is_smoothed_over_some_seconds():
    battery = Battery().take(4200).take(3400, 1.6)
    assert 3650 < battery.state.mv < 3750
    assert abs(battery.take(3400, 20).state.mv - 3400) <= 1


def test_low_is_told_once_after_ten_seconds():
    battery = Battery().take(3299, 9.9)
    assert (battery.low_at, battery.power) == ([], 0)
    battery.take(3299, 120)
    assert (battery.low_at, battery.power) == ([100], LOW)


def test_at_the_bound_it_is_not_low():
    assert Battery().take(3300, 60).low_at == []


def test_a_dip_under_load_is_not_empty():
    battery = Battery()
    for _ in range(20):
        battery.take(3100, 6).take(3700, 6)
    assert battery.low_at == []


def test_low_lasts_between_the_bounds_and_ends_above():
    battery = Battery().take(3250, 11)
    assert battery.take(3500, 60).power == LOW
    assert battery.take(3510, 20).power == 0
    assert battery.take(3250, 60).power == LOW
    assert len(battery.low_at) == 2


def test_external_power_ends_low_and_keeps_it_away():
    battery = Battery().take(3250, 11).take(3250, 60, supply=True)
    assert battery.power == EXTERNAL
    battery.take(3250, 10.1)
    assert battery.power == 0
    battery.take(3250, 0.2)
    assert battery.power == LOW
    assert len(battery.low_at) == 2


def test_a_divider_that_comes_off_ends_low():
    battery = Battery().take(3250, 11).take(UNKNOWN)
    assert battery.power == 0
    assert battery.take(3250, 9.9).power == 0
    assert battery.take(3250).power == LOW


def test_a_plug_that_bounces_counts_once_it_is_steady():
    battery = Battery().take(3800)
    battery.feed([(3800, supply, False) for supply in (True, False, True, True)])
    assert battery.power == 0
    assert battery.take(3800, supply=True).power == EXTERNAL
    assert battery.take(3800, 0.2).power == EXTERNAL
    assert battery.take(3800).power == 0


def test_charging_is_a_steady_pin_and_external_power():
    battery = Battery().take(3800, 10, charge=True)
    assert battery.power == 0
    battery.take(3800, 1, supply=True, charge=True)
    assert battery.power == EXTERNAL | CHARGING
    assert battery.take(3800, supply=True).power == EXTERNAL


def test_the_blinking_of_a_charge_that_takes_too_long_is_not_charging():
    battery = Battery().take(3800, 1, supply=True)
    quarter = [(3800, True, True)] * 3 + [(3800, True, False)] * 2
    for reading in quarter * 40:
        assert battery.feed([reading]).power == EXTERNAL


@given(
    st.lists(
        st.tuples(st.integers(0, UNKNOWN), st.booleans(), st.booleans()), max_size=300
    )
)
def test_whatever_is_read_it_is_low_only_on_a_known_battery_without_a_supply(readings):
    battery = Battery()
    for reading in readings:
        battery.feed([reading])
        mv, power = battery.state.mv, battery.power
        assert mv == UNKNOWN or 2000 <= mv <= 4600
        assert not power & LOW or (mv <= 3500 and not power & EXTERNAL)
        assert power & EXTERNAL or not power & CHARGING
