# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 against the manufacturer's documents: the dies,
resets, self-test and faults.

Numbers are typed from the data sheet, DocID024763 rev 2 (DS; registers by their names
there) and from AN4505, not taken from the model.
"""

from __future__ import annotations

import math

import pytest

from sim.chips.lsm9ds0_desk import ACC, GYR, INT1, INT2, MAG, XM, Chip, G
from sim.chips.sensor_desk import MS


def test_the_polarity_at_reset_can_be_the_other_one() -> None:
    chip = Chip(int_ctrl_reg_m=0x00)
    assert chip.get(XM, 0x12) == [0x00]
    assert chip.is_high(INT1)  # active low and not asserted


def test_the_dies_have_registers_of_their_own(chip: Chip) -> None:
    chip.put(G, 0x21, 0x2A)
    chip.put(XM, 0x21, 0xD8)
    assert chip.get(G, 0x21) == [0x2A]
    assert chip.get(XM, 0x21) == [0xD8]
    assert chip.peek(0x21) == 0x2A
    assert chip.peek(0x21, die=2) == 0xD8


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


@pytest.mark.parametrize(
    ("fs", "low", "high"),
    [(0, 20, 250), (1, 70, 400), (2, 150, 1000)],  # DS table 3
)
@pytest.mark.parametrize(
    ("st", "signs"),
    [(1, [1, -1, -1]), (3, [-1, 1, 1])],  # DS CTRL_REG4_G
)
def test_a_good_gyroscope_passes_its_self_test(
    chip: Chip, fs: int, low: float, high: float, st: int, signs: list[int]
) -> None:
    mdps = (8.75, 17.50, 70.0)[fs]
    chip.hold(gyr=(0.1, 0.1, -0.1))
    chip.run_gyro(ctrl4=0x80 | (fs << 4))
    chip.sample(GYR)
    off = chip.counts(GYR)
    chip.put(G, 0x23, 0x80 | (fs << 4) | (st << 1))
    chip.sample(GYR)
    on = chip.counts(GYR)
    dps = [(b - a) * mdps / 1000 for a, b in zip(off, on, strict=True)]
    assert [math.copysign(1, v) for v in dps] == signs
    assert all(low <= abs(v) <= high for v in dps)


@pytest.mark.parametrize(("ast", "sign"), [(1, 1), (2, -1)])  # DS CTRL_REG2_XM
@pytest.mark.parametrize(("afs", "mg"), [(0, 0.061), (3, 0.244)])
def test_a_good_accelerometer_passes_its_self_test(
    chip: Chip, ast: int, sign: int, afs: int, mg: float
) -> None:
    chip.run_accel(ctrl2=afs << 3)
    chip.sample(ACC)
    off = chip.counts(ACC)
    chip.put(XM, 0x21, (afs << 3) | (ast << 1))
    chip.sample(ACC)
    on = chip.counts(ACC)
    responses = [sign * (b - a) * mg for a, b in zip(off, on, strict=True)]
    assert all(60 <= response <= 1700 for response in responses)  # DS table 3


@pytest.mark.parametrize("kind", ["GYR_SELF_TEST", "ACC_SELF_TEST"])
def test_a_broken_sensor_fails_its_self_test(chip: Chip, kind: str) -> None:
    chip.hold(acc=(0, 0, 0))
    chip.fault(kind)
    chip.run_gyro(ctrl4=0x82)
    chip.run_accel(ctrl2=0x02)
    chip.sample(ACC)
    chip.sample(GYR)
    gyr_dps = [abs(c) * 0.00875 for c in chip.counts(GYR)]
    acc_mg = [c * 0.061 for c in chip.counts(ACC)]
    assert (max(gyr_dps) < 20) is (kind == "GYR_SELF_TEST")
    assert (max(acc_mg) < 60) is (kind == "ACC_SELF_TEST")


def test_a_nack_lasts_for_its_span_and_is_of_its_die(chip: Chip) -> None:
    chip.fault("NACK", "G", from_ns=10 * MS, for_ns=10 * MS)
    assert chip.try_get(G, 0x0F) == 0
    chip.wait(11)
    assert chip.try_get(G, 0x0F) == -1
    assert chip.try_get(XM, 0x0F) == 0
    chip.wait(9)
    assert chip.try_get(G, 0x0F) == 0


@pytest.mark.parametrize(
    ("die", "goes_on"), [("BOTH", [0, 0]), ("G", [0, 40]), ("XM", [38, 0])]
)
def test_data_ready_can_stop(chip: Chip, die: str, goes_on: list[int]) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.wait(100)
    chip.fault("NO_DATA_READY", die, from_ns=chip.now[0], for_ns=100 * MS)
    before = [chip.samples(q) for q in (GYR, ACC)]
    chip.wait(99.9)
    middle = [chip.samples(q) for q in (GYR, ACC)]
    taken = [b - a for a, b in zip(before, middle, strict=True)]
    assert taken == pytest.approx(goes_on, abs=1)
    chip.wait(100)
    after = [chip.samples(q) for q in (GYR, ACC)]
    assert min(b - a for a, b in zip(middle, after, strict=True)) >= 37


@pytest.mark.parametrize(
    ("die", "expected"),
    [("BOTH", [0x68, 0x68]), ("G", [0x68, 0x49]), ("XM", [0xD4, 0x68])],
)
def test_who_am_i_can_be_wrong_in_either_half(
    chip: Chip, die: str, expected: list[int]
) -> None:
    chip.fault("WRONG_WHO_AM_I", die, value=0x68)
    assert chip.get(G, 0x0F) + chip.get(XM, 0x0F) == expected


def test_a_dead_magnetometer_leaves_the_accelerometer(chip: Chip) -> None:
    chip.fault("NO_MAG")
    chip.run_accel()
    chip.run_mag()
    chip.wait(1000)
    assert chip.status(MAG) == 0x00
    assert chip.counts(MAG) == [0, 0, 0]
    assert not chip.is_high(INT2)
    assert chip.is_high(INT1)


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.sample(GYR)
    chip.sample(ACC)
    frozen = chip.counts(GYR)
    chip.fault("FROZEN", "G")
    chip.hold(gyr=(1, 2, 3), acc=(4, 5, 6))
    chip.sample(ACC)
    chip.sample(GYR)
    assert chip.status(GYR) & 0x0F == 0x0F
    assert chip.counts(GYR) == frozen
    assert 0 not in chip.counts(ACC)
    chip.clear_faults()
    chip.sample(GYR)
    assert chip.counts(GYR) != frozen
