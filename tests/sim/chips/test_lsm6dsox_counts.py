# SPDX-License-Identifier: MIT
"""The model of the LSM6DSOX against the manufacturer's documents: sample clock, filters
and counts.

Numbers are typed from the data sheets of the LSM6DSO32, DocID032891 rev 1 (DS), and of
the LSM6DSO, DS12140 rev 2 (SO), from AN5040 (AN), Adafruit's library (AD) and ST's
driver for Qualcomm's hubs (QC), not taken from the model.
"""

from __future__ import annotations

import math

import pytest

from sim.chips.lsm6dsox_desk import (
    ACC,
    GYR,
    HZ,
    IMU,
    PLACES,
    Chip,
    every_sensor,
    recorder,
)
from sim.chips.sensor_desk import GRAVITY, MS


@every_sensor
@pytest.mark.parametrize("code", range(1, 11))
def test_rates_are_halves_of_6667_hz(chip: Chip, quantity: int, code: int) -> None:
    chip.run(quantity, code=code)
    times = chip.times(quantity, 20)
    assert times[-1] - times[0] == pytest.approx(19e9 / HZ[code - 1], abs=1)
    # DS tables 44 and 48 name them so.
    named = [12.5, 26, 52, 104, 208, 416, 833, 1660, 3330, 6660][code - 1]
    assert HZ[code - 1] == pytest.approx(named, rel=0.05)


@every_sensor
def test_power_down_stops_a_sensor_and_keeps_its_last_sample(
    chip: Chip, quantity: int
) -> None:
    chip.hold(gyr=(1, 1, 1), acc=(1, 1, 1))
    chip.run(quantity)
    chip.settle(quantity)
    chip.write(PLACES[quantity][2], 0x00)
    before = chip.samples(quantity)
    chip.wait(1000)
    assert chip.samples(quantity) == before
    assert 0 not in chip.counts(quantity)


def test_both_sensors_sample_on_one_grid(chip: Chip) -> None:
    chip.run(ACC)
    chip.wait(13.7)
    chip.run(GYR)
    for _ in range(5):
        assert chip.sample(GYR) == chip.sample(GYR) - round(1e9 / HZ[4])
        assert chip.next_event() - chip.now[0] > 1 * MS  # nothing else on the way
    chip.run(GYR, code=6)
    fast = set(chip.times(GYR, 20))
    assert {chip.sample(ACC) + round(k * 1e9 / HZ[5]) for k in range(-4, 0)} & fast


def test_examples_of_output_data_of_the_application_note(chip: Chip) -> None:
    chip.run(ACC)
    chip.settle(ACC)
    chip.hold(acc=(0.35 * GRAVITY, -GRAVITY, GRAVITY))
    chip.sample(ACC)
    # AN table 17: 350 mg, -1 g and 1 g at 2 g, within two counts.
    expected = [0x1669, 0xBFF7 - 0x10000, 0x4009]
    assert chip.counts(ACC) == pytest.approx(expected, abs=2)
    chip.run(GYR)
    chip.settle(GYR)
    chip.hold(gyr=(math.radians(100), math.radians(-200), 0))
    chip.sample(GYR)
    expected = [0x2CA4, 0xA6B7 - 0x10000, 0]  # AN table 18
    assert chip.counts(GYR) == pytest.approx(expected, abs=2)


@pytest.mark.parametrize(
    ("code", "hz", "delay_ms"),
    [(3, 16.6, 19.44), (4, 33.0, 9.72), (5, 66.8, 4.86), (6, 135.9, 2.46)],
)
def test_the_gyroscope_has_its_lpf2(code: int, hz: float, delay_ms: float) -> None:
    motion, asked = recorder(GYR)
    chip = Chip(motion=motion)
    chip.run(GYR, code=code)
    now = chip.sample(GYR)
    half = round(0.5 * 0.443e9 / hz)  # DS table 18; QC: gyro_group_delay
    middle = now - round(delay_ms * 1e6)
    assert asked == [(middle - half, middle + half)]


@pytest.mark.parametrize(
    ("code", "delay_ms"),
    [(4, 7.22), (5, 3.74), (6, 1.93)],  # QC: accel_group_delay
)
def test_lpf1_of_the_accelerometer_has_half_the_rate(
    code: int, delay_ms: float
) -> None:
    motion, asked = recorder(ACC)
    chip = Chip(motion=motion)
    chip.run(ACC, code=code)
    now = chip.sample(ACC)
    half = round(0.5 * 0.443e9 / (HZ[code - 1] / 2))
    middle = now - round(delay_ms * 1e6)
    assert asked == [(middle - half, middle + half)]


def test_the_gyroscope_needs_its_turn_on_time_and_some_samples() -> None:
    chip = Chip(gyr_turn_on_ns=70 * MS)
    chip.hold(gyr=(1, 1, 1))
    chip.run(GYR)
    chip.wait(69)
    assert chip.counts(GYR) == [0, 0, 0]
    right = round(math.degrees(1) / 8.75e-3)
    seen = chip.seen(GYR, 0, 5)
    assert seen == [right // 2] * 3 + [right] * 2  # AN table 15: discard 3
    chip.write(0x11, 0x00)
    chip.run(GYR)
    chip.sample(GYR)
    assert chip.counts(GYR) == [0, 0, 0]


@pytest.mark.parametrize(("code", "wrong"), [(2, 0), (5, 1)])
def test_the_first_samples_of_the_accelerometer_are_wrong(
    chip: Chip, code: int, wrong: int
) -> None:
    chip.run(ACC, code=code)  # AN table 13
    seen = chip.seen(ACC, 2, 4)
    right = round(1000 / 0.061)
    assert seen == pytest.approx([right / 2] * wrong + [right] * (4 - wrong), abs=1)


@pytest.mark.parametrize(
    ("celsius", "counts"), [(25, 0), (26, 256), (-40, -16_640), (85, 15_360)]
)
def test_temperature_has_256_counts_a_degree(celsius: float, counts: int) -> None:
    chip = Chip(temperature_c=celsius)
    chip.run(ACC)
    chip.wait(30)  # DS table 5: 52 Hz
    data = bytes(chip.get(IMU, 0x20, 2))
    assert int.from_bytes(data, "little", signed=True) == counts
