# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 against the manufacturer's documents: status, block data
update (BDU), data-ready.

Numbers are typed from the data sheet, DocID024763 rev 2 (DS; registers by their names
there) and from AN3308, not taken from the model.
"""

from __future__ import annotations

import itertools

import pytest

from sim.chips.lsm9ds0_desk import (
    ACC,
    DRDY_G,
    GYR,
    INT1,
    INT2,
    MAG,
    ON,
    PLACES,
    XM,
    Chip,
    G,
)


def test_disabled_axes_are_not_updated(chip: Chip) -> None:
    chip.hold(gyr=(1, 1, 1), acc=(3, 3, 3))
    chip.run_gyro(ctrl1=0xBD)  # Z and X enabled
    chip.run_accel(ctrl1=0x8A)  # Y enabled
    chip.sample(GYR)
    chip.sample(ACC)
    chip.sample(GYR)
    chip.sample(ACC)
    assert chip.status(GYR) & 0x0F == 0x0D
    assert chip.status(ACC) & 0x0F == 0x0A
    assert [c != 0 for c in chip.counts(GYR)] == [True, False, True]
    assert [c != 0 for c in chip.counts(ACC)] == [False, True, False]
    assert chip.status(GYR) == 0x00  # ZYXDA depends on the enabled axes only


def test_an_axis_that_is_off_holds_no_flag_up(chip: Chip) -> None:
    chip.run_gyro()
    chip.sample(GYR)
    chip.put(G, 0x20, 0xBD)  # Y off while its value is unread
    chip.get(G, 0x29)
    chip.get(G, 0x2D)
    assert not chip.is_high(DRDY_G)


PINS = [
    (GYR, DRDY_G, None),
    (ACC, INT1, (0x22, 0x04)),
    (ACC, INT2, (0x23, 0x08)),
    (MAG, INT1, (0x22, 0x02)),
    (MAG, INT2, (0x23, 0x04)),
]


@pytest.mark.parametrize(("quantity", "pin", "enable"), PINS)
def test_data_ready_is_high_from_the_sample_until_all_is_read(
    chip: Chip, quantity: int, pin: int, enable: tuple[int, int] | None
) -> None:
    chip.run(quantity)
    chip.put(XM, ON | 0x22, 0x00, 0x00)
    if enable is not None:
        chip.put(XM, *enable)
    assert not chip.is_high(pin)
    chip.sample(quantity)
    others = {DRDY_G, INT1, INT2} - {pin}
    assert chip.is_high(pin)
    assert not any(chip.is_high(other) for other in others - {DRDY_G})
    chip.sample(quantity)
    assert chip.is_high(pin)  # stays high until the data are read
    address, _, out = PLACES[quantity]
    chip.get(address, ON | out, 5)
    assert chip.is_high(pin)
    chip.get(address, out + 5)
    assert not chip.is_high(pin)


def test_data_ready_of_the_gyroscope_has_its_enable_bit(chip: Chip) -> None:
    chip.run_gyro()
    chip.put(G, 0x22, 0x00)
    chip.sample(GYR)
    assert not chip.is_high(DRDY_G)
    chip.put(G, 0x22, 0x28)  # H_Lactive concerns INT_G only
    assert chip.is_high(DRDY_G)


def test_pins_of_the_xm_die_can_be_active_low(chip: Chip) -> None:
    chip.put(XM, 0x12, 0xE0)  # DS INT_CTRL_REG_M: IEA
    chip.run_accel()
    assert chip.is_high(INT1)
    chip.sample(ACC)
    assert not chip.is_high(INT1)
    assert chip.is_high(INT2)


def test_one_pin_can_tell_of_both_sensors(chip: Chip) -> None:
    chip.run_accel()
    chip.run_mag()
    chip.put(XM, 0x22, 0x06)
    chip.sample(MAG)
    chip.counts(MAG)
    assert chip.is_high(INT1)
    chip.counts(ACC)
    assert not chip.is_high(INT1)


def test_edges_follow_the_rate_where_each_sample_is_read(chip: Chip) -> None:
    chip.run_gyro(ctrl1=0xFF)
    rises = []
    for _ in range(760):
        assert not chip.is_high(DRDY_G)
        rises.append(chip.sample(GYR))
        assert chip.is_high(DRDY_G)
        assert chip.get(G, ON | 0x27, 7)[0] == 0x0F
    steps = {b - a for a, b in itertools.pairwise(rises)}
    assert steps == {1_315_789, 1_315_790}  # 760 Hz, to the nanosecond
