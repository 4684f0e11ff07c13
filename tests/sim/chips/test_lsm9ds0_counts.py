# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 against the manufacturer's documents: sample clocks and
counts.

Numbers are typed from the data sheet, DocID024763 rev 2 (DS; registers by their names
there), not taken from the model.
"""

from __future__ import annotations

import math

import pytest

from sim.chips.lsm9ds0_desk import ACC, GYR, MAG, ON, XM, Chip, G, recorder
from sim.chips.sensor_desk import GRAVITY, MS


@pytest.mark.parametrize("dr", range(4))
def test_gyroscope_rates(chip: Chip, dr: int) -> None:
    chip.run_gyro(ctrl1=(dr << 6) | 0x0F)
    times = chip.times(GYR, 20)
    hz = (95, 190, 380, 760)[dr]  # DS table 21
    assert times[-1] - times[0] == pytest.approx(19e9 / hz, abs=1)


@pytest.mark.parametrize(
    ("aodr", "hz"),
    # DS CTRL_REG1_XM
    list(enumerate([3.125, 6.25, 12.5, 25, 50, 100, 200, 400, 800, 1600], start=1)),
)
def test_accelerometer_rates(chip: Chip, aodr: int, hz: float) -> None:
    chip.run_accel(ctrl1=(aodr << 4) | 0x07)
    times = chip.times(ACC, 20)
    assert times[-1] - times[0] == pytest.approx(19e9 / hz, abs=1)


@pytest.mark.parametrize(
    ("modr", "hz"),
    list(enumerate([3.125, 6.25, 12.5, 25, 50, 100])),  # DS CTRL_REG5_XM
)
def test_magnetometer_rates(chip: Chip, modr: int, hz: float) -> None:
    chip.run_mag(ctrl5=modr << 2)
    times = chip.times(MAG, 20)
    assert times[-1] - times[0] == pytest.approx(19e9 / hz, abs=1)


def test_power_down_and_sleep_stop_a_sensor(chip: Chip) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.run_mag()
    chip.wait(100)
    chip.put(G, 0x20, 0xB8)  # DS table 22: PD 1, no axis: sleep
    chip.put(XM, 0x20, 0x0F)
    chip.put(XM, 0x26, 0x03)
    before = [chip.samples(q) for q in (GYR, ACC, MAG)]
    chip.wait(1000)
    chip.put(G, 0x20, 0xB7)  # PD 0: power-down
    chip.wait(1000)
    assert [chip.samples(q) for q in (GYR, ACC, MAG)] == before


def test_the_dies_drift_apart_by_their_clocks() -> None:
    chip = Chip(g_rate_error_ppm=1000.0, xm_rate_error_ppm=-500.0)
    chip.run_gyro()
    chip.run_accel()
    chip.run_mag()
    start = [chip.samples(q) for q in (GYR, ACC, MAG)]
    chip.wait(100_000)
    taken = [chip.samples(q) - s for q, s in zip((GYR, ACC, MAG), start, strict=True)]
    assert taken == pytest.approx([38_038, 39_980, 9_995], abs=1)


@pytest.mark.parametrize(
    ("fs", "mdps"),
    [(0, 8.75), (1, 17.50), (2, 70), (3, 70)],  # DS table 3: G_So
)
def test_gyroscope_counts_over_the_ranges(chip: Chip, fs: int, mdps: float) -> None:
    one = math.radians(mdps * 1e-3)
    chip.run_gyro(ctrl4=0x80 | (fs << 4))
    chip.hold(gyr=(20_000 * one, -10_000.4 * one, 40_000 * one))
    chip.sample(GYR)
    assert chip.counts(GYR) == [20_000, -10_000, 32_767]
    chip.hold(gyr=(-40_000 * one, 0.6 * one, -0.4 * one))
    chip.sample(GYR)
    assert chip.counts(GYR) == [-32_768, 1, 0]


@pytest.mark.parametrize(
    ("afs", "mg"),
    [(0, 0.061), (1, 0.122), (2, 0.183), (3, 0.244), (4, 0.732)],  # DS table 3: LA_So
)
def test_accelerometer_counts_over_the_ranges(chip: Chip, afs: int, mg: float) -> None:
    one = mg * 1e-3 * GRAVITY
    chip.run_accel(ctrl2=0x80 | (afs << 3))
    chip.hold(acc=(20_000 * one, -10_000.4 * one, 40_000 * one))
    chip.sample(ACC)
    assert chip.counts(ACC) == [20_000, -10_000, 32_767]
    chip.hold(acc=(-40_000 * one, 0.6 * one, 0.0))
    chip.sample(ACC)
    assert chip.counts(ACC) == [-32_768, 1, 0]


@pytest.mark.parametrize(
    ("mfs", "mgauss"),
    [(0, 0.08), (1, 0.16), (2, 0.32), (3, 0.48)],  # DS table 3: M_GN
)
def test_magnetometer_counts_over_the_ranges(
    chip: Chip, mfs: int, mgauss: float
) -> None:
    one = mgauss * 0.1  # uT
    chip.run_mag(ctrl6=mfs << 5)
    chip.hold(mag=(20_000 * one, -10_000.4 * one, -40_000 * one))
    chip.sample(MAG)
    assert chip.counts(MAG) == [20_000, -10_000, 32_767]
    chip.hold(mag=(-40_000 * one, 0.6 * one, 0.0))
    chip.sample(MAG)
    assert chip.counts(MAG) == [-32_768, 1, 0]


def test_lying_level_reads_one_g_on_z(chip: Chip) -> None:
    chip.run_accel(ctrl2=0x00)
    chip.sample(ACC)
    assert chip.counts(ACC) == [0, 0, round(1000 / 0.061)]


def test_the_axes_of_the_magnetometer_are_a_choice() -> None:
    chip = Chip(mag_sign=[-1, 1, 1])
    chip.run_mag()
    chip.hold(mag=(8.0, 16.0, 24.0))
    chip.sample(MAG)
    assert chip.counts(MAG) == [-1000, 2000, 3000]


@pytest.mark.parametrize(
    ("ctrl1", "hz"),
    [
        (dr << 6 | bw << 4 | 0x0F, hz)
        for dr, row in enumerate(  # DS table 21
            [
                (12.5, 25, 25, 25),
                (12.5, 25, 50, 70),
                (20, 25, 50, 100),
                (30, 35, 50, 100),
            ]
        )
        for bw, hz in enumerate(row)
    ],
)
def test_the_gyroscope_is_averaged_over_its_bandwidth(ctrl1: int, hz: float) -> None:
    motion, asked = recorder(GYR)
    chip = Chip(motion=motion)
    chip.run_gyro(ctrl1=ctrl1)
    now = chip.sample(GYR)
    assert asked == [(now - round(0.443e9 / hz), now)]


def test_lpf2_has_the_bandwidth_too() -> None:
    motion, asked = recorder(GYR)
    chip = Chip(motion=motion)
    chip.put(G, 0x24, 0x02)  # DS CTRL_REG5_G: Out_Sel
    chip.run_gyro()
    now = chip.sample(GYR)
    assert asked == [(now - 4_430_000, now)]
    assert chip.complaint() is None


@pytest.mark.parametrize(
    ("abw", "hz"), list(enumerate([773, 194, 362, 50]))
)  # CTRL_REG2_XM
def test_the_accelerometer_has_an_anti_alias_filter(abw: int, hz: float) -> None:
    motion, asked = recorder(ACC)
    chip = Chip(motion=motion)
    chip.run_accel(ctrl2=abw << 6)
    now = chip.sample(ACC)
    assert asked == [(now - round(0.443e9 / hz), now)]


def test_the_field_is_that_of_the_instant() -> None:
    motion, asked = recorder(MAG)
    chip = Chip(motion=motion)
    chip.run_mag()
    now = chip.sample(MAG)
    assert asked == [(now, now)]


def test_the_gyroscope_reads_zero_until_it_is_on() -> None:
    chip = Chip(gyr_turn_on_ns=250 * MS)
    chip.hold(gyr=(1, 1, 1))
    chip.run_gyro()
    chip.wait(249)
    assert chip.counts(GYR) == [0, 0, 0]
    chip.wait(4)
    assert 0 not in chip.counts(GYR)
    chip.put(G, 0x20, 0xB8)  # no turn-on time after sleep: it vibrates on
    chip.put(G, 0x20, 0xBF)
    chip.sample(GYR)
    assert 0 not in chip.counts(GYR)
    chip.put(G, 0x20, 0x00)
    chip.put(G, 0x20, 0xBF)
    chip.sample(GYR)
    assert chip.counts(GYR) == [0, 0, 0]


@pytest.mark.parametrize(
    ("celsius", "counts"), [(25.0, 0), (26.0, 8), (-40.0, -520), (85.0, 480)]
)
def test_temperature_in_eighths_of_a_degree(
    chip: Chip, celsius: float, counts: int
) -> None:
    chip.call("set_temperature", celsius)
    chip.run_mag()
    chip.sample(MAG)
    data = bytes(chip.get(XM, ON | 0x05, 2))  # DS table 4: 8 LSB/degC
    assert int.from_bytes(data, "little", signed=True) == counts


def test_temperature_stands_without_its_enable_bit(chip: Chip) -> None:
    chip.call("set_temperature", 40.0)
    chip.run_mag(ctrl5=0x74)
    chip.sample(MAG)
    assert chip.get(XM, ON | 0x05, 2) == [0, 0]
