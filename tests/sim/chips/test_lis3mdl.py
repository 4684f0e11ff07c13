# SPDX-License-Identifier: MIT
"""The model of the LIS3MDL against the manufacturer's documents. Its registers
and what it shares with other sensors of ST: test_st_registers.py, test_st_outputs.py.

Numbers are typed from the data sheet, DocID024204 rev 4 (DS), and from AN4602 (AN) as
others quote them, and from Adafruit's library (AD), not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lis3mdl_desk import FIELD, MAG, ON, Chip, lib, recorder
from sim.chips.sensor_desk import MS


def test_a_soft_reset_takes_its_time_and_brings_reset_values(chip: Chip) -> None:
    before = chip.get(MAG, ON | 0, 64)
    chip.run()
    chip.write(0x21, 0x24)
    assert chip.peek(0x21) == 0x24
    chip.wait(1)
    assert chip.get(MAG, ON | 0, 64) == before
    assert chip.next_event() == 2**64 - 1


@pytest.mark.parametrize(
    ("code", "hz"),
    list(enumerate([0.625, 1.25, 2.5, 5, 10, 20, 40, 80])),  # AD
)
def test_rates(chip: Chip, code: int, hz: float) -> None:
    chip.run(ctrl1=0x60 | code << 2)
    times = chip.times(FIELD, 5)
    assert times[-1] - times[0] == pytest.approx(4e9 / hz, abs=1)


@pytest.mark.parametrize("ctrl3", [0x02, 0x03])  # DS table 28: both are power-down
def test_power_down_stops_it(chip: Chip, ctrl3: int) -> None:
    chip.wait(1000)
    assert chip.samples() == 0  # as it is after power-up
    chip.run()
    chip.wait(100)
    chip.write(0x22, ctrl3)
    before = chip.samples()
    chip.wait(1000)
    assert chip.samples() == before


@pytest.mark.parametrize(
    ("fs", "per_gauss"),
    [(0, 6842), (1, 3421), (2, 2281), (3, 1711)],  # DS table 3
)
def test_counts_over_the_ranges(chip: Chip, fs: int, per_gauss: int) -> None:
    one = 100 / per_gauss  # uT
    chip.run(ctrl2=fs << 5)
    chip.hold(mag=(20_000 * one, -10_000.4 * one, 40_000 * one))
    chip.sample()
    assert chip.counts() == [20_000, -10_000, 32_767]
    chip.hold(mag=(-40_000 * one, 0.6 * one, 0.0))
    chip.sample()
    assert chip.counts() == [-32_768, 1, 0]


@pytest.mark.parametrize(("om", "hz"), [(0, 1000), (1, 560), (2, 300), (3, 155)])
def test_the_field_is_that_of_as_long_as_a_measurement_takes(
    om: int, hz: float
) -> None:
    motion, asked = recorder(lib.CHIP_MAG)
    chip = Chip(motion=motion)
    chip.run(ctrl1=om << 5 | 0x1C)
    now = chip.sample()
    assert asked == [(now - round(1e9 / hz), now)]


@pytest.mark.parametrize(
    ("celsius", "counts"), [(25.0, 0), (26.0, 8), (-40.0, -520), (85.0, 480)]
)
def test_temperature_in_eighths_of_a_degree(
    chip: Chip, celsius: float, counts: int
) -> None:
    chip.call("set_temperature", celsius)
    chip.run()
    chip.sample()
    assert chip.words(MAG, 0x2E, 1) == [counts]  # DS table 4; AN 6


def test_temperature_stands_without_its_enable_bit(chip: Chip) -> None:
    chip.call("set_temperature", 40.0)
    chip.run(ctrl1=0x7C)
    chip.sample()
    assert chip.words(MAG, 0x2E, 1) == [0]


def test_drdy_is_high_from_the_sample_until_all_is_read(chip: Chip) -> None:
    chip.run()
    assert not chip.is_high()
    chip.sample()
    assert chip.is_high()
    chip.get(MAG, ON | 0x28, 5)
    assert chip.is_high()
    chip.get(MAG, 0x2D)
    assert not chip.is_high()


def test_a_good_magnetometer_passes_its_self_test(chip: Chip) -> None:
    chip.run(ctrl1=0x1C, ctrl2=0x40)
    chip.sample()
    off = chip.counts()
    chip.write(0x20, 0x1D)
    chip.sample()
    on = chip.counts()
    x, y, z = [(b - a) / 2281 for a, b in zip(off, on, strict=True)]
    assert 1.0 <= x <= 3.0  # AN: at 12 gauss
    assert 1.0 <= y <= 3.0
    assert 0.1 <= z <= 1.0


def test_a_magnetometer_that_dies_answers_no_more(chip: Chip) -> None:
    chip.run()
    chip.fault("NO_MAG", from_ns=100 * MS, for_ns=100 * MS)
    assert chip.try_get(MAG, 0x0F) == 0
    chip.wait(100)
    assert chip.try_get(MAG, 0x0F) == -1
    chip.wait(100)
    assert chip.try_get(MAG, 0x0F) == 0
