# SPDX-License-Identifier: MIT
"""The registers of the models of ST's sensors against the manufacturer's documents.

Numbers are typed from the data sheets (DS) of the LSM9DS0, DocID024763 rev 2, of the
LSM6DSO32, DocID032891 rev 1, and of the LIS3MDL, DocID024204 rev 4, as others quote it,
not taken from the models. Registers have their names there. Those of the LSM6DSV16X are
from ST's driver of the LSM6DSV, lsm6dsv_reg.h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from sim.chips import lis3mdl_desk, lsm6dsox_desk, lsm6dsv16x_desk, lsm9ds0_desk
from sim.chips.sensor_desk import SensorDesk


@dataclass(frozen=True)
class Die:
    """What the documents say about a die's registers."""

    desk: Any
    address: int
    addresses: dict[int, dict[str, bool]]  # by the levels of its pins
    reset: dict[int, int]  # others are 0
    writable: set[int]
    reserved: list[tuple[int, int, int]]  # register, written, kept
    unmodelled: list[tuple[int, int]]
    on: int = 0x80  # of the sub-address: moves on with each byte

    def chip(self, **config: Any) -> SensorDesk:
        made: SensorDesk = self.desk.Chip(**config)
        return made

    def startup_ns(self) -> int:
        defaults = getattr(self.desk.lib, f"{self.chip().name}_chip_defaults")()
        return int(defaults.sensor.startup_ns)


G = Die(
    lsm9ds0_desk,
    0x6B,
    {0x6A: {"sa0_g": False}, 0x6B: {"sa0_g": True}},  # DS 6.1: 110101x
    # WHO_AM_I_G, CTRL_REG1_G; DS 4.3: in bypass mode the FIFO remains empty
    {0x0F: 0xD4, 0x20: 0x07, 0x2F: 0x20},
    {*range(0x20, 0x25)},
    # CTRL_REG2_G: bits that must not be changed
    [(0x21, 0x40, 0x00), (0x23, 0x08, 0x00), (0x24, 0x20, 0x00)],
    [
        (0x22, 0x80),  # interrupts on INT_G
        (0x22, 0x04),  # FIFO watermark on DRDY_G
        (0x23, 0x01),  # 3-wire SPI
        (0x24, 0x40),  # FIFO
        (0x24, 0x10),  # high-pass filter
        (0x24, 0x01),  # high-pass filtered data
        (0x23, 0x40),  # big-endian
        (0x2E, 0x40),  # stream mode
    ],
)
XM = Die(
    lsm9ds0_desk,
    0x1D,
    {0x1E: {"sa0_xm": False}, 0x1D: {"sa0_xm": True}},  # DS 6.1: 0011110 or 0011101
    # WHO_AM_I_XM, INT_CTRL_REG_M, CTRL_REG1_XM, M_ODR 110, 4 gauss, power-down
    G.reset | {0x0F: 0x49, 0x12: 0xE8, 0x20: 0x07, 0x24: 0x18, 0x25: 0x20, 0x26: 0x02},
    {0x12, *range(0x1F, 0x27)},
    [
        (0x1F, 0x08, 0x00),
        (0x25, 0x21, 0x20),
        (0x25, 0xA0, 0x20),
        (0x26, 0x0A, 0x02),
        (0x26, 0x12, 0x02),
    ],
    [
        (0x12, 0xE9),  # magnetic interrupt
        (0x16, 0x01),  # magnetic offset
        (0x1F, 0x40),
        (0x22, 0x20),
        (0x23, 0x01),
        (0x26, 0x22),  # AFDS: filtered acceleration
        (0x26, 0x06),  # low power
        (0x26, 0x01),  # a single measurement
        (0x30, 0x01),  # interrupt generators, clicks
        (0x38, 0x01),
    ],
)
LSM6DSOX = Die(
    lsm6dsox_desk,
    0x6A,
    {0x6A: {"sa0": False}, 0x6B: {"sa0": True}},  # DS 5.1.1
    {0x02: 0x3F, 0x0F: 0x6C, 0x12: 0x04, 0x18: 0xE0},  # CTRL3_C: IF_INC
    {0x0B, 0x0D, 0x0E, *range(0x10, 0x1A)},
    [
        (0x0B, 0x08, 0x00),  # DS: bits that must be set to 0
        (0x10, 0x41, 0x40),
        (0x11, 0x41, 0x40),
        (0x12, 0x06, 0x04),
        (0x13, 0x81, 0x00),
        (0x16, 0x08, 0x00),
        (0x18, 0xE1, 0xE0),
    ],
    [
        (0x01, 0x40),  # sensor hub
        (0x09, 0x55),  # FIFO
        (0x0D, 0x08),
        (0x0E, 0x01),  # INT2
        (0x10, 0x02),  # LPF2 of the accelerometer
        (0x12, 0x84),  # reboot
        (0x13, 0x02),  # LPF1 of the gyroscope
        (0x13, 0x40),  # sleep
        (0x15, 0x10),  # low power
        (0x12, 0x0C),  # 3-wire SPI
        (0x14, 0x60),  # circular bursts
        (0x14, 0x80),  # ultra-low power
        (0x15, 0x80),  # DEN
        (0x16, 0x40),  # high-pass
        (0x17, 0x04),
        (0x19, 0x20),  # timestamps
        (0x58, 0x80),  # events
        (0x73, 0x01),  # user offsets
    ],
    on=0,
)
LSM6DSV16X = Die(
    lsm6dsv16x_desk,
    0x6A,
    {0x6A: {"sa0": False}, 0x6B: {"sa0": True}},
    {0x0F: 0x70, 0x12: 0x04},
    {0x0B, 0x0D, 0x0E, *range(0x10, 0x1A), 0x62},
    [
        (0x0D, 0x04, 0x00),
        (0x11, 0x80, 0x00),
        (0x12, 0x24, 0x04),
        (0x17, 0x04, 0x00),
        (0x62, 0x04, 0x00),
    ],
    [
        (0x03, 0x01),  # neither I2C nor I3C
        (0x10, 0x47),  # low power
        (0x12, 0x84),  # reboot
        (0x13, 0x08),  # DRDY_MASK
        (0x16, 0x01),  # LPF1 of the gyroscope
        (0x17, 0x08),  # the second channel
        (0x18, 0x08),  # LPF2 of the accelerometer
    ],
    on=0,
)
LIS3MDL = Die(
    lis3mdl_desk,
    0x1C,
    {0x1C: {"sa1": False}, 0x1E: {"sa1": True}},
    # WHO_AM_I (Adafruit's library), CTRL_REG1, CTRL_REG3: power-down, INT_CFG
    {0x0F: 0x3D, 0x20: 0x10, 0x22: 0x03, 0x30: 0xE8},
    {*range(0x20, 0x25)},
    [
        (0x21, 0x61, 0x60),
        (0x21, 0x80, 0x00),
        (0x22, 0x13, 0x03),
        (0x23, 0x1C, 0x0C),
        (0x24, 0x41, 0x40),
    ],
    [
        (0x05, 0x01),  # offset registers
        (0x20, 0x12),  # FAST_ODR
        (0x21, 0x08),  # reboot
        (0x22, 0x07),  # SPI
        (0x22, 0x23),  # low power
        (0x22, 0x01),  # a single measurement
        (0x23, 0x02),  # big-endian
        (0x24, 0x80),
        (0x30, 0xE9),
    ],
)
DIES = {"G": G, "XM": XM, "LSM6DSOX": LSM6DSOX}
DIES |= {"LSM6DSV16X": LSM6DSV16X, "LIS3MDL": LIS3MDL}
every_die = pytest.mark.parametrize("die", DIES.values(), ids=DIES)


