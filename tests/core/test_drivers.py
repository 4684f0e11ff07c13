# SPDX-License-Identifier: MIT
"""What the drivers of all sensors promise: their set-up, its time and its failures, and
physical values that arrive as counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from core import joined_desk, lsm9ds0_desk, mpu9250_desk
from core.lsm9ds0_desk import BOTH_PASSED
from core.sensor_desk import SETUP_MAX_US, axes, lib
from length import IS_SAMPLE

pytestmark = pytest.mark.sampled(3)


@dataclass(frozen=True)
class Driver:
    """A driver's bench, and what its header says of it."""

    bench: Callable[..., Any]
    who: list[int]
    verdict: int  # of the self-test
    step_us: int  # that no step of set-up exceeds on the bus
    first_s: float  # of set-up, with the self-test
    again_s: float
    calls: int  # of set-up that a slow caller needs
    # Whether a refused transaction may be tried again: by address and register.
    is_tried_again: Callable[[int, int], bool] = lambda _address, _reg: False


DRIVERS = {
    "mpu9250": Driver(
        *(mpu9250_desk.Bench, [0x71, 0x48], mpu9250_desk.HOST_JUDGES),
        *(500, 0.7, 0.4, 500),
        lambda address, reg: address == 0x0C or reg == 55,  # the magnetometer, bypass
    ),
    "lsm9ds0": Driver(
        *(lsm9ds0_desk.Bench, [0xD4, 0x49], BOTH_PASSED, 550, 1.2, 0.9, 100),
    ),
    "joined": Driver(
        *(joined_desk.Bench, [0x6C, 0x3D], BOTH_PASSED | lib.SELF_TEST_MAG_PASSED),
        *(450, 1.1, 0.25, 100),
        lambda address, reg: address in (0x1C, 0x1E) or reg == 0x0F,
    ),
    "lsm6dsv16x": Driver(
        *(joined_desk.dsv, [0x70, 0x3D], BOTH_PASSED | lib.SELF_TEST_MAG_PASSED),
        *(450, 1.1, 0.25, 100),
        lambda address, reg: address in (0x1C, 0x1E) or reg == 0x0F,
    ),
}
every_driver = pytest.mark.parametrize("driver", DRIVERS.values(), ids=DRIVERS)


def running(driver: Driver, **options: Any) -> Any:
    bench = driver.bench(**options)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == driver.verdict
    return bench


@every_driver
def test_no_step_of_set_up_holds_the_bus_for_more_than_half_a_millisecond(driver):
    assert 0 < running(driver).longest_step_ns <= 1000 * driver.step_us


@every_driver
def test_set_up_takes_as_long_as_its_header_says(driver):
    bench = running(driver)
    assert bench.now_ns / 1e9 == pytest.approx(driver.first_s, abs=0.1)
    before_ns = bench.now_ns
    assert bench.set_up() == lib.SENSOR_OK
    taken_s = (bench.now_ns - before_ns) / 1e9
    assert taken_s == pytest.approx(driver.again_s, abs=0.1)
    assert bench.identity.self_test == driver.verdict


@every_driver
@pytest.mark.parametrize("step_us", [50, 700, 4999, 30_000])
def test_set_up_does_not_mind_how_often_it_is_called(driver, step_us):
    bench = driver.bench()
    # A sample of the self-test a call, at most: a slow caller takes that much longer.
    bound_us = SETUP_MAX_US + driver.calls * step_us
    assert bench.set_up(step_us, bound_us) == lib.SENSOR_OK
    assert bench.identity.self_test == driver.verdict


@every_driver
@pytest.mark.parametrize(
    "before_us", [1, 15_000, 150_000, 300_000, 600_000, 700_000, 1_100_000, 1_400_000]
)
def test_set_up_survives_the_wrap_of_device_time(driver, before_us):
    running(driver, start_us=2**32 - before_us)


