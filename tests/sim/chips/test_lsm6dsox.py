# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX against the manufacturer's documents: registers
and resets. Self-tests are in test_lsm6dsv16x.py.

Numbers are typed from the data sheet of the LSM6DSO32, DocID032891 rev 1 (DS; registers
by their names there), and of the LSM6DSO, DS12140 rev 2 (SO), not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lsm6dsox_desk import ACC, GYR, IMU, Chip
from sim.chips.sensor_desk import MS


def test_if_inc_makes_the_address_move_on(chip: Chip) -> None:
    assert chip.get(IMU, 0x10, 4) == [0x00, 0x00, 0x04, 0x00]
    chip.write(0x10, 0x48, 0x5C)
    assert chip.get(IMU, 0x10, 2) == [0x48, 0x5C]
    chip.write(0x12, 0x00)
    assert chip.get(IMU, 0x10, 3) == [0x48, 0x48, 0x48]
    chip.write(0x10, 0x50, 0x60)  # both go to the same register
    assert (chip.read(0x10), chip.read(0x11)) == (0x60, 0x5C)


def test_a_sub_address_of_eight_bits_is_none() -> None:
    chip = Chip()
    assert chip.get(IMU, 0x8F) == [0x6C]
    assert "eight bits" in str(chip.complaint())


@pytest.mark.parametrize(
    ("reg", "value"),
    [
        (0x10, 0xC0),  # DS table 44: 11xx
        (0x11, 0xB0),  # DS table 48
        (0x14, 0x08),  # DS table 55: 10
        (0x14, 0x03),  # DS table 56: 11
        (0x02, 0x00),  # DS 9.2: must be 1
    ],
)
def test_values_that_the_data_sheet_forbids_complain(reg: int, value: int) -> None:
    chip = Chip()
    chip.write(reg, value)
    assert chip.complaint() is not None


def test_a_software_reset_takes_its_time_and_brings_reset_values(chip: Chip) -> None:
    before = chip.get(IMU, 0, 32)
    chip.run(GYR)
    chip.run(ACC)
    chip.wait(20)
    chip.counts(GYR)
    chip.counts(ACC)
    chip.write(0x0D, 0x00)
    samples = chip.samples(GYR)
    start = chip.now[0]
    chip.write(0x12, 0x05)
    assert chip.next_event() - start == pytest.approx(50_000 + 75_000, abs=10_000)
    chip.advance(chip.next_event() - 1)
    assert chip.peek(0x12) == 0x05
    chip.wait(0.1)
    assert chip.get(IMU, 0, 30) == before[:30]
    chip.wait(1000)
    assert chip.samples(GYR) == samples


def test_what_is_written_during_a_reset_is_lost() -> None:
    chip = Chip(reset_ns=1 * MS)
    chip.write(0x12, 0x05)
    chip.write(0x10, 0x50)
    assert "during a reset" in str(chip.complaint())
    chip.wait(2)
    assert chip.read(0x10) == 0x00


def test_a_reset_while_int1_is_high_leaves_i3c_alone() -> None:
    chip = Chip()
    chip.run(ACC)
    chip.sample(ACC)
    assert chip.is_high()
    chip.write(0x12, 0x05)
    assert "INT1" in str(chip.complaint())
    chip.wait(100)
    assert chip.try_get(IMU, 0x0F) == -1
    chip.call("power_cycle", chip.now[0])
    assert chip.read(0x0F) == 0x6C


def test_i3c_can_be_turned_off(chip: Chip) -> None:
    chip.write(0x18, 0xE2)  # DS CTRL9_XL: I3C_disable
    assert chip.read(0x18) == 0xE2


@pytest.mark.parametrize(
    ("ppm", "fine"), [(0, 0), (1500, 1), (-1500, 255), (10_000, 7), (-30_000, 236)]
)
def test_the_trim_of_the_clock_is_told_in_steps_of_0_15_percent(
    ppm: float, fine: int
) -> None:
    assert Chip(rate_error_ppm=ppm).read(0x63) == fine  # DS table 141