@every_die
def test_reset_values_are_those_of_the_register_map(die: Die) -> None:
    expected = [die.reset.get(reg, 0) for reg in range(128)]
    assert die.chip().get(die.address, die.on | 0, 128) == expected


@every_die
def test_its_pin_chooses_the_address(die: Die) -> None:
    for address, levels in die.addresses.items():
        chip = die.chip(**levels)
        answering = [a for a in range(128) if chip.try_get(a, 0x0F) == 0]
        assert [a for a in answering if a in die.addresses] == [address]
        assert chip.get(address, 0x0F) == [die.reset[0x0F]]


@every_die
def test_nothing_answers_until_the_boot_procedure_is_over(die: Die) -> None:
    chip = die.chip(startup_ns=die.startup_ns())
    assert chip.try_get(die.address, 0x0F) == -1
    chip.wait(10)  # AN4505: about 10 ms
    assert chip.get(die.address, 0x0F) == [die.reset[0x0F]]


@pytest.mark.parametrize("die", [G, XM, LIS3MDL], ids=["G", "XM", "LIS3MDL"])
def test_bit_7_of_the_sub_address_makes_it_move_on(die: Die) -> None:
    chip = die.chip()
    first = die.reset[0x20]
    assert chip.get(die.address, 0x20, 3) == [first] * 3  # DS 6.1, DS 5.1.1
    after = [die.reset.get(reg, 0) for reg in (0x20, 0x21, 0x22)]
    assert chip.get(die.address, die.on | 0x20, 3) == after
    chip.put(die.address, die.on | 0x20, 0x04, 0x00)
    assert chip.get(die.address, die.on | 0x20, 2) == [0x04, 0x00]
    chip.put(die.address, 0x20, 0x00, 0x05)  # without ON both go to the same register
    assert chip.get(die.address, die.on | 0x20, 2) == [0x05, 0x00]
    assert chip.complaint() is None


@every_die
def test_reserved_and_read_only_registers_stay_and_complain(die: Die) -> None:
    for reg in range(128):
        chip = die.chip()
        before = chip.get(die.address, reg)
        chip.put(die.address, reg, *before)
        assert (chip.complaint() is not None) is (reg not in die.writable), hex(reg)
        assert chip.get(die.address, reg) == before


@every_die
def test_reserved_bits_stay_and_complain(die: Die) -> None:
    for reg, value, kept in die.reserved:
        chip = die.chip()
        chip.put(die.address, reg, value)
        assert "reserved" in str(chip.complaint()), hex(reg)
        assert chip.get(die.address, reg) == [kept]


@every_die
def test_what_is_not_modelled_complains(die: Die) -> None:
    for reg, value in die.unmodelled:
        chip = die.chip()
        chip.put(die.address, reg, value)
        assert "not modelled" in str(chip.complaint()), hex(reg)
