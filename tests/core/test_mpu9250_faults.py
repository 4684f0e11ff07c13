# SPDX-License-Identifier: MIT
"""The MPU-9250's driver where the wire or the chip fails."""

from __future__ import annotations

import pytest

from core.mpu9250_desk import (
    ACC_LSB,
    HOST_JUDGES,
    Bench,
    G,
    lib,
    running,
)

pytestmark = pytest.mark.sampled(4)


@pytest.mark.parametrize("at_byte", [0, 1, 2])
def test_a_refused_byte_is_told_as_such(at_byte):
    bench = Bench()
    bench.chip.fault("NACK", first=30, transactions=1_000_000, at_byte=at_byte)
    assert bench.set_up() == lib.SENSOR_BUS_NACK


def test_a_held_data_line_is_a_stuck_bus():
    bench = Bench()
    bench.chip.fault("STUCK_SDA", from_ns=400_000_000)
    assert bench.set_up() == lib.SENSOR_BUS_STUCK


@pytest.mark.parametrize(
    ("from_ms", "told"),
    [
        (0, lib.SENSOR_NO_FORCE),
        (400, lib.SENSOR_STUCK),
        (630, lib.SENSOR_MAG_STUCK),  # its chip may wait for the magnetometer
    ],
)
def test_a_chip_that_never_gets_ready_is_stuck_in_bounded_time(from_ms, told):
    bench = Bench()
    bench.chip.fault("NO_DATA_READY", from_ns=from_ms * 1_000_000)
    assert bench.set_up() == told
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.kind == lib.SENSOR_MPU9250


# The end of set-up waits for a sample from 690 ms on.
@pytest.mark.parametrize("from_ms", [400, 685])
def test_a_chip_that_is_late_with_its_samples_is_waited_for(from_ms):
    bench = Bench()
    bench.chip.fault("NO_DATA_READY", from_ns=from_ms * 1_000_000, for_ns=40_000_000)
    assert bench.set_up() == lib.SENSOR_OK


def test_an_mpu_6500_that_never_gets_ready_is_stuck_too():
    bench = Bench(who_am_i=0x70, has_ak8963=False)
    bench.chip.fault("NO_DATA_READY", from_ns=630_000_000)
    assert bench.set_up() == lib.SENSOR_STUCK


def test_a_chip_whose_power_went_is_set_up_again():
    bench = running()
    bench.chip.call("power_cycle", bench.now_ns)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == HOST_JUDGES
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)
    assert bench.complaint is None
