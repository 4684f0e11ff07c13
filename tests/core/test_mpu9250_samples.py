# SPDX-License-Identifier: MIT
"""Samples of the MPU-9250: physical values in, counts out; readings that are none."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mpu9250_desk import MAG_LSB, Bench, ffi, lib, running

pytestmark = pytest.mark.sampled(3)


def axes(counts: Any) -> tuple[int, int, int]:
    return counts.x, counts.y, counts.z


@pytest.mark.parametrize("adjust", [(176, 178, 166), (128, 128, 128), (0, 100, 255)])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-1000.0, -45.0, 0.6, 48.0, 1200.0])
def test_field_arrives_in_the_frame_of_the_other_sensors(adjust, axis, value):
    bench = running(mag_adjust=list(adjust))
    mag = [0.0, 0.0, 0.0]
    mag[axis] = value
    bench.chip.hold(mag=tuple(mag))
    # A count of the chip, adjusted by 0.5 to 1.5, rounded twice.
    expected = [pytest.approx(component / MAG_LSB, abs=1.5) for component in mag]
    assert list(axes(bench.settled_mag())) == expected


@pytest.mark.parametrize("celsius", [-40.0, 0.0, 20.99, 21.0, 36.6, 85.0])
def test_temperature_arrives_in_hundredths_of_a_degree(celsius):
    bench = running()
    bench.chip.call("set_temperature", celsius)
    # One count of the chip is 0.3 of a unit.
    assert bench.settled().temperature_cdeg == pytest.approx(celsius * 100, abs=1)


@pytest.mark.parametrize("raw", [-32768, -32767, -4000, -1, 0, 1, 4000, 32767])
def test_temperature_is_right_to_the_ends_of_its_register(raw):
    # Rounding, and a tenth of a unit for the constant's 16 bits.
    exact = raw / 333.87 * 100 + 2100
    sample = running_once().parse(block(temperature=raw))
    assert sample.temperature_cdeg == pytest.approx(exact, abs=0.61)


def test_a_sample_carries_the_time_of_its_edge():
    bench = running(start_us=2**32 - 1_500_000)
    first, second = bench.sample(), bench.sample()
    assert (second.time_us - first.time_us) & 0xFFFFFFFF == pytest.approx(5000, abs=2)


def block(
    acc: tuple[int, int, int] = (0, 0, 2048),
    temperature: int = 1000,
    gyr: tuple[int, int, int] = (1, 2, 3),
    st1: int = 1,
    mag: tuple[int, int, int] = (10, 20, 30),
    st2: int = 0x10,
) -> bytes:
    """Return a burst, `mag` in the AK8963's own axes."""
    inertial = b"".join(
        value.to_bytes(2, "big", signed=True) for value in (*acc, temperature, *gyr)
    )
    field = b"".join(value.to_bytes(2, "little", signed=True) for value in mag)
    return inertial + bytes([st1]) + field + bytes([st2])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("count", "is_clipped"),
    [(-32768, True), (-32767, True), (-32766, False), (32766, False), (32767, True)],
)
def test_clipping_is_the_ends_of_the_range_of_any_axis(axis, count, is_clipped):
    values = [5, 6, 7]
    values[axis] = count
    bench = running()
    sample = bench.parse(block(acc=tuple(values)))
    assert (sample.acc_clipped, sample.gyr_clipped) == (is_clipped, False)
    sample = bench.parse(block(gyr=tuple(values)))
    assert (sample.acc_clipped, sample.gyr_clipped) == (False, is_clipped)
    assert axes(sample.gyr) == tuple(values)


@pytest.mark.parametrize("sign", [-1, 1])
def test_motion_beyond_the_ranges_is_clipped_and_said_so(sign):
    bench = running()
    bench.chip.hold(gyr=(0, sign * 40.0, 0), acc=(sign * 170.0, 0, 0))
    sample = bench.settled()
    assert sample.acc_clipped
    assert sample.gyr_clipped
    bench.chip.hold(gyr=(0, sign * 34.0, 0), acc=(sign * 150.0, 0, 0))
    sample = bench.settled()
    assert not sample.acc_clipped
    assert not sample.gyr_clipped


def test_a_field_beyond_the_range_is_an_overflow_and_no_reading():
    bench = running()
    bench.chip.hold(mag=(4000, 3000, 0))  # the sum of magnitudes is what counts
    samples = bench.samples(16)[8:]
    assert not any(sample.has_mag for sample in samples)
    assert 3 <= sum(sample.mag_overflow for sample in samples) <= 5
    bench.chip.hold(mag=(0, 20, -40))
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)


@pytest.mark.parametrize("value", [-32760, 32760])
def test_a_field_that_the_adjustment_takes_out_of_range_is_an_overflow(value):
    bench = running(mag_adjust=[128, 255, 129])
    assert bench.parse(block(mag=(value, 0, 0))).mag.y == value
    bench.parse(block(st1=0))
    sample = bench.parse(block(mag=(0, value, 0)))
    assert (sample.has_mag, sample.mag_overflow) == (False, True)
    bench.parse(block(st1=0))
    sample = bench.parse(block(mag=(0, 0, value)))  # by 1/256 only
    assert (sample.has_mag, sample.mag_overflow) == (False, True)


