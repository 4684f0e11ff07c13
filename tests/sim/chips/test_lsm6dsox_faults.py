# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX against the manufacturer's documents: self-test and
faults.

Numbers are typed from the data sheet of the LSM6DSO, DS12140 rev 2 (SO), not taken from
the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lsm6dsox_desk import ACC, GYR, IMU, INT1, Chip
from sim.chips.sensor_desk import MS


@pytest.mark.parametrize(
    ("low", "mdps", "least", "most"),
    [(0x00, 8.75, 20, 80), (0x0C, 70.0, 150, 700)],  # SO table 2: 250, 2000 deg/s
)
@pytest.mark.parametrize(("st", "sign"), [(1, 1), (3, -1)])  # DS table 55
def test_a_good_gyroscope_passes_its_self_test(
    chip: Chip, low: int, mdps: float, least: float, most: float, st: int, sign: int
) -> None:
    chip.hold(gyr=(0.1, 0.1, -0.1))
    chip.run(GYR, low=low)
    chip.settle(GYR)
    off = chip.counts(GYR)
    chip.write(0x14, st << 2)
    chip.sample(GYR)
    on = chip.counts(GYR)
    dps = [sign * (b - a) * mdps / 1000 for a, b in zip(off, on, strict=True)]
    assert all(least <= v <= most for v in dps)


@pytest.mark.parametrize(("st", "sign"), [(1, 1), (2, -1)])  # DS table 56
@pytest.mark.parametrize(("fs", "mg"), [(0, 0.061), (2, 0.122)])
def test_a_good_accelerometer_passes_its_self_test(
    chip: Chip, st: int, sign: int, fs: int, mg: float
) -> None:
    chip.run(ACC, low=fs << 2)
    chip.settle(ACC)
    off = chip.counts(ACC)
    chip.write(0x14, st)
    chip.sample(ACC)
    on = chip.counts(ACC)
    responses = [sign * (b - a) * mg for a, b in zip(off, on, strict=True)]
    assert all(50 <= response <= 1700 for response in responses)  # SO table 2


@pytest.mark.parametrize("kind", ["GYR_SELF_TEST", "ACC_SELF_TEST"])
def test_a_broken_sensor_fails_its_self_test(chip: Chip, kind: str) -> None:
    chip.hold(acc=(0, 0, 0))
    chip.fault(kind)
    chip.run(GYR)
    chip.run(ACC)
    chip.write(0x14, 0x05)
    chip.settle(ACC)
    chip.settle(GYR)
    gyr_dps = [abs(c) * 0.00875 for c in chip.counts(GYR)]
    acc_mg = [c * 0.061 for c in chip.counts(ACC)]
    assert (max(gyr_dps) < 20) is (kind == "GYR_SELF_TEST")
    assert (max(acc_mg) < 52) is (kind == "ACC_SELF_TEST")


def test_a_chip_that_is_absent_answers_nothing(chip: Chip) -> None:
    chip.fault("NACK")
    assert all(chip.try_get(a, 0x0F) == -1 for a in range(128))


def test_data_ready_can_stop(chip: Chip) -> None:
    chip.run(GYR)
    chip.wait(100)
    chip.fault("NO_DATA_READY", from_ns=chip.now[0], for_ns=100 * MS)
    before = chip.samples(GYR)
    chip.counts(GYR)
    chip.wait(99.9)
    assert chip.samples(GYR) == before
    assert not chip.is_high(INT1)
    chip.wait(100)
    assert chip.samples(GYR) - before == pytest.approx(21, abs=1)


def test_who_am_i_can_be_wrong(chip: Chip) -> None:
    chip.fault("WRONG_WHO_AM_I", value=0x6A, for_ns=10 * MS)
    assert chip.read(0x0F) == 0x6A
    chip.wait(11)
    assert chip.read(0x0F) == 0x6C


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    chip.run(GYR)
    chip.run(ACC)
    chip.settle(GYR)
    frozen = chip.counts(GYR), chip.counts(ACC)
    chip.fault("FROZEN")
    chip.hold(gyr=(1, 2, 3), acc=(4, 5, 6))
    chip.sample(GYR)
    assert chip.has_new(GYR)
    assert (chip.counts(GYR), chip.counts(ACC)) == frozen
    chip.clear_faults()
    chip.sample(GYR)
    assert chip.counts(GYR) != frozen[0]


def test_a_register_can_flip_and_what_it_does_with_it(chip: Chip) -> None:
    chip.run(ACC)
    chip.wait(100)
    chip.fault("REGISTER_FLIP", reg=0x10, value=0x00, from_ns=chip.now[0])
    chip.wait(0)
    before = chip.samples(ACC)
    chip.wait(100)
    assert chip.read(0x10) == 0x00
    assert chip.samples(ACC) == before


@pytest.mark.parametrize("how", ["power_cycle", "BROWN_OUT"])
def test_power_loss_forgets_everything(chip: Chip, how: str) -> None:
    chip.run(GYR)
    chip.run(ACC)
    chip.wait(50)
    if how == "power_cycle":
        chip.call(how, chip.now[0])
    else:
        chip.fault(how, from_ns=chip.now[0])
    assert chip.get(IMU, 0x10, 4) == [0x00, 0x00, 0x04, 0x00]
    chip.wait(100)
    assert chip.read(0x1E) == 0


def test_two_chips_do_the_same() -> None:
    def story() -> list[int]:
        chip = Chip(rate_error_ppm=3700.0)
        chip.run(GYR)
        chip.run(ACC)
        answers = []
        for i in range(200):
            chip.hold(gyr=(0.01 * i, 0, 0), acc=(0, 0.1 * i, 0))
            answers += [chip.sample(GYR), *chip.get(IMU, 0x1E, 16)]
        return answers

    assert story() == story()
