# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 against the manufacturer's documents: registers.

Numbers are typed from the data sheet, DocID024763 rev 2 (DS; registers by their names
there) and from AN4505, not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lsm9ds0_desk import ACC, GYR, INT1, ON, XM, Chip, G, lib
from sim.chips.sensor_desk import MS


def test_reset_values_are_those_of_the_register_map(chip: Chip) -> None:
    expected = [0] * 128
    expected[0x0F] = 0xD4  # DS WHO_AM_I_G
    expected[0x20] = 0x07  # DS CTRL_REG1_G
    expected[0x2F] = 0x20  # DS 4.3: in bypass mode the FIFO remains empty
    assert chip.get(G, ON | 0, 128) == expected
    expected[0x0F] = 0x49  # DS WHO_AM_I_XM
    expected[0x12] = 0xE8
    expected[0x20] = 0x07
    expected[0x24] = 0x18  # DS CTRL_REG5_XM: M_ODR 110
    expected[0x25] = 0x20  # DS CTRL_REG6_XM: 4 gauss
    expected[0x26] = 0x02  # DS CTRL_REG7_XM: power-down
    assert chip.get(XM, ON | 0, 128) == expected


def test_the_polarity_at_reset_can_be_the_other_one() -> None:
    chip = Chip(int_ctrl_reg_m=0x00)
    assert chip.get(XM, 0x12) == [0x00]
    assert chip.is_high(INT1)  # active low and not asserted


@pytest.mark.parametrize(
    ("config", "g", "xm"),
    # DS 6.1: 110101x and 0011110 or 0011101
    [((False, False), 0x6A, 0x1E), ((True, True), 0x6B, 0x1D)],
)
def test_the_sa0_pins_choose_the_addresses(
    config: tuple[bool, bool], g: int, xm: int
) -> None:
    chip = Chip(sa0_g=config[0], sa0_xm=config[1])
    answering = [a for a in range(128) if chip.try_get(a, 0x0F) == 0]
    assert answering == sorted([g, xm])
    assert chip.get(g, 0x0F) == [0xD4]
    assert chip.get(xm, 0x0F) == [0x49]


def test_nothing_answers_until_the_boot_procedure_is_over() -> None:
    chip = Chip(startup_ns=lib.lsm9ds0_chip_defaults().startup_ns)
    assert chip.try_get(G, 0x0F) == chip.try_get(XM, 0x0F) == -1
    chip.wait(10)  # AN4505: about 10 ms
    assert chip.get(G, 0x0F) == [0xD4]
    assert chip.get(XM, 0x0F) == [0x49]


@pytest.mark.parametrize("address", [G, XM])
def test_bit_7_of_the_sub_address_makes_it_move_on(chip: Chip, address: int) -> None:
    assert chip.get(address, 0x20, 3) == [0x07, 0x07, 0x07]  # DS 6.1
    after = chip.get(address, ON | 0x20, 3)
    assert after == [0x07, 0x00, 0x00]
    chip.put(address, ON | 0x20, 0x03, 0x10)
    assert chip.get(address, ON | 0x20, 2) == [0x03, 0x10]
    chip.put(address, 0x20, 0x00, 0x05)  # without ON both go to the same register
    assert chip.get(address, ON | 0x20, 2) == [0x05, 0x10]


def test_the_dies_have_registers_of_their_own(chip: Chip) -> None:
    chip.put(G, 0x21, 0x2A)
    chip.put(XM, 0x21, 0xD8)
    assert chip.get(G, 0x21) == [0x2A]
    assert chip.get(XM, 0x21) == [0xD8]
    assert chip.call("peek_g", 0x21) == 0x2A
    assert chip.call("peek_xm", 0x21) == 0xD8


WRITABLE = {
    G: {*range(0x20, 0x26), 0x2E, 0x30, *range(0x32, 0x39)},
    XM: {0x12, *range(0x14, 0x27), 0x2E, 0x30, *range(0x32, 0x35)}
    | {0x36, 0x37, 0x38, *range(0x3A, 0x40)},
}


@pytest.mark.parametrize("address", [G, XM])
def test_reserved_and_read_only_registers_stay_and_complain(address: int) -> None:
    for reg in range(128):
        chip = Chip()
        before = chip.get(address, reg)
        chip.put(address, reg, before[0])
        has_complained = chip.complaint() is not None
        assert has_complained is (reg not in WRITABLE[address]), hex(reg)
        assert chip.get(address, reg) == before