@pytest.mark.parametrize(
    ("raw", "adjusted"),
    [(-29127, None), (-29126, -32767), (29126, 32767), (29127, None)],
)
def test_the_last_count_within_range_is_a_reading(raw, adjusted):
    bench = running(mag_adjust=[160, 160, 160])  # 1.125
    sample = bench.parse(block(mag=(raw, 0, 0)))
    assert sample.has_mag == (adjusted is not None)
    assert sample.mag_overflow == (adjusted is None)
    if adjusted is not None:
        assert sample.mag.y == adjusted


@pytest.mark.parametrize("raw", [-200, -128, -127, -1, 1, 127, 128, 129, 200])
def test_the_adjustment_rounds_to_nearest(raw):
    bench = running(mag_adjust=[129, 129, 129])
    sample = bench.parse(block(mag=(raw, 0, 0)))
    assert sample.mag.y == math.floor(raw * 257 / 256 + 0.5)


@pytest.mark.parametrize("filler", [0x00, 0xFF])
def test_a_dead_bus_is_no_reading(filler):
    out = ffi.new("struct sample *", {"time_us": 12345})
    assert not lib.mpu9250_parse(running().driver, bytes([filler] * 22), 0, out)
    assert out.time_us == 12345


@pytest.mark.parametrize("filler", [0x00, 0xFF])
@pytest.mark.parametrize("place", range(14))
def test_one_live_byte_is_a_reading(filler, place):
    data = bytearray([filler] * 14 + [0] * 8)
    data[place] ^= 0x01
    assert running_once().parse(bytes(data)).temperature_cdeg != (
        lib.SAMPLE_NO_TEMPERATURE
    )


@pytest.mark.parametrize(
    ("st1", "st2"),
    [
        (0x00, 0x10),  # not ready
        (0x02, 0x10),  # overrun, yet not ready
        (0x05, 0x10),  # bits that are always 0
        (0x81, 0x10),
        (0xFF, 0x10),
        (0x01, 0x00),  # 14 bits: the die has been reset
        (0x01, 0x11),
        (0x01, 0x50),
        (0x01, 0xFF),
    ],
)
def test_a_block_with_a_status_that_cannot_be_is_no_reading(st1, st2):
    sample = running_once().parse(block(st1=st1, st2=st2))
    assert not sample.has_mag
    assert not sample.mag_overflow


@pytest.mark.parametrize("raw", [-32768, -32761, 32761, 32767])
def test_counts_that_the_magnetometer_does_not_have_are_no_reading(raw):
    bench = running_once()
    assert not bench.parse(block(mag=(raw, 0, 0))).has_mag
    assert not bench.parse(block(mag=(1, 0, raw))).has_mag


def test_each_measurement_of_the_field_arrives_once():
    bench = running()
    samples = bench.samples(200)
    fresh = [sample.has_mag for sample in samples]
    assert sum(fresh) == pytest.approx(100, abs=1)
    assert not any(one and two for one, two in itertools.pairwise(fresh))


@pytest.mark.parametrize("ppm", [-50_000, -1000, 0, 1000, 50_000])
def test_clocks_that_differ_double_nothing_and_lose_little(ppm):
    bench = running(mag_rate_error_ppm=ppm)
    fields = []
    for turn in range(2000):
        # No two measurements are equal; more than the field that was held before.
        bench.chip.hold(mag=(0, 21 + 0.5 * turn, 0))
        sample = bench.sample()
        if sample.has_mag:
            fields.append(sample.mag.y)
    assert all(one < two for one, two in itertools.pairwise(fields))
    # AK8963, 6.4.3.4: a measurement that ends during a read is skipped. Reading
    # takes 0.2 ms of the 5 ms between samples.
    measured = 10 * 100 * (1 + ppm * 1e-6)
    assert 0.94 * measured <= len(fields) <= measured + 1


@pytest.mark.parametrize("at", range(0, 10_000, 500))
def test_measurements_stay_clear_of_reads_whenever_set_up_begins(at):
    bench = Bench()
    bench.now_ns = at * 1000
    assert bench.set_up() == lib.SENSOR_OK
    bench.now_ns += at * 700
    assert bench.set_up() == lib.SENSOR_OK
    assert sum(sample.has_mag for sample in bench.samples(40)) == pytest.approx(
        20, abs=1
    )


def test_a_block_that_stands_still_counts_once():
    bench = running_once()
    bench.parse(block(st1=0))
    assert bench.parse(block()).has_mag
    assert not any(bench.parse(block()).has_mag for _ in range(5))
    assert bench.parse(block(mag=(11, 20, 30))).has_mag


def test_the_same_field_measured_twice_counts_twice():
    bench = running_once()
    for _ in range(3):
        bench.parse(block(st1=0))
        assert bench.parse(block()).has_mag


@given(st.binary(min_size=22, max_size=22))
def test_whatever_the_bytes_nothing_impossible_comes_out(data):
    driver = running_once().driver
    sample = ffi.new("struct sample *")
    if not lib.mpu9250_parse(driver, data, 0, sample):
        assert set(data[:14]) in ({0x00}, {0xFF})
        return
    assert -32768 not in axes(sample.mag)
    assert not (sample.has_mag and sample.mag_overflow)
    if sample.has_mag:
        assert data[14] & 1
    else:
        assert axes(sample.mag) == (0, 0, 0) or sample.mag_overflow
    assert -7714 <= sample.temperature_cdeg <= 11914


_SHARED: list[Bench] = []


def running_once() -> Bench:
    """Return one chip, set up, for tests that only parse."""
    if not _SHARED:
        _SHARED.append(running(mag_adjust=[128, 128, 128]))
    bench = _SHARED[0]
    bench.parse(block(st1=0))
    return bench
