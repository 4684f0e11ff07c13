# SPDX-License-Identifier: MIT
"""The MPU-9250's driver against the chip's model: physical values in, samples out, and
every way in which chip or wire can fail."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import chips

ffi, lib = chips.load("mpu9250")

G = 9.80665
DEGREE = math.pi / 180
ACC_LSB = 16 * G / 32768
GYR_LSB = 2000 * DEGREE / 32768
MAG_LSB = 0.15

STEP_US = 1000  # between two calls of set-up
SETUP_MAX_US = 1_500_000  # what set-up takes in the worst case, refusals included

ACC_PASSED, GYR_PASSED, MAG_PASSED = (
    lib.SELF_TEST_ACC_PASSED,
    lib.SELF_TEST_GYR_PASSED,
    lib.SELF_TEST_MAG_PASSED,
)
ALL_PASSED = ACC_PASSED | GYR_PASSED | MAG_PASSED


class Bench:
    """A driver and its chip on a desk: one clock, one wire that can be pulled."""

    def __init__(
        self, start_us: int = 0, read: Any = None, write: Any = None, **config: Any
    ) -> None:
        settings = lib.mpu9250_chip_defaults()
        for name, value in config.items():
            setattr(settings, name, value)
        self.chip = ffi.gc(
            lib.mpu9250_chip_new(ffi.new("struct mpu9250_chip_config *", settings)),
            lib.mpu9250_chip_free,
        )
        self.now_ns = 0
        self.start_us = start_us
        self.transactions = 0
        self.pulled_at: int | None = None
        self.longest_step_ns = 0
        self.log: list[tuple[float, str, int]] = []  # ms, "read" or "write", register
        self._read = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, uint8_t *, uint8_t)",
            read or self._read_chip,
        )
        self._write = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, const uint8_t *, uint8_t)",
            write or self._write_chip,
        )
        self.bus = ffi.new(
            "struct bus_device *", {"read": self._read, "write": self._write}
        )
        self.driver = ffi.new("struct mpu9250 *")
        self._bursts = ffi.new("struct bus_burst[]", lib.SENSOR_BURSTS_MAX)

    def _pulled(self) -> bool:
        self.transactions += 1
        return self.transactions == self.pulled_at

    def _read_chip(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.log.append((self.now_ns / 1e6, "read", reg))
        return self._transfer(lib.i2c_slave_read_registers, address, reg, data, length)

    def _write_chip(
        self, _: Any, address: int, reg: int, data: Any, length: int
    ) -> int:
        self.log.append((self.now_ns / 1e6, "write", reg))
        return self._transfer(lib.i2c_slave_write_registers, address, reg, data, length)

    def _transfer(
        self, move: Callable[..., int], address: int, reg: int, data: Any, length: int
    ) -> int:
        if self._pulled():
            return int(lib.BUS_NACK)
        now = ffi.new("uint64_t *", self.now_ns)
        wire = lib.mpu9250_chip_wire(self.chip)
        result = move(wire, now, address, reg, data, length)
        self.now_ns = now[0]
        return {0: lib.BUS_OK, -1: lib.BUS_NACK, -3: lib.BUS_STUCK}[result]

    @property
    def now_us(self) -> int:
        return (self.now_ns // 1000 + self.start_us) & 0xFFFFFFFF

    def step(self) -> int:
        before = self.now_ns
        result = lib.mpu9250_setup(self.driver, self.bus, self.now_us)
        self.longest_step_ns = max(self.longest_step_ns, self.now_ns - before)
        return int(result)

    def set_up(self, step_us: int = STEP_US, bound_us: int = SETUP_MAX_US) -> int:
        """Begin, step until it is decided, return how."""
        lib.mpu9250_begin(self.driver)
        deadline_ns = self.now_ns + bound_us * 1000
        while True:
            result = self.step()
            if result != lib.SENSOR_BUSY:
                return result
            assert self.now_ns < deadline_ns, "set-up has no bound"
            self.now_ns += step_us * 1000
            lib.mpu9250_chip_advance(self.chip, self.now_ns)

    def hold(
        self,
        gyr: tuple[float, float, float] = (0, 0, 0),
        acc: tuple[float, float, float] = (0, 0, G),
        mag: tuple[float, float, float] = (0, 20, -40),
    ) -> None:
        lib.mpu9250_chip_hold(self.chip, gyr, acc, mag)

    def fault(self, kind: int, **fields: Any) -> None:
        fault = ffi.new("struct chip_fault *", {"kind": kind, **fields})
        assert lib.i2c_slave_add_fault(lib.mpu9250_chip_wire(self.chip), fault)

    def next_edge(self) -> None:
        """Let time pass to the next rising edge of INT."""
        was_high = lib.mpu9250_chip_int_is_high(self.chip)
        deadline_ns = self.now_ns + 20_000_000
        while True:
            event_ns = lib.mpu9250_chip_next_event(self.chip)
            assert event_ns <= deadline_ns, "no data-ready within 20 ms"
            self.now_ns = max(self.now_ns, event_ns)
            lib.mpu9250_chip_advance(self.chip, self.now_ns)
            is_high = lib.mpu9250_chip_int_is_high(self.chip)
            if is_high and not was_high:
                return
            was_high = is_high

    def sample(self) -> Any:
        """Take the burst that the next data-ready edge starts."""
        self.next_edge()
        time_us = self.now_us
        burst = self.burst
        data = ffi.new("uint8_t[]", burst.length)
        result = self._read_chip(None, burst.address, burst.reg, data, burst.length)
        assert result == lib.BUS_OK
        return self.parse(bytes(data), time_us)

    @property
    def burst(self) -> Any:
        assert lib.mpu9250_bursts(self.driver, self._bursts) == 1
        return self._bursts[0]

    def parse(self, data: bytes, time_us: int = 0) -> Any:
        out = ffi.new("struct sample *")
        assert lib.mpu9250_parse(self.driver, data, time_us, out)
        return out

    def samples(self, count: int) -> list[Any]:
        return [self.sample() for _ in range(count)]

    def settled(self) -> Any:
        """Return the last of enough samples for all filters to forget the past."""
        return self.samples(12)[-1]

    def settled_mag(self) -> Any:
        return [sample for sample in self.samples(16) if sample.has_mag][-1].mag

    @property
    def identity(self) -> Any:
        return lib.mpu9250_identity(self.driver)

    @property
    def complaint(self) -> str | None:
        said = lib.mpu9250_chip_complaint(self.chip)
        return ffi.string(said).decode() if said != ffi.NULL else None

    def register(self, reg: int) -> int:
        return int(lib.mpu9250_chip_peek(self.chip, reg))

    def mag_register(self, reg: int) -> int:
        return int(lib.mpu9250_chip_peek_ak8963(self.chip, reg))


def running(**config: Any) -> Bench:
    bench = Bench(**config)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


def axes(counts: Any) -> tuple[int, int, int]:
    return counts.x, counts.y, counts.z


# Set-up.


def test_set_up_leaves_the_chip_as_the_documents_want_it():
    bench = running()
    assert bench.complaint is None
    # Register map, by number: rate divider, filters, ranges.
    assert [bench.register(reg) for reg in range(25, 30)] == [4, 2, 0x18, 0x18, 2]
    assert bench.register(36) == 0x4D  # wait for external sensors, 400 kHz
    assert [bench.register(reg) for reg in (37, 38, 39)] == [0x8C, 0x02, 0x88]
    assert bench.register(55) == 0x00  # INT: pulse, push-pull, active high
    assert bench.register(56) == 0x01  # data-ready
    assert bench.register(106) == 0x20  # the I2C master is on
    assert bench.register(107) == 0x01  # awake, clock by the gyroscope
    assert bench.mag_register(0x0A) == 0x16  # 100 Hz, 16 bits
    assert bench.mag_register(0x0C) == 0x00  # no self-test field


def test_identity_tells_chip_units_and_verdict():
    identity = running(mag_adjust=[170, 180, 160]).identity
    assert identity.kind == lib.SENSOR_MPU9250
    assert list(identity.who_am_i) == [0x71, 0x48]
    assert list(identity.mag_adjust) == [170, 180, 160]
    assert identity.self_test == ALL_PASSED
    assert identity.rate_hz == 200
    assert identity.gyr_lsb_nrad_s == round(GYR_LSB * 1e9)
    assert identity.acc_lsb_nm_s2 == round(ACC_LSB * 1e9)
    assert identity.mag_lsb_pt == round(MAG_LSB * 1e6)


def test_a_burst_is_one_read_of_all_sensors():
    burst = running().burst
    assert (burst.address, burst.reg, burst.length) == (0x68, 0x3B, 22)


def test_no_step_of_set_up_holds_the_bus_for_more_than_half_a_millisecond():
    bench = running()
    assert 0 < bench.longest_step_ns <= 500_000


def test_set_up_waits_as_long_as_the_documents_want():
    bench = Bench()
    assert bench.set_up(100) == lib.SENSOR_OK
    log = bench.log
    resets, wakes = (
        [t for t, *what in log if what == ["write", 107]][i] for i in (0, 1)
    )
    identified = next(t for t, *what in log if what == ["read", 117])
    assert resets >= 100  # after power: the start-up of the registers
    assert identified - resets >= 100
    reads = [t for t, *what in log if what == ["read", 59]]
    assert len(reads) == 400
    assert reads[0] - wakes >= 35  # the gyroscope's start-up
    # Each run of the self-test: 20 ms after its stimulus, 200 samples at 1 kHz.
    changes = [t for t, *what in log if what == ["write", 25]]
    for run, changed in zip((reads[:200], reads[200:]), changes, strict=False):
        assert run[0] - changed >= 20
        assert all(0.9 < b - a < 1.2 for a, b in itertools.pairwise(run))


def test_set_up_takes_as_long_as_its_header_says():
    bench = running()
    assert bench.now_ns / 1e9 == pytest.approx(0.9, abs=0.15)
    before_ns = bench.now_ns
    assert bench.set_up() == lib.SENSOR_OK
    assert (bench.now_ns - before_ns) / 1e9 == pytest.approx(0.4, abs=0.1)
    assert bench.identity.self_test == ALL_PASSED


@pytest.mark.parametrize("step_us", [50, 700, 4999, 30_000])
def test_set_up_does_not_mind_how_often_it_is_called(step_us):
    bench = Bench()
    # A sample of the self-test a call, at most: a slow caller takes that much longer.
    bound_us = SETUP_MAX_US + 500 * step_us
    assert bench.set_up(step_us, bound_us) == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED
    assert bench.complaint is None


@pytest.mark.parametrize("before_us", [1, 100_000, 150_000, 300_000, 600_000, 700_000])
def test_set_up_survives_the_wrap_of_device_time(before_us):
    assert running(start_us=2**32 - before_us).identity.self_test == ALL_PASSED


def test_set_up_stays_done_when_device_time_wraps():
    bench = running()
    done_ns = bench.now_ns
    for later_us in (0, 2**32 - 1000, 2**32, 2**32 + 1000):
        now_us = (done_ns // 1000 + later_us) & 0xFFFFFFFF
        assert lib.mpu9250_setup(bench.driver, bench.bus, now_us) == lib.SENSOR_OK


@pytest.mark.parametrize("who", [0x00, 0x12, 0x68, 0x72, 0xEA, 0xFF])
def test_a_chip_of_another_kind_is_refused_and_named(who):
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_WRONG_WHO_AM_I, value=who)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert bench.identity.who_am_i[0] == who


def test_an_mpu_9255_is_an_mpu_9250():
    bench = running(who_am_i=0x73)
    assert bench.identity.kind == lib.SENSOR_MPU9250
    assert list(bench.identity.who_am_i) == [0x73, 0x48]
    assert bench.settled_mag().x == round(0 / MAG_LSB)


def assert_six_axes(bench: Bench) -> None:
    assert bench.identity.who_am_i[1] == 0
    assert list(bench.identity.mag_adjust) == [0, 0, 0]
    assert bench.identity.self_test == ACC_PASSED | GYR_PASSED
    assert bench.burst.length == 14
    bench.hold(gyr=(1, 0, 0))
    samples = bench.samples(20)
    assert not any(sample.has_mag or sample.mag_overflow for sample in samples)
    assert samples[-1].gyr.x == pytest.approx(1 / GYR_LSB, abs=1)
    assert samples[-1].acc.z == pytest.approx(G / ACC_LSB, abs=1)
    assert bench.complaint is None


def test_an_mpu_6500_is_a_six_axis_probe():
    bench = running(who_am_i=0x70, has_ak8963=False)
    assert bench.identity.kind == lib.SENSOR_MPU6500
    assert_six_axes(bench)


def test_a_counterfeit_without_magnetometer_is_a_six_axis_probe():
    bench = running(has_ak8963=False)
    assert bench.identity.kind == lib.SENSOR_MPU9250
    assert_six_axes(bench)
    assert bench.register(106) == 0x00  # no master that asks in vain at each sample


def test_a_magnetometer_that_comes_back_is_found_by_the_next_set_up():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_NO_MAG)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0
    lib.i2c_slave_clear_faults(lib.mpu9250_chip_wire(bench.chip))
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x71, 0x48]
    assert bench.identity.self_test == ALL_PASSED


# Physical values.


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-150.0, -G, 0.03, 1.0, 156.0])
def test_acceleration_arrives_on_its_axis(axis, value):
    bench = running()
    acc = [0.0, 0.0, 0.0]
    acc[axis] = value
    bench.hold(acc=tuple(acc))
    expected = [pytest.approx(component / ACC_LSB, abs=1) for component in acc]
    assert list(axes(bench.settled().acc)) == expected


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-34.8, -1.0, 0.002, 10.0, 34.8])
def test_rate_arrives_on_its_axis(axis, value):
    bench = running()
    gyr = [0.0, 0.0, 0.0]
    gyr[axis] = value
    bench.hold(gyr=tuple(gyr))
    expected = [pytest.approx(component / GYR_LSB, abs=1) for component in gyr]
    assert list(axes(bench.settled().gyr)) == expected


@pytest.mark.parametrize("adjust", [(176, 178, 166), (128, 128, 128), (0, 100, 255)])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-1000.0, -45.0, 0.6, 48.0, 1200.0])
def test_field_arrives_in_the_frame_of_the_other_sensors(adjust, axis, value):
    bench = running(mag_adjust=list(adjust))
    mag = [0.0, 0.0, 0.0]
    mag[axis] = value
    bench.hold(mag=tuple(mag))
    # A count of the chip, adjusted by 0.5 to 1.5, rounded twice.
    expected = [pytest.approx(component / MAG_LSB, abs=1.5) for component in mag]
    assert list(axes(bench.settled_mag())) == expected


@pytest.mark.parametrize("celsius", [-40.0, 0.0, 20.99, 21.0, 36.6, 85.0])
def test_temperature_arrives_in_hundredths_of_a_degree(celsius):
    bench = running()
    lib.mpu9250_chip_set_temperature(bench.chip, celsius)
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


# Ends of the range, and readings that are none.


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
    bench.hold(gyr=(0, sign * 40.0, 0), acc=(sign * 170.0, 0, 0))
    sample = bench.settled()
    assert sample.acc_clipped
    assert sample.gyr_clipped
    bench.hold(gyr=(0, sign * 34.0, 0), acc=(sign * 150.0, 0, 0))
    sample = bench.settled()
    assert not sample.acc_clipped
    assert not sample.gyr_clipped


def test_a_field_beyond_the_range_is_an_overflow_and_no_reading():
    bench = running()
    bench.hold(mag=(4000, 3000, 0))  # the sum of magnitudes is what counts
    samples = bench.samples(16)[8:]
    assert not any(sample.has_mag for sample in samples)
    assert 3 <= sum(sample.mag_overflow for sample in samples) <= 5
    bench.hold(mag=(0, 20, -40))
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


# Old readings are not passed on as new ones.


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
        bench.hold(mag=(0, 0.5 * turn, 0))  # so that no two measurements are equal
        sample = bench.sample()
        if sample.has_mag:
            fields.append(sample.mag.y)
    assert all(one < two for one, two in itertools.pairwise(fields))
    # AK8963, 6.4.3.4: a measurement that ends while a read goes on is skipped. Reading
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


# The chip's own verdict.


def test_a_weak_gyroscope_fails_its_self_test():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ACC_PASSED | lib.SELF_TEST_GYR_FAILED | (
        MAG_PASSED
    )


def test_a_weak_accelerometer_fails_its_self_test():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == lib.SELF_TEST_ACC_FAILED | GYR_PASSED | (
        MAG_PASSED
    )


@pytest.mark.parametrize(("rate_dps", "passes"), [(19.9, True), (-20.1, False)])
def test_a_gyroscope_that_rests_beyond_20_deg_s_fails(rate_dps, passes):
    bench = Bench()
    bench.hold(gyr=(0, 0, rate_dps * DEGREE))
    assert bench.set_up() == lib.SENSOR_OK
    verdict = bench.identity.self_test & (GYR_PASSED | lib.SELF_TEST_GYR_FAILED)
    assert verdict == (GYR_PASSED if passes else lib.SELF_TEST_GYR_FAILED)


def set_up_in_motion(bench: Bench) -> int:
    """Set up in a hand that turns by 60 deg/s and shakes by 3 m/s2."""
    lib.mpu9250_begin(bench.driver)
    while (result := bench.step()) == lib.SENSOR_BUSY:
        angle = bench.now_ns * 1e-9 * 2 * math.pi * 1.5
        rate = 60 * DEGREE * math.sin(angle)
        bench.hold(gyr=(rate, -rate / 2, 0), acc=(3 * math.cos(angle), 0, G))
        bench.now_ns += STEP_US * 1000
        lib.mpu9250_chip_advance(bench.chip, bench.now_ns)
    return int(result)


def test_a_self_test_that_motion_spoils_is_no_verdict():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert set_up_in_motion(bench) == lib.SENSOR_OK
    assert bench.identity.self_test == MAG_PASSED


def test_a_self_test_without_verdict_is_run_again_by_the_next_set_up():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_GYR_SELF_TEST)
    bench.fault(lib.CHIP_FAULT_ACC_SELF_TEST)
    assert set_up_in_motion(bench) == lib.SENSOR_OK
    lib.i2c_slave_clear_faults(lib.mpu9250_chip_wire(bench.chip))
    bench.hold()
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED


class Scripted:
    """A chip that answers the self-test just as it is told, and little else."""

    def __init__(self) -> None:
        self.response = [0] * 6  # counts that the stimulus adds; acc, gyr
        self.rest = [0] * 6
        self.codes = [0] * 6
        self.noise = 0  # added to one gyroscope axis at every other read
        self.mag_test: tuple[int, int, int] | None = (0, 0, -2000)
        self.mag_id = 0x48
        self.refusals = 0  # transfers that the AK8963 does not acknowledge
        self.is_master_dead = False
        self.registers = bytearray(128)
        self.mag_registers = bytearray(32)
        self.reads = 0
        self.mag_registers[0x10:0x13] = b"\x80\x80\x80"

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        assert address == 0x68
        self.reads += 1
        if reg == 0x3B:
            is_on = self.registers[0x1B] == 0xE0
            values = [
                rest + (added if is_on else 0)
                for rest, added in zip(self.rest, self.response, strict=True)
            ]
            values[4] += self.noise if self.reads % 2 else 0
            values.insert(3, 0)
            made = b"".join(value.to_bytes(2, "big", signed=True) for value in values)
        elif reg == 0x75:
            made = b"\x71"
        elif reg == 0x00:
            made = bytes(self.codes[3:])
        elif reg == 0x0D:
            made = bytes(self.codes[:3])
        elif reg == 0x36:
            made = bytes([0 if self.is_master_dead else self._transfer()])
        else:
            made = bytes(self.registers[reg : reg + length])
        ffi.memmove(data, made, length)
        return int(lib.BUS_OK)

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        assert address == 0x68
        self.registers[reg : reg + length] = bytes(ffi.buffer(data, length))
        self.registers[0x3A] = self.registers[0x38]  # ready as soon as enabled
        return int(lib.BUS_OK)

    def _transfer(self) -> int:
        address, reg, value = self.registers[0x31:0x34]
        assert address & 0x7F == 0x0C
        if self.refusals:
            self.refusals -= 1
            return 0x10
        self.mag_registers[0x00] = self.mag_id
        if not address & 0x80:
            self.mag_registers[reg] = value
            if reg == 0x0A and value == 0x18 and self.mag_test is not None:
                assert self.mag_registers[0x0C] == 0x40, "the field is not on"
                self.mag_registers[0x02] = 0x01
                for axis, count in enumerate(self.mag_test):
                    place = slice(3 + 2 * axis, 5 + 2 * axis)
                    self.mag_registers[place] = count.to_bytes(2, "little", signed=True)
        self.registers[0x35] = self.mag_registers[reg]
        return 0x40


def scripted(**settings: Any) -> Bench:
    chip = Scripted()
    for name, value in settings.items():
        setattr(chip, name, value)
    return Bench(read=chip.read, write=chip.write)


def verdict_of(**settings: Any) -> int:
    bench = scripted(**settings)
    assert bench.set_up() == lib.SENSOR_OK
    return int(bench.identity.self_test)


def factory_response(code: int) -> float:
    return 2620 * 1.01 ** (code - 1)


@pytest.mark.parametrize("code", [1, 2, 3, 64, 127, 128, 129, 200, 235])
def test_self_test_limits_follow_the_factory_code(code):
    trim = factory_response(code)

    def verdict(acc: float, gyr: float) -> int:
        # The last axis is near its limit, the others in the middle.
        response = [round(value) for value in (trim, trim, acc, trim, trim, gyr)]
        return verdict_of(response=response, codes=[code] * 6) & ~MAG_PASSED

    # The driver's trim is rounded: its limits may be a count off.
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict(trim / 2 + 1, trim / 2 + 1) == ACC_PASSED | GYR_PASSED
    assert verdict(trim / 2 - 1, trim / 2 - 1) == failed
    assert verdict(-trim, -trim) == failed
    if trim * 1.5 < 32766:
        assert verdict(trim * 1.5 - 1, 32767) == ACC_PASSED | GYR_PASSED
        assert verdict(trim * 1.5 + 1, 32767) == lib.SELF_TEST_ACC_FAILED | GYR_PASSED


@pytest.mark.parametrize("sign", [-1, 1])
def test_without_factory_codes_fixed_limits_hold(sign):
    # 225 to 675 mg at 16384 a g, 60 deg/s at 131 a deg/s; 200 counts are summed.
    def verdict(acc: int, gyr: int) -> int:
        response = [sign * acc] * 3 + [sign * gyr] * 3
        return verdict_of(response=response, codes=[0] * 6) & ~MAG_PASSED

    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict(3687, 7860) == ACC_PASSED | GYR_PASSED
    assert verdict(11059, 32767) == ACC_PASSED | GYR_PASSED
    assert verdict(3685, 7859) == failed
    assert verdict(11060, 7859) == failed


def test_the_largest_readings_do_not_overflow_the_self_test():
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    for rest, response in ((32767, -65535), (-32768, 65535)):
        verdict = verdict_of(rest=[rest] * 6, response=[response] * 6, codes=[255] * 6)
        assert verdict & ~MAG_PASSED & ~ACC_PASSED in (
            failed,
            lib.SELF_TEST_GYR_FAILED,
        )


@pytest.mark.parametrize(
    ("noise", "moves"), [(327, False), (328, True), (-30000, True)]
)
def test_motion_is_a_rate_that_strays_by_two_and_a_half_deg_s(noise, moves):
    verdict = verdict_of(codes=[100] * 6, noise=noise)  # no response: fails
    failed = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict & ~MAG_PASSED == (0 if moves else failed)


@pytest.mark.parametrize(
    ("field", "passes"),
    [
        ((0, 0, -2000), True),
        ((200, -200, -800), True),
        ((-200, 200, -3200), True),
        ((201, 0, -2000), False),
        ((0, -201, -2000), False),
        ((0, 0, -799), False),
        ((0, 0, -3201), False),
        ((0, 0, 2000), False),
        (None, False),  # no data-ready ever
    ],
)
def test_the_magnetometer_is_judged_by_its_data_sheet(field, passes):
    mag = MAG_PASSED if passes else lib.SELF_TEST_MAG_FAILED
    inertial = lib.SELF_TEST_ACC_FAILED | lib.SELF_TEST_GYR_FAILED
    assert verdict_of(mag_test=field, codes=[100] * 6) == mag | inertial


def test_a_magnetometer_that_fails_is_still_read():
    bench = scripted(mag_test=None)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0x48
    assert bench.burst.length == 22


@pytest.mark.parametrize("mag_id", [0x00, 0x47, 0x49, 0xFF])
def test_another_chip_at_the_magnetometers_address_is_not_used(mag_id):
    bench = scripted(mag_id=mag_id)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0
    assert bench.burst.length == 14


@pytest.mark.parametrize(("refusals", "is_found"), [(1, True), (49, True), (50, False)])
def test_a_magnetometer_may_refuse_for_a_while(refusals, is_found):
    bench = scripted(refusals=refusals)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == (0x48 if is_found else 0)


# The wire and the chip fail.


def count_of_transactions() -> int:
    return running().transactions


@pytest.mark.parametrize("part", range(8))
def test_a_wire_pulled_at_any_transaction_is_reported_and_the_next_set_up_works(part):
    count = count_of_transactions()
    assert count > 400
    for pulled_at in range(1 + part, count + 1, 8):
        bench = Bench()
        bench.pulled_at = pulled_at
        assert bench.set_up() == lib.SENSOR_BUS_FAILED
        assert bench.transactions == pulled_at
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert bench.identity.self_test == ALL_PASSED
        assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)
        assert bench.complaint is None


@pytest.mark.parametrize("at_byte", [0, 1, 2, 5])
def test_a_refused_byte_is_a_failed_bus(at_byte):
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_NACK, first=30, transactions=1_000_000, at_byte=at_byte)
    assert bench.set_up() == lib.SENSOR_BUS_FAILED


def test_a_held_data_line_is_a_failed_bus():
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_STUCK_SDA, from_ns=400_000_000)
    assert bench.set_up() == lib.SENSOR_BUS_FAILED


@pytest.mark.parametrize("from_ms", [0, 300, 500, 750])
def test_a_chip_that_never_gets_ready_is_stuck_in_bounded_time(from_ms):
    bench = Bench()
    bench.fault(lib.CHIP_FAULT_NO_DATA_READY, from_ns=from_ms * 1_000_000)
    assert bench.set_up() == lib.SENSOR_STUCK
    lib.i2c_slave_clear_faults(lib.mpu9250_chip_wire(bench.chip))
    assert bench.set_up() == lib.SENSOR_OK


def test_an_mpu_6500_that_never_gets_ready_is_stuck_too():
    bench = Bench(who_am_i=0x70, has_ak8963=False)
    bench.fault(lib.CHIP_FAULT_NO_DATA_READY)
    assert bench.set_up() == lib.SENSOR_STUCK


def test_a_master_that_never_finishes_is_stuck():
    assert scripted(is_master_dead=True).set_up() == lib.SENSOR_STUCK


def test_a_chip_whose_power_went_is_set_up_again():
    bench = running()
    lib.mpu9250_chip_power_cycle(bench.chip, bench.now_ns)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ALL_PASSED
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)
    assert bench.complaint is None