@pytest.mark.parametrize(
    ("address", "reg", "value", "kept"),
    [
        (G, 0x21, 0x40, 0x00),  # DS CTRL_REG2_G: bits that must not be changed
        (G, 0x23, 0x08, 0x00),
        (G, 0x24, 0x20, 0x00),
        (XM, 0x1F, 0x08, 0x00),
        (XM, 0x25, 0x21, 0x20),
        (XM, 0x25, 0xA0, 0x20),
        (XM, 0x26, 0x0A, 0x02),
        (XM, 0x26, 0x12, 0x02),
    ],
)
def test_reserved_bits_stay_and_complain(
    address: int, reg: int, value: int, kept: int
) -> None:
    chip = Chip()
    chip.put(address, reg, value)
    assert "reserved" in str(chip.complaint())
    assert chip.get(address, reg) == [kept]


@pytest.mark.parametrize(
    ("address", "reg", "value"),
    [
        (G, 0x22, 0x80),  # interrupts on INT_G
        (G, 0x22, 0x04),  # FIFO watermark on DRDY_G
        (G, 0x23, 0x01),  # 3-wire SPI
        (G, 0x24, 0x40),  # FIFO
        (G, 0x24, 0x10),  # high-pass filter
        (G, 0x24, 0x01),  # high-pass filtered data
        (G, 0x2E, 0x40),  # stream mode
        (G, 0x30, 0x20),
        (XM, 0x12, 0xE9),  # magnetic interrupt
        (XM, 0x16, 0x01),  # magnetic offset
        (XM, 0x1F, 0x40),
        (XM, 0x22, 0x20),
        (XM, 0x23, 0x01),
        (XM, 0x26, 0x22),  # AFDS: filtered acceleration
        (XM, 0x2E, 0x20),
        (XM, 0x30, 0x01),
        (XM, 0x38, 0x01),
        (XM, 0x3E, 0x01),
    ],
)
def test_what_is_not_modelled_complains(address: int, reg: int, value: int) -> None:
    chip = Chip()
    chip.put(address, reg, value)
    assert "not modelled" in str(chip.complaint())


@pytest.mark.parametrize(
    "writes",
    [
        [(G, 0x23, 0x04)],  # DS CTRL_REG4_G: ST 10
        [(XM, 0x20, 0xB7)],  # DS CTRL_REG1_XM: AODR 1011
        [(XM, 0x21, 0x28)],  # DS CTRL_REG2_XM: AFS 101
        [(XM, 0x21, 0x06)],  # DS CTRL_REG2_XM: AST 11, not allowed
        [(XM, 0x24, 0x34)],  # DS CTRL_REG5_XM: M_RES 01
        [(XM, 0x26, 0x00)],  # M_ODR 110, its reset value: do not use
        [(XM, 0x24, 0x14), (XM, 0x20, 0x57), (XM, 0x26, 0x00)],  # 100 Hz with AODR 50
        [(XM, 0x24, 0x14), (XM, 0x26, 0x00), (XM, 0x20, 0x17)],
    ],
)
def test_values_that_the_data_sheet_forbids_complain(
    writes: list[tuple[int, int, int]],
) -> None:
    chip = Chip()
    for address, reg, value in writes:
        assert chip.complaint() is None
        chip.put(address, reg, value)
    assert chip.complaint() is not None


@pytest.mark.parametrize("ctrl1", [0x07, 0x67, 0xA7])
def test_100_hz_of_the_magnetometer_goes_with_the_accelerometer_off_or_fast(
    chip: Chip, ctrl1: int
) -> None:
    chip.put(XM, 0x20, ctrl1)
    chip.run_mag()


def test_a_reboot_clears_its_bit_and_keeps_the_registers() -> None:
    chip = Chip(startup_ns=10 * MS)
    chip.wait(10)
    chip.run_gyro()
    chip.run_accel()
    chip.put(G, 0x24, 0x80)
    chip.put(XM, 0x1F, 0x80)
    before = chip.samples(GYR), chip.samples(ACC)
    chip.wait(9)
    assert chip.get(G, 0x24) == chip.get(XM, 0x1F) == [0x80]
    assert (chip.samples(GYR), chip.samples(ACC)) == before
    chip.wait(10)
    assert chip.get(G, 0x24) == chip.get(XM, 0x1F) == [0x00]
    assert chip.get(G, 0x20) == [0xBF]
    assert chip.get(XM, 0x20) == [0x8F]
    assert chip.samples(GYR) > before[0]
    assert chip.samples(ACC) > before[1]
    assert chip.complaint() is None
    chip.put(XM, 0x1F, 0x80)
    chip.put(XM, 0x20, 0x07)
    assert "reboot" in str(chip.complaint())
