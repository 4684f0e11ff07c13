# SPDX-License-Identifier: MIT
"""The model of the LSM6DSV16X: what it has other than the LSM6DSOX; and ranges and
self-tests of both.

The data sheet of the LSM6DSV16X was not at hand. Numbers are typed from ST's driver of
the LSM6DSV (lsm6dsv_reg.h, V) and ST's example lsm6dsv16x_self_test.c (EX), those of
the LSM6DSOX from the documents of test_lsm6dsox_counts.py, not taken from the model.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

from sim.chips.lsm6dsox_desk import Chip as Dsox
from sim.chips.lsm6dsv16x_desk import ACC, GYR, Chip
from sim.chips.sensor_desk import GRAVITY

MDPS = math.radians(1e-3)
MG = 1e-3 * GRAVITY


@pytest.mark.parametrize("quantity", [GYR, ACC])
@pytest.mark.parametrize("code", [3, 7, 12])
@pytest.mark.parametrize(
    ("mode", "rates", "slowest_hz"),
    [(0, 2, 15.0), (1, 0, 15.0), (1, 1, 15.625), (1, 2, 12.5)],  # V: data_rate_t
)
def test_rates_double_from_that_of_their_set(
    chip: Chip, quantity: int, code: int, mode: int, rates: int, slowest_hz: float
) -> None:
    chip.write(0x62, rates)
    chip.run(quantity, code=mode << 4 | code)
    times = chip.times(quantity, 20)
    hz = slowest_hz * 2 ** (code - 3)
    assert times[-1] - times[0] == pytest.approx(19e9 / hz, abs=1)


@pytest.mark.parametrize(
    ("make", "quantity", "low", "one"),
    [
        *((Chip, GYR, code, 4.375 * MDPS * 2**code) for code in range(5)),  # V
        (Chip, GYR, 12, 140.0 * MDPS),
        *((Chip, ACC, code, 0.061 * MG * 2**code) for code in range(4)),
        # DS and SO: G_So; the codes of DS table 47. AD: 2, 16, 4, 8 g
        *((Dsox, GYR, code << 2, 8.75 * MDPS * 2**code) for code in range(4)),
        (Dsox, GYR, 0x02, 4.375 * MDPS),
        *(
            (Dsox, ACC, 4 * n, MG * v)
            for n, v in enumerate((0.061, 0.488, 0.122, 0.244))
        ),
    ],
)
def test_counts_over_the_ranges(make: Any, quantity: int, low: int, one: float) -> None:
    chip = make()
    chip.run(quantity, low=low)
    chip.settle(quantity)
    for shares, counts in (
        ((20_000, -10_000.4, 40_000), [20_000, -10_000, 32_767]),
        ((-40_000, 0.6, -0.4), [-32_768, 1, 0]),
    ):
        values = tuple(share * one for share in shares)
        chip.hold(gyr=values, acc=values)
        chip.sample(quantity)
        assert chip.counts(quantity) == counts


@pytest.mark.parametrize(
    ("make", "quantity", "low", "unit", "limits", "tests"),
    [
        # EX; V: positive, negative
        (Chip, ACC, 1, 0.122, (50, 1700), {0x01: 1, 0x02: -1}),
        (Chip, GYR, 4, 0.07, (150, 700), {0x04: 1, 0x08: -1}),
        # SO table 2: 250, 2000 deg/s; DS tables 56, 55
        (Dsox, ACC, 0x00, 0.061, (50, 1700), {0x01: 1, 0x02: -1}),
        (Dsox, ACC, 0x08, 0.122, (50, 1700), {0x01: 1, 0x02: -1}),
        (Dsox, GYR, 0x00, 8.75e-3, (20, 80), {0x04: 1, 0x0C: -1}),
        (Dsox, GYR, 0x0C, 0.07, (150, 700), {0x04: 1, 0x0C: -1}),
    ],
)
@pytest.mark.parametrize("is_broken", [False, True])
def test_a_good_sensor_passes_its_self_test_and_a_broken_one_does_not(
    make: Any,
    quantity: int,
    low: int,
    unit: float,
    limits: Any,
    tests: Any,
    is_broken: Any,
) -> None:
    for test, sign in tests.items():
        chip = make()
        if is_broken:
            chip.fault("ACC_SELF_TEST" if quantity == ACC else "GYR_SELF_TEST")
        chip.hold(gyr=(0.1, 0.1, -0.1))
        chip.run(quantity, low=low)
        chip.settle(quantity)
        off = chip.counts(quantity)
        chip.write(0x14 if make is Dsox else 0x19, test)
        chip.sample(quantity)
        found = [
            sign * (b - a) * unit
            for a, b in zip(off, chip.counts(quantity), strict=True)
        ]
        least, most = limits
        passed = [least <= value <= most for value in found]
        assert all(passed) if not is_broken else not all(passed)
        assert chip.complaint() is None


@pytest.mark.parametrize(
    ("writes", "words"),
    [
        ([(0x10, 0x01)], "data rate"),  # low power alone
        ([(0x11, 0x0D)], "data rate"),
        ([(0x15, 0x05)], "range"),
        ([(0x19, 0x03)], "self-test"),
        ([(0x19, 0x0C)], "self-test"),
        ([(0x10, 0x07), (0x11, 0x17)], "two modes"),
        ([(0x11, 0x07), (0x15, 0x04)], "while it runs"),
        ([(0x10, 0x07), (0x17, 0x03)], "while it runs"),
        ([(0x10, 0x17), (0x62, 0x02)], "while it runs"),
    ],
)
def test_what_st_s_driver_never_does_complains(
    writes: list[tuple[int, int]], words: str
) -> None:
    chip = Chip()
    for reg, value in writes:
        assert chip.complaint() is None
        chip.write(reg, value)
    assert words in str(chip.complaint())


def test_data_ready_can_be_pulses(chip: Chip) -> None:
    chip.write(0x13, 0x02)  # V: drdy_pulsed
    chip.run(GYR)
    chip.sample(GYR)
    assert chip.is_high()
    chip.wait(0.067)
    assert not chip.is_high()
    assert chip.has_new(GYR)
