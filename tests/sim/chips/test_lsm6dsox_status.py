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
    INT1,
    INT2,
    PLACES,
    Chip,
    every_sensor,
)
from sim.chips.sensor_desk import MS


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


@pytest.mark.parametrize(("pin", "reg"), [(INT1, 0x0D), (INT2, 0x0E)])
@every_sensor
def test_data_ready_is_high_from_the_sample_until_it_is_read(
    chip: Chip, quantity: int, pin: int, reg: int
) -> None:
    out, bit, rate = PLACES[quantity]
    chip.write(reg, bit)
    chip.write(rate, 0x50)
    assert not chip.is_high(pin)
    chip.sample(quantity)
    assert chip.is_high(pin)
    assert not chip.is_high(INT1 + INT2 - pin)
    chip.sample(quantity)
    assert chip.is_high(pin)
    chip.get(IMU, out, 1)
    assert chip.is_high(pin)
    chip.get(IMU, out, 2)
    assert not chip.is_high(pin)


def test_pins_can_be_active_low(chip: Chip) -> None:
    chip.write(0x12, 0x24)  # DS CTRL3_C: H_LACTIVE
    assert chip.is_high(INT1)
    assert chip.is_high(INT2)
    chip.write(0x0D, 0x01)
    chip.write(0x10, 0x50)
    chip.sample(ACC)
    assert not chip.is_high(INT1)
    assert chip.is_high(INT2)


def test_int2_can_be_on_int1(chip: Chip) -> None:
    chip.write(0x0E, 0x05)  # temperature and accelerometer
    chip.write(0x13, 0x20)  # DS CTRL4_C: INT2_on_INT1
    chip.write(0x10, 0x30)
    chip.wait(100)
    assert chip.is_high(INT1)
    assert not chip.is_high(INT2)
    chip.counts(ACC)
    assert chip.is_high(INT1)
    chip.get(IMU, 0x20, 2)
    assert not chip.is_high(INT1)


def test_data_ready_can_be_a_pulse_of_75_us_while_the_flag_stays(chip: Chip) -> None:
    chip.write(0x0B, 0x80)  # DS COUNTER_BDR_REG1: dataready_pulsed
    chip.run(ACC)
    start = chip.sample(ACC)
    assert chip.is_high(INT1)
    assert chip.next_event() == start + 75_000
    chip.advance(chip.next_event())
    assert not chip.is_high(INT1)
    assert chip.has_new(ACC)
    chip.sample(ACC)
    assert chip.is_high(INT1)


@every_sensor
def test_drdy_mask_keeps_the_signal_until_the_filter_has_settled(quantity: int) -> None:
    chip = Chip(gyr_turn_on_ns=70 * MS)
    chip.write(0x13, 0x08)  # DS CTRL4_C: DRDY_MASK
    chip.run(quantity)
    seen = 0
    while not chip.is_high(INT1):
        chip.sample(quantity)
        seen += 1
    # AN tables 13, 14 and 15 at 208 Hz: the samples to discard pass unsignalled.
    turn_on = 14 if quantity == GYR else 0
    assert seen == turn_on + {GYR: 3, ACC: 1}[quantity] + 1
    assert chip.complaint() is None


def test_edges_follow_the_rate_where_each_sample_is_read(chip: Chip) -> None:
    chip.run(GYR, code=6)
    rises = []
    for _ in range(417):
        assert not chip.is_high(INT1)
        rises.append(chip.sample(GYR))
        assert chip.is_high(INT1)
        assert chip.get(IMU, 0x1E, 16)[0] & 0x02 == 0x02
    steps = {b - a for a, b in itertools.pairwise(rises)}
    assert max(steps) - min(steps) <= 1
    assert min(steps) == int(1e9 / HZ[5])
