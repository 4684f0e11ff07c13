# SPDX-License-Identifier: MIT
"""The AK8963 in the model of the MPU-9250, through the bypass, against its data sheet.

Numbers are typed from the data sheet (AK) and PS-MPU-9250A-01 (PS), not taken from the
model.
"""

from __future__ import annotations

import pytest

from sim.chips.mpu9250_desk import AK, Chip, lib, recorder
from sim.chips.sensor_desk import MS


def test_the_ak8963_is_behind_the_bypass_only(chip: Chip) -> None:
    assert chip.try_read(0x00, address=AK) == -1
    chip.bypass()
    assert chip.read(0x00, address=AK) == [0x48]
    chip.write(106, 0x20)  # the chip's own I2C master takes the bus
    assert chip.try_read(0x00, address=AK) == -1


def test_asa_is_in_the_fuse_rom(chip: Chip) -> None:
    chip.bypass()
    chip.ak_mode(0x0F)
    assert chip.read(0x10, 3, address=AK) == [176, 178, 166]
    assert chip.read(0x10, 4, address=AK) == [176, 178, 166, 176]  # AK 7.2.3: it wraps


def test_asa_outside_fuse_rom_mode_is_a_complaint() -> None:
    chip = Chip()
    chip.bypass()
    assert chip.read(0x10, address=AK) == [0]
    assert chip.complaint() is not None


def field(chip: Chip) -> list[float]:
    """The field by the data sheet's formula, in uT and in the MPU's axes."""
    data = bytes(chip.read(0x03, 7, address=AK))
    own = [
        int.from_bytes(data[2 * i : 2 * i + 2], "little", signed=True)
        * ((asa - 128) * 0.5 / 128 + 1)
        * 0.15
        for i, asa in enumerate((176, 178, 166))
    ]
    return [own[1], own[0], -own[2]]  # PS 9.1


def test_the_true_field_comes_out_of_the_formula(chip: Chip) -> None:
    true = (30.0, -12.5, 47.0)
    chip.hold(mag=true)
    chip.bypass()
    chip.ak_mode(0x16)
    chip.wait(8)
    # Rounding is half a count; the adjustment multiplies it by up to 1.2.
    assert field(chip) == pytest.approx(true, abs=0.6 * 0.15)


def test_the_continuous_mode_measures_at_100_hz(chip: Chip) -> None:
    chip.bypass()
    chip.ak_mode(0x16)
    chip.wait(7.1)
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(0.2)  # AK 5.3.1: a measurement takes 7.2 ms
    assert chip.read(0x02, 8, address=AK)[0] == 0x01
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(10.0 - 1.0)
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(1.0)
    assert chip.read(0x02, address=AK) == [0x01]


def test_skipped_data_set_dor_until_data_are_read(chip: Chip) -> None:
    chip.bypass()
    chip.ak_mode(0x16)
    chip.wait(30)
    assert chip.read(0x02, address=AK) == [0x03]
    chip.read(0x03, 7, address=AK)
    assert chip.read(0x02, address=AK) == [0x00]


def test_data_stay_until_st2_is_read(chip: Chip) -> None:
    chip.bypass()
    chip.ak_mode(0x16)
    chip.wait(8)
    chip.hold(mag=(100.0, 100.0, 100.0))
    low = chip.read(0x03, 1, address=AK)
    chip.wait(50)
    assert chip.read(0x03, 1, address=AK) == low
    chip.read(0x09, address=AK)
    chip.wait(10)
    assert chip.read(0x03, 1, address=AK) != low


def test_a_strong_field_overflows(chip: Chip) -> None:
    chip.bypass()
    chip.hold(mag=(1637.0, 1637.0, 1637.0))  # AK 6.4.3.6: overflow at a sum of 4912 uT
    chip.ak_mode(0x16)
    chip.wait(8)
    assert chip.read(0x09, address=AK) == [0x10]
    chip.hold(mag=(1638.0, 1637.0, 1638.0))
    chip.wait(10)
    assert chip.read(0x09, address=AK) == [0x18]
    chip.hold(mag=(0.0, 9000.0, 0.0))
    chip.wait(10)
    assert chip.read(0x03, 2, address=AK) == list((32760).to_bytes(2, "little"))


def test_the_ak8963_self_test_is_within_its_limits(chip: Chip) -> None:
    chip.bypass()
    chip.write(0x0A, 0x00, address=AK)
    chip.wait(1)
    chip.write(0x0C, 0x40, address=AK)
    chip.write(0x0A, 0x18, address=AK)
    chip.wait(8)
    x, y, z = (value / 0.15 for value in field(chip))
    assert -200 <= y <= 200  # AK 9.4.4, in its own axes
    assert -200 <= x <= 200
    assert -3200 <= -z <= -800


def test_a_mode_change_without_power_down_is_refused() -> None:
    chip = Chip()
    chip.bypass()
    chip.ak_mode(0x16)
    chip.write(0x0A, 0x0F, address=AK)
    assert chip.read(0x0A, address=AK) == [0x16]
    assert "power-down" in str(chip.complaint())


def test_a_mode_within_100_us_of_power_down_is_refused() -> None:
    chip = Chip()
    chip.bypass()
    chip.ak_mode(0x16)
    chip.write(0x0A, 0x00, address=AK)
    chip.write(0x0A, 0x16, address=AK)
    assert chip.read(0x0A, address=AK) == [0x00]
    assert "100 us" in str(chip.complaint())


def test_a_soft_reset_takes_the_ak8963_back(chip: Chip) -> None:
    chip.bypass()
    chip.ak_mode(0x16)
    chip.write(0x0B, 0x01, address=AK)
    assert chip.read(0x0A, address=AK) == [0x00]
    chip.wait(50)
    assert chip.read(0x02, address=AK) == [0x00]


def test_the_field_is_that_of_the_middle_of_the_measurement() -> None:
    motion, asked = recorder(lib.CHIP_MAG)
    chip = Chip(motion=motion)
    chip.bypass()
    chip.ak_mode(0x16)
    started = chip.now[0]
    chip.wait(20)
    start, end = asked[0]
    assert start == end
    assert end == pytest.approx(started + 3.6 * MS, abs=30_000)
    assert asked[1][0] - asked[0][0] == 10 * MS