@every_driver
def test_set_up_stays_done_when_device_time_wraps(driver):
    bench = running(driver)
    for later_us in (0, 1000, 2**31, 2**32 - 1000, 2**32 + 1000):
        now_us = (bench.now_us + later_us) & 0xFFFFFFFF
        assert bench.call("setup", bench.bus, now_us) == lib.SENSOR_OK


@pytest.mark.long
@pytest.mark.parametrize("part", range(4))
@every_driver
def test_a_wire_pulled_at_any_transaction_is_reported_or_tried_again(driver, part):
    count = running(driver).transactions
    assert count > 70
    for pulled_at in range(1 + part, count + 1, 12 if IS_SAMPLE else 4):
        bench = driver.bench()
        bench.pulled_at = pulled_at
        result = bench.set_up()
        if driver.is_tried_again(*bench.pulled):
            assert result in (lib.SENSOR_OK, lib.SENSOR_BUS_NACK)
        else:
            assert result == lib.SENSOR_BUS_NACK
            assert bench.transactions == pulled_at
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert list(bench.identity.who_am_i) == driver.who
        assert bench.identity.self_test == driver.verdict
        assert bench.complaint is None


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("name", "unit", "lsb", "values", "off"),
    [
        ("mpu9250", "g", 16 / 32768, (-15.3, -1.0, 0.003, 0.1, 15.9), 1),
        ("mpu9250", "dps", 2000 / 32768, (-1994.0, -57.0, 0.115, 573.0, 1994.0), 1),
        ("lsm9ds0", "g", 0.732e-3, (-16.0, -1.0, 0.0037, 0.5, 16.0), 0.51),
        ("lsm9ds0", "dps", 0.070, (-2000.0, -1.0, 0.1, 90.0, 2000.0), 0.51),
        ("lsm9ds0", "gauss", 0.08e-3, (-2.0, -0.45, 0.0006, 0.48, 2.0), 0.51),
        ("joined", "g", 0.488e-3, (-15.9, -1.0, 0.0037, 0.5, 15.9), 0.51),
        ("joined", "dps", 0.070, (-2000.0, -1.0, 0.1, 90.0, 2000.0), 0.51),
        ("joined", "gauss", 1 / 6842, (-4.0, -0.45, 0.0006, 0.48, 4.0), 0.51),
    ],
)
def test_a_physical_value_arrives_on_its_axis_as_counts(
    name, unit, lsb, values, off, axis
):
    quantity = {"g": "acc", "dps": "gyr", "gauss": "mag"}[unit]
    bench = running(DRIVERS[name])
    for value in values:
        physical = [0.0, 0.0, 0.0]
        physical[axis] = value
        bench.hold(**{unit: tuple(physical)})
        samples = [s for s in bench.samples(12) if unit != "gauss" or s.has_mag]
        found = axes(getattr(samples[-1], quantity))
        assert list(found) == [pytest.approx(v / lsb, abs=off) for v in physical]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("desk", "quantity", "end"),
    [
        (lsm9ds0_desk, "gyr", 28571),  # 2000 deg/s
        (lsm9ds0_desk, "acc", 21857),  # 16 g
        (lsm9ds0_desk, "mag", 25000),  # 2 gauss
        (joined_desk, "gyr", 28571),
        (joined_desk, "acc", 32766),  # the end of its register
        (joined_desk, "mag", 27368),  # 4 gauss
    ],
)
def test_a_reading_beyond_its_range_is_flagged(desk, quantity, end, axis):
    bench = desk.running()
    for counts in (end, -end, end + 1, -end - 1, -32768):
        values = [0, 0, 0]
        values[axis] = counts
        sample = bench.parse(desk.block(**{quantity: tuple(values)}))
        flagged = {"gyr": sample.gyr_clipped, "acc": sample.acc_clipped}
        flagged["mag"] = not sample.has_mag
        is_beyond = abs(counts) > end
        assert flagged == {each: each == quantity and is_beyond for each in flagged}
        assert sample.mag_overflow == flagged["mag"]
        if quantity != "mag":
            assert list(axes(getattr(sample, quantity))) == values
        elif is_beyond and desk is joined_desk:
            assert axes(sample.mag) == (0, 0, 0)
