# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX against the manufacturer's documents: status, block data
update (BDU), data-ready.

Numbers are typed from the data sheet of the LSM6DSO32, DocID032891 rev 1 (DS; registers
by their names there), and from AN5040 (AN), not taken from the model.
"""

from __future__ import annotations

import itertools

import pytest

from sim.chips.lsm6dsox_desk import (
    ACC,
    GYR,
    HZ,
    IMU,
    PLACES,
    Chip,
    every_sensor,
)


@every_sensor
def test_a_sample_sets_its_flag_and_any_high_byte_clears_it(
    chip: Chip, quantity: int
) -> None:
    out = PLACES[quantity][0]
    chip.run(quantity, bdu=False)
    for high in (1, 3, 5):  # AN 4.3: 23h, 25h, 27h; 29h, 2Bh, 2Dh
        chip.sample(quantity)
        for low in (0, 2, 4):
            chip.get(IMU, out + low)
        assert chip.has_new(quantity)
        chip.get(IMU, out + high)
        assert not chip.has_new(quantity)


def test_temperature_has_a_flag_too(chip: Chip) -> None:
    chip.run(ACC, code=3)
    chip.wait(50)
    assert chip.read(0x1E) & 0x04 == 0x04
    chip.get(IMU, 0x20, 2)
    assert chip.read(0x1E) & 0x04 == 0x00


def test_temperature_comes_52_times_a_second(chip: Chip) -> None:
    chip.run(ACC, code=6)
    seen = 0
    for _ in range(417):
        chip.sample(ACC)
        seen += chip.read(0x1E) >> 2 & 1
        chip.get(IMU, 0x20, 2)
    assert seen == pytest.approx(52, abs=1)  # DS table 5


@every_sensor
def test_data_ready_is_high_from_the_sample_until_it_is_read(
    chip: Chip, quantity: int
) -> None:
    out, bit, rate = PLACES[quantity]
    chip.write(0x0D, bit)
    chip.write(rate, 0x50)
    assert not chip.is_high()
    chip.sample(quantity)
    assert chip.is_high()
    chip.sample(quantity)
    assert chip.is_high()
    chip.get(IMU, out, 1)
    assert chip.is_high()
    chip.get(IMU, out, 2)
    assert not chip.is_high()


def test_data_ready_can_be_a_pulse_of_75_us_while_the_flag_stays(chip: Chip) -> None:
    chip.write(0x0B, 0x80)  # DS COUNTER_BDR_REG1: dataready_pulsed
    chip.run(ACC)
    start = chip.sample(ACC)
    assert chip.is_high()
    assert chip.next_event() == start + 75_000
    chip.advance(chip.next_event())
    assert not chip.is_high()
    assert chip.has_new(ACC)
    chip.sample(ACC)
    assert chip.is_high()


def test_edges_follow_the_rate_where_each_sample_is_read(chip: Chip) -> None:
    chip.run(GYR, code=6)
    rises = []
    for _ in range(417):
        assert not chip.is_high()
        rises.append(chip.sample(GYR))
        assert chip.is_high()
        assert chip.get(IMU, 0x1E, 16)[0] & 0x02 == 0x02
    steps = {b - a for a, b in itertools.pairwise(rises)}
    assert max(steps) - min(steps) <= 1
    assert min(steps) == int(1e9 / HZ[5])
