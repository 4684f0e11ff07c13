# SPDX-License-Identifier: MIT
"""The model of the MPU-9250 against the manufacturers' documents: counts and
self-test.

Numbers are typed from RM-MPU-9250A-00 (RM), PS-MPU-9250A-01 (PS) and AN-MPU-9250A-03
(ST), not taken from the model.
"""

from __future__ import annotations

import math

import pytest

from sim.chips.mpu9250_desk import MPU, Chip, lib, recorder
from sim.chips.sensor_desk import GRAVITY, MS


@pytest.mark.parametrize("fs_sel", range(4))
def test_gyroscope_counts_over_the_ranges(chip: Chip, fs_sel: int) -> None:
    full = math.radians(250.0 * 2**fs_sel)
    chip.write(27, fs_sel << 3)
    chip.sample()
    chip.hold(gyr=(0.5 * full, -0.25 * full, 3.0 * full))
    chip.wait(100)
    assert chip.words(67, 3) == [16384, -8192, 32767]
    chip.hold(gyr=(-3.0 * full, 0.6 * full / 32768, -0.4 * full / 32768))
    chip.wait(100)
    assert chip.words(67, 3) == [-32768, 1, 0]


@pytest.mark.parametrize("afs_sel", range(4))
def test_accelerometer_counts_over_the_ranges(chip: Chip, afs_sel: int) -> None:
    full = 2.0 * 2**afs_sel * GRAVITY
    chip.write(28, afs_sel << 3)
    chip.sample()
    chip.hold(acc=(0.5 * full, -0.25 * full, 3.0 * full))
    chip.wait(100)
    assert chip.words(59, 3) == [16384, -8192, 32767]
    chip.hold(acc=(-3.0 * full, 0.6 * full / 32768, 0.0))
    chip.wait(100)
    assert chip.words(59, 3) == [-32768, 1, 0]


def test_sensitivities_are_those_of_the_product_specification(chip: Chip) -> None:
    chip.sample()
    chip.hold(gyr=(math.radians(100), 0, 0), acc=(0, 0, GRAVITY))
    chip.wait(100)
    assert chip.words(67, 1)[0] == pytest.approx(100 * 131, rel=1e-3)  # PS 3.1
    assert chip.words(63, 1) == [16384]  # PS 3.2


def test_temperature_by_the_data_sheets_formula() -> None:
    for celsius in (-40.0, 21.0, 25.0, 85.0):
        chip = Chip(temperature_c=celsius)
        chip.sample()
        chip.wait(10)
        assert chip.words(65, 1)[0] / 333.87 + 21.0 == pytest.approx(celsius, abs=2e-3)


@pytest.mark.parametrize(("dlpf", "hz"), [(1, 184), (2, 92), (3, 41), (4, 20), (5, 10)])
def test_the_gyroscope_is_averaged_over_its_bandwidth(dlpf: int, hz: float) -> None:
    motion, asked = recorder(lib.CHIP_GYR)
    chip = Chip(motion=motion)
    chip.write(26, dlpf)
    chip.write(25, 4)
    chip.wait(50)
    start, end = asked[-1]
    assert end - start == pytest.approx(0.443e9 / hz, abs=1)
    assert end - asked[-2][1] == 5 * MS


@pytest.mark.parametrize(("dlpf", "hz"), [(2, 99), (3, 44.8), (4, 21.2), (6, 5.05)])
def test_the_accelerometer_has_a_bandwidth_of_its_own(dlpf: int, hz: float) -> None:
    motion, asked = recorder(lib.CHIP_ACC)
    chip = Chip(motion=motion)
    chip.write(29, dlpf)
    chip.sample()
    chip.wait(50)
    start, end = asked[-1]
    assert end - start == pytest.approx(0.443e9 / hz, abs=1)


def test_disabled_axes_and_sensors_that_start_read_zero(chip: Chip) -> None:
    chip.sample()
    chip.hold(gyr=(1, 1, 1), acc=(5, 5, 5))
    chip.wait(30)
    assert chip.words(67, 3) == [0, 0, 0]  # PS 3.1: starts up in 35 ms
    assert 0 not in chip.words(59, 3)  # PS 3.2: starts up in 20 ms
    chip.wait(20)
    assert 0 not in chip.words(67, 3)
    chip.write(108, 0b00_010_001)
    chip.wait(10)
    assert [word == 0 for word in chip.words(59, 3)] == [False, True, False]
    assert [word == 0 for word in chip.words(67, 3)] == [False, False, True]


def test_a_burst_is_of_one_instant(chip: Chip) -> None:
    chip.sample()
    chip.wait(100)
    chip.hold(gyr=(1, 1, 1), acc=(0, 0, 0))
    chip.start(MPU, is_read=False)
    chip.send(59)
    chip.start(MPU, is_read=True)
    first = [chip.receive() for _ in range(6)]
    chip.wait(20)  # four samples come meanwhile
    rest = [chip.receive(ack=i < 7) for i in range(8)]
    chip.stop()
    assert first == [0, 0, 0, 0, 0x40, 0]
    assert rest[2:] == [0] * 6
    assert chip.words(67, 3)[0] != 0


def self_test_ratios(chip: Chip) -> list[float]:
    """Responses divided by factory trim (ST 3): gyroscope, then accelerometer."""
    chip.write(26, 2)
    chip.write(29, 2)
    chip.write(27, 0)
    chip.write(28, 0)
    chip.wait(100)
    off = chip.words(67, 3) + chip.words(59, 3)
    chip.write(27, 0xE0)
    chip.write(28, 0xE0)
    chip.wait(20)
    on = chip.words(67, 3) + chip.words(59, 3)
    codes = chip.read(0, 3) + chip.read(13, 3)
    trims = [2620 * 1.01 ** (code - 1) for code in codes]
    return [(b - a) / trim for a, b, trim in zip(off, on, trims, strict=True)]


def test_a_good_chip_passes_its_self_test(chip: Chip) -> None:
    chip.hold(acc=(0, 0, 0))
    assert self_test_ratios(chip) == pytest.approx([1.0] * 6, abs=1e-3)


def test_self_test_responses_scale_with_the_range(chip: Chip) -> None:
    chip.hold(acc=(0, 0, 0))
    chip.write(26, 2)
    chip.write(27, 0xE0 | 0x18)
    chip.write(28, 0xE0 | 0x18)
    chip.wait(100)
    trim = 2620 * 1.01 ** (chip.read(0)[0] - 1)
    assert chip.words(67, 1)[0] == pytest.approx(trim / 8, abs=0.5)


@pytest.mark.parametrize(
    ("kind", "low"), [("GYR_SELF_TEST", [0, 1, 2]), ("ACC_SELF_TEST", [3, 4, 5])]
)
def test_a_broken_axis_fails_its_self_test(
    chip: Chip, kind: str, low: list[int]
) -> None:
    chip.hold(acc=(0, 0, 0))
    chip.fault(kind)
    ratios = self_test_ratios(chip)
    assert [i for i, ratio in enumerate(ratios) if ratio < 0.5] == low
