# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX against the manufacturer's documents: registers, resets.

Numbers are typed from the data sheet of the LSM6DSO32, DocID032891 rev 1 (DS; registers
by their names there), not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lsm6dsox_desk import ACC, GYR, IMU, INT1, Chip, lib
from sim.chips.sensor_desk import MS


def test_reset_values_are_those_of_the_register_map(chip: Chip) -> None:
    expected = [0] * 128
    expected[0x02] = 0x3F  # DS PIN_CTRL
    expected[0x0F] = 0x6C  # DS WHO_AM_I
    expected[0x12] = 0x04  # DS CTRL3_C: IF_INC
    expected[0x18] = 0xE0  # DS CTRL9_XL
    assert chip.get(IMU, 0, 128) == expected


def test_an_ism330dhcx_has_its_own_name() -> None:
    assert Chip(kind="ism330dhcx").read(0x0F) == 0x6B


@pytest.mark.parametrize(("sa0", "address"), [(False, 0x6A), (True, 0x6B)])  # DS 5.1.1
def test_the_sa0_pin_chooses_the_address(sa0: bool, address: int) -> None:
    chip = Chip(sa0=sa0)
    assert [a for a in range(128) if chip.try_get(a, 0x0F) == 0] == [address]


def test_nothing_answers_until_the_boot_procedure_is_over() -> None:
    chip = Chip(startup_ns=lib.lsm6dsox_chip_defaults().startup_ns)
    assert chip.try_get(IMU, 0x0F) == -1
    chip.wait(10)
    assert chip.read(0x0F) == 0x6C


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


WRITABLE = {0x01, 0x02, *range(0x07, 0x0F), *range(0x10, 0x1A), *range(0x56, 0x60)}
WRITABLE |= {0x62, 0x73, 0x74, 0x75}


def test_reserved_and_read_only_registers_stay_and_complain() -> None:
    for reg in range(128):
        chip = Chip()
        before = chip.read(reg)
        chip.write(reg, before)
        assert (chip.complaint() is not None) is (reg not in WRITABLE), hex(reg)
        assert chip.read(reg) == before


@pytest.mark.parametrize(
    ("reg", "value", "kept"),
    [
        (0x01, 0x01, 0x00),  # DS: bits that must be set to 0
        (0x08, 0x20, 0x00),
        (0x0B, 0x08, 0x00),
        (0x0E, 0x80, 0x00),
        (0x10, 0x41, 0x40),
        (0x11, 0x41, 0x40),
        (0x12, 0x06, 0x04),
        (0x13, 0x81, 0x00),
        (0x16, 0x08, 0x00),
        (0x18, 0xE1, 0xE0),
        (0x19, 0x01, 0x00),
        (0x62, 0x06, 0x00),
    ],
)
def test_reserved_bits_stay_and_complain(reg: int, value: int, kept: int) -> None:
    chip = Chip()
    chip.write(reg, value)
    assert "reserved" in str(chip.complaint())
    assert chip.read(reg) == kept


@pytest.mark.parametrize(
    ("reg", "value"),
    [
        (0x01, 0x40),  # sensor hub
        (0x09, 0x55),  # FIFO
        (0x0A, 0x06),
        (0x0D, 0x08),
        (0x12, 0x0C),  # 3-wire SPI
        (0x14, 0x60),  # circular bursts
        (0x14, 0x80),  # ultra-low power
        (0x15, 0x80),  # DEN
        (0x16, 0x40),  # high-pass
        (0x17, 0x04),
        (0x19, 0x20),  # timestamps
        (0x58, 0x80),  # events
        (0x5E, 0x20),
    ],
)
def test_what_is_not_modelled_complains(reg: int, value: int) -> None:
    chip = Chip()
    chip.write(reg, value)
    assert "not modelled" in str(chip.complaint())


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


def test_bit_0_of_ctrl2_g_is_4000_dps_of_an_ism330dhcx_alone() -> None:
    chip = Chip(kind="ism330dhcx")
    chip.write(0x11, 0x51)
    assert chip.read(0x11) == 0x51
    assert chip.complaint() is None


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
    assert chip.call("peek", 0x12) == 0x05
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
    assert chip.is_high(INT1)
    chip.write(0x12, 0x05)
    assert "INT1" in str(chip.complaint())
    chip.wait(100)
    assert chip.try_get(IMU, 0x0F) == -1
    chip.call("power_cycle", chip.now[0])
    assert chip.read(0x0F) == 0x6C


def test_a_reboot_clears_its_bit_and_keeps_the_registers(chip: Chip) -> None:
    chip.run(ACC)
    chip.write(0x0D, 0x04)  # DS INT1_CTRL: INT1_BOOT
    assert not chip.is_high(INT1)
    chip.write(0x12, 0xC4)
    before = chip.samples(ACC)
    assert chip.is_high(INT1)
    chip.wait(9)
    assert chip.read(0x12) == 0xC4
    assert chip.samples(ACC) == before
    chip.wait(2)
    assert (chip.read(0x12), chip.read(0x10)) == (0x44, 0x50)
    assert not chip.is_high(INT1)
    chip.wait(20)
    assert chip.samples(ACC) > before


def test_i2c_can_be_turned_off() -> None:
    chip = Chip()
    chip.write(0x13, 0x04)  # DS CTRL4_C: I2C_disable
    assert chip.try_get(IMU, 0x0F) == -1
    assert "I2C" in str(chip.complaint())


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
