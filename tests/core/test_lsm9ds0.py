# SPDX-License-Identifier: MIT
"""The LSM9DS0's driver against a register file typed from the data sheet, then against
the chip's model: physical values in, samples out, and every way in which chip or wire
can fail."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import chips

ffi, lib = chips.load("lsm9ds0")

Triple = tuple[float, float, float]

STEP_US = 1000  # between two calls of set-up
SETUP_MAX_US = 1_500_000
BIT_US = 2.5  # 400 kHz

ACC_PASSED, GYR_PASSED = lib.SELF_TEST_ACC_PASSED, lib.SELF_TEST_GYR_PASSED
ACC_FAILED, GYR_FAILED = lib.SELF_TEST_ACC_FAILED, lib.SELF_TEST_GYR_FAILED
BOTH_PASSED = ACC_PASSED | GYR_PASSED

G, XM = "gyroscope", "accelerometer and magnetometer"

# Data sheet, table 3: counts.
DPS_LSB = {0x00: 0.00875, 0x10: 0.0175, 0x20: 0.070}  # CTRL_REG4_G, FS
G_LSB = {0x00: 0.061e-3, 0x08: 0.122e-3, 0x10: 0.183e-3, 0x18: 0.244e-3, 0x20: 0.732e-3}
GAUSS_LSB = {0x00: 0.08e-3, 0x20: 0.16e-3, 0x40: 0.32e-3, 0x60: 0.48e-3}
GYR_HZ = {0x00: 95, 0x40: 190, 0x80: 380, 0xC0: 760}  # CTRL_REG1_G, DR
ACC_HZ = {0x80: 400, 0x90: 800, 0xA0: 1600}  # CTRL_REG1_XM, AODR
MAG_HZ = {0x10: 50, 0x14: 100}  # CTRL_REG5_XM, M_ODR


class Sensor:
    """One of the three: a clock that measures, data that are ready and overwritten."""

    def __init__(self, status: int) -> None:
        self.status = status  # register; the axes follow
        self.hz = 0.0  # 0: off
        self.error = 1.0  # of its clock
        self.begun_us = 0.0
        self.seen = 0  # measurements when its data were last read
        self.value = (0, 0, 0)
        self.is_silent = False

    def run(self, hz: float, now_us: float) -> None:
        if hz != self.hz:
            self.hz, self.begun_us, self.seen = hz, now_us, 0

    def tune(self, error: float, now_us: float) -> None:
        self.error, self.begun_us, self.seen = error, now_us, 0

    def made(self, now_us: float) -> int:
        if self.is_silent or self.hz == 0:
            return 0
        return int((now_us - self.begun_us) * self.hz * self.error / 1e6 + 1e-6)

    def next_us(self) -> float:
        return self.begun_us + (self.seen + 1) * 1e6 / (self.hz * self.error)

    def registers(self, now_us: float) -> bytes:
        waiting = self.made(now_us) - self.seen
        status = (0x0F if waiting > 0 else 0) | (0xF0 if waiting > 1 else 0)
        return bytes([status]) + b"".join(
            max(-32768, min(32767, value)).to_bytes(2, "little", signed=True)
            for value in self.value
        )


class Chip:
    """Two register files on a bus, and what the world does to them."""

    def __init__(self, gyr_address: int = 0x6B, xm_address: int = 0x1D) -> None:
        self.halves = {gyr_address: G, xm_address: XM}
        self.files = {G: bytearray(0x40), XM: bytearray(0x40)}
        self.files[G][0x0F], self.files[G][0x20] = 0xD4, 0x07
        self.files[XM][0x0F], self.files[XM][0x20] = 0x49, 0x07
        self.files[XM][0x24:0x27] = bytes([0x18, 0x20, 0x03])
        self.gyr, self.acc, self.mag = Sensor(0x27), Sensor(0x27), Sensor(0x07)
        self.gyr_dps: Triple = (0, 0, 0)
        self.acc_g: Triple = (0, 0, 1)
        self.mag_gauss: Triple = (0.2, 0, -0.4)
        self.temperature = 0  # 12 bits, as read
        self.gyr_response: Triple = (400, -400, -400)  # deg/s, at ST 01
        self.acc_response: Triple = (0.3, 0.3, 0.3)  # g, at AST 01
        self.absent: set[str] = set()
        self.now_us = 0.0
        self.log: list[tuple[float, str, str, int, int]] = []

    def await_edge(self) -> None:
        """Let time pass to the next rising edge of DRDY_G."""
        self.now_us = max(self.now_us, self.gyr.next_us() + 1)

    def update(self) -> None:
        g, xm = self.files[G], self.files[XM]
        gyr_is_on = g[0x20] & 0x0F == 0x0F
        self.gyr.run(GYR_HZ[g[0x20] & 0xC0] if gyr_is_on else 0, self.now_us)
        acc_hz = ACC_HZ.get(xm[0x20] & 0xF0, 0) if xm[0x20] & 7 == 7 else 0
        self.acc.run(acc_hz, self.now_us)
        mag_hz = MAG_HZ.get(xm[0x24] & 0x1C, 0) if xm[0x26] & 0x03 == 0 else 0
        self.mag.run(mag_hz, self.now_us)
        is_tested = g[0x23] & 0x06 == 0x02
        self.gyr.value = counted(
            self.gyr_dps, self.gyr_response, is_tested, DPS_LSB[g[0x23] & 0x30]
        )
        is_tested = xm[0x21] & 0x06 == 0x02
        self.acc.value = counted(
            self.acc_g, self.acc_response, is_tested, G_LSB[xm[0x21] & 0x38]
        )
        lsb = GAUSS_LSB[xm[0x25] & 0x60]
        x, y, z = self.mag_gauss  # figure 1: its z is the others' turned round
        self.mag.value = counted((x, y, -z), (0, 0, 0), False, lsb)

    def transfer(self, what: str, address: int, reg: int, length: int) -> str | None:
        half = self.halves.get(address)
        self.log.append((self.now_us, what, half or "nobody", reg & 0x7F, length))
        # Address, sub-address, address once more where it reads; START and STOP.
        count = length + (3 if what == "read" else 2)
        self.now_us += (9 * count + 3) * BIT_US
        return None if half in self.absent else half

    def read(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        self.update()
        first = reg & 0x7F
        half = self.halves.get(address)
        sensors = {G: [self.gyr], XM: [self.acc, self.mag]}.get(half or "", [])
        image = bytearray(self.files[half]) if half else bytearray()
        for sensor in sensors:
            start = sensor.status
            image[start : start + 7] = sensor.registers(self.now_us)
        if half == XM and self.files[XM][0x24] & 0x80:
            image[0x05:0x07] = self.temperature.to_bytes(2, "little")
        if self.transfer("read", address, reg, length) is None:
            return int(lib.BUS_NACK)
        where = [first + i if reg & 0x80 else first for i in range(length)]
        ffi.memmove(data, bytes(image[at] for at in where), length)
        for sensor in sensors:
            if sensor.status + 6 in where:
                sensor.seen = sensor.made(self.now_us)
        return int(lib.BUS_OK)

    def write(self, _: Any, address: int, reg: int, data: Any, length: int) -> int:
        half = self.transfer("write", address, reg, length)
        if half is None:
            return int(lib.BUS_NACK)
        for i, value in enumerate(bytes(ffi.buffer(data, length))):
            at = (reg & 0x7F) + (i if reg & 0x80 else 0)
            assert at >= 0x12, f"{at:#x} is read only"
            self.files[half][at] = value
        self.update()
        return int(lib.BUS_OK)


def counted(
    value: Triple, response: Triple, is_tested: bool, lsb: float
) -> tuple[int, int, int]:
    sums = [v + r * is_tested for v, r in zip(value, response, strict=True)]
    x, y, z = (round(s / lsb) for s in sums)
    return x, y, z


class Model:
    """The model of sim/chips behind what a bench uses of a Chip."""

    def __init__(self, **config: Any) -> None:
        settings = lib.lsm9ds0_chip_defaults()
        for name, value in config.items():
            setattr(settings, name, value)
        self.c = ffi.gc(
            lib.lsm9ds0_chip_new(ffi.new("struct lsm9ds0_chip_config *", settings)),
            lib.lsm9ds0_chip_free,
        )
        self.halves = {0x6B: G, 0x1D: XM}
        self._now_ns = 0

    @property
    def now_us(self) -> float:
        return self._now_ns / 1000

    @now_us.setter
    def now_us(self, now_us: float) -> None:
        self._now_ns = round(now_us * 1000)
        lib.lsm9ds0_chip_advance(self.c, self._now_ns)

    def _move(
        self, transfer: Any, address: int, reg: int, data: Any, length: int
    ) -> int:
        now = ffi.new("uint64_t *", self._now_ns)
        wire = lib.lsm9ds0_chip_wire(self.c)
        result = transfer(wire, now, address, reg, data, length)
        self._now_ns = now[0]
        return {0: lib.BUS_OK, -1: lib.BUS_NACK, -3: lib.BUS_STUCK}[result]

    def read(self, _: Any, *transfer: Any) -> int:
        return self._move(lib.i2c_slave_read_registers, *transfer)

    def write(self, _: Any, *transfer: Any) -> int:
        return self._move(lib.i2c_slave_write_registers, *transfer)

    def await_edge(self) -> None:
        assert not self.is_ready, "the edge has been"
        deadline_ns = self._now_ns + 20_000_000
        while not self.is_ready:
            self._now_ns = lib.lsm9ds0_chip_next_event(self.c)
            assert self._now_ns <= deadline_ns, "no data-ready within 20 ms"
            lib.lsm9ds0_chip_advance(self.c, self._now_ns)

    @property
    def is_ready(self) -> bool:
        return bool(lib.lsm9ds0_chip_pin_is_high(self.c, lib.LSM9DS0_CHIP_DRDY_G))

    def hold(
        self,
        gyr: Triple = (0, 0, 0),
        acc: Triple = (0, 0, 9.80665),
        mag: Triple = (0, 20, -40),
    ) -> None:
        lib.lsm9ds0_chip_hold(self.c, gyr, acc, mag)

    def fault(self, kind: int, **fields: Any) -> None:
        fault = ffi.new("struct chip_fault *", {"kind": kind, **fields})
        assert lib.i2c_slave_add_fault(lib.lsm9ds0_chip_wire(self.c), fault)

    @property
    def complaint(self) -> str | None:
        said = lib.lsm9ds0_chip_complaint(self.c)
        return ffi.string(said).decode() if said != ffi.NULL else None


class Bench:
    """A driver and its chip on a desk: one clock, one wire that can be pulled."""

    def __init__(
        self,
        chip: Any = None,
        start_us: int = 0,
        *,
        is_fast: bool = False,
    ) -> None:
        self.chip = chip or Chip()
        self.start_us = start_us
        self.transactions = 0
        self.pulled_at: int | None = None
        self.longest_step_us = 0.0
        self._read = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, uint8_t *, uint8_t)",
            self._wired(self.chip.read),
        )
        self._write = ffi.callback(
            "enum bus_result(void *, uint8_t, uint8_t, const uint8_t *, uint8_t)",
            self._wired(self.chip.write),
        )
        self.bus = ffi.new(
            "struct bus_device *", {"read": self._read, "write": self._write}
        )
        gyr_address, xm_address = self.chip.halves
        config = {"gyr_address": gyr_address, "xm_address": xm_address}
        self.driver = ffi.new("struct lsm9ds0 *", {"config": config})
        self.driver.config.is_fast = is_fast
        self._bursts = ffi.new("struct bus_burst[]", lib.SENSOR_BURSTS_MAX)

    def _wired(self, move: Any) -> Any:
        def transfer(*arguments: Any) -> int:
            self.transactions += 1
            if self.transactions == self.pulled_at:
                return int(lib.BUS_NACK)
            return int(move(*arguments))

        return transfer

    @property
    def now_us(self) -> int:
        return (int(self.chip.now_us) + self.start_us) & 0xFFFFFFFF

    def step(self) -> int:
        before = self.chip.now_us
        result = lib.lsm9ds0_setup(self.driver, self.bus, self.now_us)
        self.longest_step_us = max(self.longest_step_us, self.chip.now_us - before)
        return int(result)

    def set_up(self, step_us: int = STEP_US, bound_us: int = SETUP_MAX_US) -> int:
        """Begin, step until it is decided, return how."""
        lib.lsm9ds0_begin(self.driver)
        deadline_us = self.chip.now_us + bound_us
        while (result := self.step()) == lib.SENSOR_BUSY:
            assert self.chip.now_us < deadline_us, "set-up has no bound"
            self.chip.now_us += step_us
        return result

    @property
    def bursts(self) -> list[tuple[int, int, int]]:
        count = lib.lsm9ds0_bursts(self.driver, self._bursts)
        return [(b.address, b.reg, b.length) for b in self._bursts[0:count]]

    def take(self) -> bytes:
        """Read the bursts that the next data-ready edge starts."""
        self.chip.await_edge()
        taken = b""
        for address, reg, length in self.bursts:
            data = ffi.new("uint8_t[]", length)
            assert self.chip.read(None, address, reg, data, length) == lib.BUS_OK
            taken += bytes(data)
        return taken

    def parse(self, data: bytes, time_us: int = 0) -> Any:
        out = ffi.new("struct sample *")
        assert lib.lsm9ds0_parse(self.driver, data, time_us, out)
        return out

    def is_refused(self, data: bytes) -> bool:
        out = ffi.new("struct sample *")
        ffi.memmove(out, b"\xa5" * ffi.sizeof(out[0]), ffi.sizeof(out[0]))
        if lib.lsm9ds0_parse(self.driver, data, 0, out):
            return False
        assert set(bytes(ffi.buffer(out))) == {0xA5}, "written all the same"
        return True

    def sample(self) -> Any:
        return self.parse(self.take())

    def samples(self, count: int) -> list[Any]:
        return [self.sample() for _ in range(count)]

    @property
    def identity(self) -> Any:
        return lib.lsm9ds0_identity(self.driver)


def running(chip: Any = None, *, is_fast: bool = False) -> Bench:
    bench = Bench(chip, is_fast=is_fast)
    assert bench.set_up() == lib.SENSOR_OK
    return bench


def axes(counts: Any) -> tuple[int, int, int]:
    return counts.x, counts.y, counts.z


# Set-up.


@pytest.mark.parametrize(
    ("is_fast", "gyr", "acc"), [(False, 0xBF, 0x9F), (True, 0xFF, 0xAF)]
)
def test_set_up_leaves_the_chip_as_the_document_wants_it(is_fast, gyr, acc):
    chip = running(is_fast=is_fast).chip
    g, xm = chip.files[G], chip.files[XM]
    # CTRL_REG1_G to 5: rate and low-pass of 100 Hz, all axes on; no high-pass; data-
    # ready on its pin; blocks updated whole, 2000 deg/s, no test; low-passed.
    assert list(g[0x20:0x25]) == [gyr, 0x00, 0x08, 0xA0, 0x02]
    # CTRL_REG0_XM to 7: no FIFO; 800 or 1600 Hz, whole blocks, all axes; 194 Hz, 16 g,
    # no test; no pins; temperature, high resolution, 100 Hz; 2 gauss; continuous.
    assert list(xm[0x1F:0x27]) == [0x00, acc, 0x60, 0x00, 0x00, 0xF4, 0x00, 0x00]


@pytest.mark.parametrize(("is_fast", "rate_hz"), [(False, 380), (True, 760)])
def test_identity_tells_chip_units_and_verdict(is_fast, rate_hz):
    identity = running(is_fast=is_fast).identity
    assert identity.kind == lib.SENSOR_LSM9DS0
    assert list(identity.who_am_i) == [0xD4, 0x49]
    assert list(identity.mag_adjust) == [0, 0, 0]
    assert identity.self_test == BOTH_PASSED
    assert identity.rate_hz == rate_hz
    # Two poles at 100 Hz.
    assert identity.gyr_delay_us == round(math.sqrt(2) / (2 * math.pi * 100) * 1e6)
    assert identity.gyr_lsb_nrad_s == round(math.radians(0.070) * 1e9)
    assert identity.acc_lsb_nm_s2 == round(0.732e-3 * 9.80665 * 1e9)
    assert identity.mag_lsb_pt == round(0.08e-3 * 1e-4 * 1e12)


@pytest.mark.parametrize(("gyr", "xm"), [(0x6B, 0x1D), (0x6A, 0x1E), (0x6B, 0x1E)])
def test_a_sample_is_three_bursts_of_the_halves_where_they_are_wired(gyr, xm):
    bench = running(Chip(gyr, xm))
    assert bench.bursts == [(gyr, 0xA7, 7), (xm, 0xA7, 7), (xm, 0x85, 9)]
    assert sum(length for *_, length in bench.bursts) <= lib.BUS_BURST_MAX
    assert axes(bench.sample().acc) == (0, 0, round(1 / 0.732e-3))


def test_no_step_of_set_up_holds_the_bus_for_more_than_half_a_millisecond():
    bench = running()
    assert 0 < bench.longest_step_us <= 550  # the bus' own pauses included


def test_set_up_waits_as_long_as_the_documents_want():
    bench = Bench()
    assert bench.set_up(100) == lib.SENSOR_OK
    log = bench.chip.log
    named = next(t for t, *what in log if what == ["read", G, 0x0F, 1])
    assert named >= 10_000  # after power
    boots = [
        t for t, *what in log if what in (["write", G, 0x24, 1], ["write", XM, 0x1F, 1])
    ]
    assert len(boots) == 2
    changes = [t for t, *what in log if what == ["write", G, 0x20, 5]]
    assert len(changes) == 4  # start, run without and with stimulus, samples
    assert changes[0] - boots[1] >= 10_000
    reads = [t for t, *what in log if what == ["read", G, 0x27, 7]][:-1]
    assert len(reads) == 64
    assert reads[0] - changes[0] >= 800_000  # the gyroscope's start
    for run, changed in zip((reads[:32], reads[32:]), changes[1:3], strict=True):
        assert run[0] - changed >= 60_000
        assert all(b - a > 1e6 / 760 for a, b in itertools.pairwise(run))


def test_set_up_takes_as_long_as_its_header_says():
    bench = running()
    assert bench.chip.now_us / 1e6 == pytest.approx(1.2, abs=0.1)
    before_us = bench.chip.now_us
    assert bench.set_up() == lib.SENSOR_OK
    assert (bench.chip.now_us - before_us) / 1e6 == pytest.approx(0.9, abs=0.1)
    assert bench.identity.self_test == BOTH_PASSED


@pytest.mark.parametrize("step_us", [50, 700, 4999, 30_000])
def test_set_up_does_not_mind_how_often_it_is_called(step_us):
    bench = Bench()
    assert bench.set_up(step_us, SETUP_MAX_US + 100 * step_us) == lib.SENSOR_OK
    assert bench.identity.self_test == BOTH_PASSED


@pytest.mark.parametrize("before_us", [1, 15_000, 500_000, 900_000, 1_100_000])
def test_set_up_survives_the_wrap_of_device_time(before_us):
    bench = Bench(start_us=2**32 - before_us)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == BOTH_PASSED


def test_set_up_stays_done():
    bench = running()
    for later_us in (0, 1000, 2**31, 2**32 - 1000):
        now_us = (bench.now_us + later_us) & 0xFFFFFFFF
        assert lib.lsm9ds0_setup(bench.driver, bench.bus, now_us) == lib.SENSOR_OK


def test_powered_down_nothing_measures_until_the_next_set_up():
    for chip in (Chip(), Model()):
        bench = Bench(chip)
        assert bench.set_up() == lib.SENSOR_OK
        assert lib.lsm9ds0_power_down(bench.driver, bench.bus)
        if isinstance(chip, Chip):
            assert (chip.gyr.hz, chip.acc.hz, chip.mag.hz) == (0, 0, 0)
        else:
            chip.now_us += 100_000
            assert lib.lsm9ds0_chip_next_event(chip.c) == 2**64 - 1
            assert chip.complaint is None
        assert bench.set_up() == lib.SENSOR_OK
        bench.samples(10)


def test_a_chip_that_does_not_answer_is_not_powered_down():
    bench = Bench()
    bench.set_up()
    for pulled in (1, 2, 3):
        bench.pulled_at = bench.transactions + pulled
        assert not lib.lsm9ds0_power_down(bench.driver, bench.bus)


@pytest.mark.parametrize("who", [0x00, 0x49, 0x68, 0xD3, 0xD5, 0xD7, 0xFF])
def test_a_gyroscope_of_another_kind_is_refused_and_named(who):
    bench = Bench()
    bench.chip.files[G][0x0F] = who
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.chip.log if what == "write"]


@pytest.mark.parametrize("who", [0x00, 0x41, 0x48, 0x4A, 0xD4, 0xFF])
def test_another_half_of_another_kind_is_refused_and_named(who):
    bench = Bench()
    bench.chip.files[XM][0x0F] = who
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.chip.log if what == "write"]


@pytest.mark.parametrize("half", [G, XM])
def test_a_half_that_does_not_answer_is_a_failed_bus_until_it_does(half):
    bench = Bench()
    bench.chip.absent = {half}
    assert bench.set_up() == lib.SENSOR_BUS_FAILED
    bench.chip.absent = set()
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]


def test_a_magnetometer_that_never_measures_leaves_six_axes_and_is_told():
    bench = Bench()
    bench.chip.mag.is_silent = True
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0]
    assert bench.identity.self_test == BOTH_PASSED | lib.SELF_TEST_MAG_FAILED
    bench.chip.mag.is_silent = False  # a loose joint: not to be trusted by halves
    samples = bench.samples(40)
    assert not any(sample.has_mag or sample.mag_overflow for sample in samples)
    assert axes(samples[-1].acc) == (0, 0, round(1 / 0.732e-3))
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]
    assert bench.identity.self_test == BOTH_PASSED


@pytest.mark.parametrize("name", ["gyr", "acc"])
def test_a_sensor_that_never_gets_ready_is_stuck_in_bounded_time(name):
    bench = Bench()
    sensor = getattr(bench.chip, name)
    sensor.is_silent = True
    assert bench.set_up() == lib.SENSOR_STUCK
    sensor.is_silent = False
    assert bench.set_up() == lib.SENSOR_OK


def test_a_wire_pulled_at_any_transaction_is_reported_and_the_next_set_up_works():
    count = running().transactions
    assert count > 100
    for pulled_at in range(1, count + 1):
        bench = Bench()
        bench.pulled_at = pulled_at
        assert bench.set_up() == lib.SENSOR_BUS_FAILED
        assert bench.transactions == pulled_at
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert bench.identity.self_test == BOTH_PASSED
        assert axes(bench.sample().acc) == (0, 0, round(1 / 0.732e-3))


def test_data_ready_is_low_where_set_up_ends_and_no_sample_is_missed():
    bench = running()
    chip = bench.chip
    assert chip.gyr.made(chip.now_us) == chip.gyr.seen
    assert not bench.sample().has_gap


# The chip's own verdict.


def verdict_of(**world: Triple) -> int:
    bench = Bench()
    for name, value in world.items():
        setattr(bench.chip, name, value)
    assert bench.set_up() == lib.SENSOR_OK
    return int(bench.identity.self_test)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("dps", "passes"), [(150.1, True), (149.9, False), (999.9, True), (1000.1, False)]
)
def test_the_gyroscope_is_judged_by_its_data_sheet(axis, sign, dps, passes):
    response = [400.0, -400.0, -400.0]
    response[axis] = sign * dps
    verdict = verdict_of(gyr_response=tuple(response))
    assert verdict == ACC_PASSED | (GYR_PASSED if passes else GYR_FAILED)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("mg", "passes"), [(60.1, True), (59.9, False), (1699.9, True), (1700.1, False)]
)
def test_the_accelerometer_is_judged_by_its_data_sheet(axis, mg, passes):
    response = [0.3, 0.3, 0.3]
    response[axis] = mg * 1e-3
    verdict = verdict_of(acc_response=tuple(response), acc_g=(0, 0, 0))
    assert verdict == GYR_PASSED | (ACC_PASSED if passes else ACC_FAILED)


def test_the_largest_readings_do_not_overflow_the_self_test():
    # From one end of the registers to the other: no response that could pass.
    rest, response = (-3000.0,) * 3, (6000.0,) * 3
    world = {"gyr_dps": rest, "gyr_response": response}
    assert verdict_of(**world) == ACC_PASSED | GYR_FAILED
    world = {"acc_g": (-9.0,) * 3, "acc_response": (18.0,) * 3}
    assert verdict_of(**world) == ACC_FAILED | GYR_PASSED


@pytest.mark.parametrize(
    ("strays_dps", "moves"), [(3.9, False), (4.1, True), (-900, True)]
)
def test_a_self_test_that_motion_spoils_is_no_verdict(strays_dps, moves):
    bench = Bench()
    bench.chip.gyr_response = bench.chip.acc_response = (0, 0, 0)
    lib.lsm9ds0_begin(bench.driver)
    turns = itertools.count()
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.chip.gyr_dps = (0, strays_dps * (next(turns) % 2), 0)
        bench.chip.now_us += STEP_US
    assert result == lib.SENSOR_OK
    assert bench.identity.self_test == (0 if moves else ACC_FAILED | GYR_FAILED)


def test_a_verdict_is_kept_and_a_missing_one_is_sought_by_the_next_set_up():
    bench = Bench()
    bench.chip.gyr_response = (0, 0, 0)
    assert bench.set_up() == lib.SENSOR_OK
    bench.chip.gyr_response = (400, -400, -400)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == ACC_PASSED | GYR_FAILED
    bench.driver.identity.self_test = 0  # as after motion
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == BOTH_PASSED


# Physical values, on the axes of gyroscope and accelerometer.


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-16.0, -1.0, 0.0037, 0.5, 16.0])
def test_acceleration_arrives_on_its_axis(axis, value):
    bench = running()
    acc = [0.0, 0.0, 0.0]
    acc[axis] = value
    bench.chip.acc_g = tuple(acc)
    sample = bench.sample()
    expected = [pytest.approx(v / 0.732e-3, abs=0.51) for v in acc]
    assert list(axes(sample.acc)) == expected


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-2000.0, -1.0, 0.1, 90.0, 2000.0])
def test_rate_arrives_on_its_axis(axis, value):
    bench = running()
    gyr = [0.0, 0.0, 0.0]
    gyr[axis] = value
    bench.chip.gyr_dps = tuple(gyr)
    expected = [pytest.approx(v / 0.070, abs=0.51) for v in gyr]
    assert list(axes(bench.sample().gyr)) == expected


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-2.0, -0.45, 0.0006, 0.48, 2.0])
def test_field_arrives_in_the_frame_of_the_other_sensors(axis, value):
    bench = running()
    mag = [0.0, 0.0, 0.0]
    mag[axis] = value
    bench.chip.mag_gauss = tuple(mag)
    found = [sample.mag for sample in bench.samples(8) if sample.has_mag][-1]
    assert list(axes(found)) == [pytest.approx(v / 0.08e-3, abs=0.51) for v in mag]


@pytest.mark.parametrize("raw", [-2048, -2047, -400, -1, 0, 1, 16, 400, 2047])
@pytest.mark.parametrize("above", [0x0000, 0xF000])  # four bits of no meaning
def test_temperature_is_right_to_the_ends_of_its_register(raw, above):
    bench = running()
    bench.chip.temperature = raw & 0x0FFF | above
    expected = 2500 + math.floor(raw * 12.5)
    assert bench.sample().temperature_cdeg == expected


def test_a_sample_carries_the_time_of_its_edge():
    bench = running()
    assert bench.parse(bench.take(), 0xFFFFFFFE).time_us == 0xFFFFFFFE


# Ends of the range, and readings that are none.


def block(
    gyr: tuple[int, int, int] = (1, 2, 3),
    acc: tuple[int, int, int] = (0, 0, 1366),
    mag: tuple[int, int, int] = (10, 20, 30),
    gyr_status: int = 0x0F,
    acc_status: int = 0x0F,
    mag_status: int = 0x0F,
) -> bytes:
    """Return the bytes of a sample's bursts."""

    def part(status: int, values: tuple[int, int, int]) -> bytes:
        rows = (value.to_bytes(2, "little", signed=True) for value in values)
        return bytes([status]) + b"".join(rows)

    temperature = bytes([0x10, 0x00])
    return (
        part(gyr_status, gyr)
        + part(acc_status, acc)
        + temperature
        + part(mag_status, mag)
    )


_SHARED: list[Bench] = []


def running_once() -> Bench:
    """Return one chip, set up, for tests that only parse."""
    if not _SHARED:
        _SHARED.append(running())
    bench = _SHARED[0]
    bench.parse(block())
    return bench


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("counts", "is_beyond"),
    [(28571, False), (28572, True), (-28571, False), (-28572, True), (-32768, True)],
)
def test_a_rate_beyond_2000_deg_s_is_clipped(axis, counts, is_beyond):
    gyr = [0, 0, 0]
    gyr[axis] = counts
    sample = running_once().parse(block(gyr=tuple(gyr)))
    assert sample.gyr_clipped == is_beyond
    assert not sample.acc_clipped
    assert list(axes(sample.gyr)) == gyr


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("counts", "is_beyond"),
    [(21857, False), (21858, True), (-21857, False), (-21858, True), (-32768, True)],
)
def test_an_acceleration_beyond_16_g_is_clipped(axis, counts, is_beyond):
    acc = [0, 0, 0]
    acc[axis] = counts
    sample = running_once().parse(block(acc=tuple(acc)))
    assert sample.acc_clipped == is_beyond
    assert not sample.gyr_clipped
    assert list(axes(sample.acc)) == acc


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("counts", "is_beyond"),
    [(25000, False), (25001, True), (-25000, False), (-25001, True), (-32768, True)],
)
def test_a_field_beyond_2_gauss_has_overflowed(axis, counts, is_beyond):
    mag = [0, 0, 0]
    mag[axis] = counts
    sample = running_once().parse(block(mag=tuple(mag)))
    assert (sample.has_mag, sample.mag_overflow) == (not is_beyond, is_beyond)


def test_an_old_field_has_not_overflowed():
    sample = running_once().parse(block(mag=(32767, 0, 0), mag_status=0))
    assert not sample.has_mag
    assert not sample.mag_overflow
    assert axes(sample.mag) == (0, 0, 0)


@pytest.mark.parametrize("byte", [0x00, 0xFF])
def test_a_bus_that_nobody_drives_is_no_reading(byte):
    bench = running_once()
    assert bench.is_refused(bytes([byte]) * 23)
    # The magnetometer's part alone does not tell.
    assert bench.is_refused(bytes([byte]) * 14 + block()[14:])


def test_a_sample_of_all_ones_in_one_sensor_alone_is_a_reading():
    bench = running_once()
    sample = bench.parse(block(gyr=(-1, -1, -1), gyr_status=0xFF))
    assert axes(sample.gyr) == (-1, -1, -1)
    sample = bench.parse(block(acc=(-1, -1, -1), acc_status=0xFF))
    assert axes(sample.acc) == (-1, -1, -1)


# Old readings are not passed on as new ones.


@pytest.mark.parametrize("status", [0x00, 0x01, 0x07, 0x08, 0x0B, 0xF0])
def test_rates_that_are_not_all_new_are_no_reading(status):
    assert running_once().is_refused(block(gyr_status=status))


@pytest.mark.parametrize("status", [0x00, 0x01, 0x07, 0x08, 0x0E, 0xF7])
def test_a_field_that_is_not_new_on_all_axes_is_none(status):
    sample = running_once().parse(block(mag_status=status))
    assert not sample.has_mag
    assert axes(sample.mag) == (0, 0, 0)


@pytest.mark.parametrize("status", [0x00, 0x07, 0x0B])
def test_an_acceleration_is_held_for_four_samples_at_most(status):
    bench = running_once()
    for _ in range(3):
        for _ in range(4):
            held = bench.parse(block(acc=(5, 6, 7), acc_status=status))
            assert axes(held.acc) == (5, 6, 7)
        assert bench.is_refused(block(acc=(5, 6, 7), acc_status=status))
        assert bench.is_refused(block(acc=(5, 6, 7), acc_status=status))
        bench.parse(block())


def test_an_accelerometer_that_stops_ends_the_samples():
    bench = running()
    bench.samples(10)
    bench.chip.acc.is_silent = True
    bench.samples(4)
    assert bench.is_refused(bench.take())


@pytest.mark.parametrize(("is_fast", "rate_hz"), [(False, 380), (True, 760)])
@pytest.mark.parametrize("error", [0.9, 0.999, 1.0, 1.001, 1.1])
def test_each_measurement_of_the_field_arrives_once(is_fast, rate_hz, error):
    bench = running(is_fast=is_fast)
    bench.chip.mag.tune(error, bench.chip.now_us)
    fields = []
    for turn in range(rate_hz * 2):
        # No two measurements are equal.
        bench.chip.mag_gauss = (turn * 0.08e-3, 0, 0)
        sample = bench.sample()
        if sample.has_mag:
            fields.append(sample.mag.x)
    assert all(one < two for one, two in itertools.pairwise(fields))
    # A read takes 0.22 of the 2.6 ms (1.3 at 760 Hz) between samples. Clocks that keep
    # step lose up to two phases of nine.
    measured = 2 * 100 * error
    assert 0.75 * measured <= len(fields) <= measured + 1


@pytest.mark.parametrize("is_fast", [False, True])
@pytest.mark.parametrize("error", [0.96, 0.99, 1.0, 1.01, 1.1])
def test_each_sample_has_an_acceleration_of_its_own(is_fast, error):
    bench = running(is_fast=is_fast)
    bench.chip.acc.tune(error, bench.chip.now_us)
    bench.sample()
    for _ in range(1000):
        bench.sample()
        assert bench.driver.held == 0


def test_samples_that_were_overwritten_leave_a_gap_before_the_next():
    bench = running()
    assert not bench.sample().has_gap
    bench.chip.now_us += 6000  # two and more
    assert bench.sample().has_gap
    assert not bench.sample().has_gap


@pytest.mark.parametrize("before", [False, True])
def test_a_gap_that_the_caller_knows_of_stays(before):
    bench = running_once()
    out = ffi.new("struct sample *", {"has_gap": before})
    assert lib.lsm9ds0_parse(bench.driver, block(), 0, out)
    assert out.has_gap == before


@given(st.binary(min_size=23, max_size=23))
def test_whatever_the_bytes_nothing_impossible_comes_out(data):
    bench = running_once()
    sample = ffi.new("struct sample *")
    if not lib.lsm9ds0_parse(bench.driver, data, 0, sample):
        assert data[0] & 0x0F != 0x0F or data[:14] == b"\xff" * 14
        return
    assert not (sample.has_mag and sample.mag_overflow)
    assert sample.has_mag <= (data[16] & 0x0F == 0x0F)
    assert max(map(abs, axes(sample.mag))) <= 25000 or sample.mag_overflow
    assert -23100 <= sample.temperature_cdeg <= 28088


# The same driver and the model that the virtual boards have.


def modelled(*, is_fast: bool = False, **config: Any) -> Bench:
    return running(Model(**config), is_fast=is_fast)


def settled(bench: Bench) -> Any:
    """Return a sample with a field, all filters' past behind it."""
    return [sample for sample in bench.samples(40) if sample.has_mag][-1]


def approx(values: Triple, lsb: float) -> list[Any]:
    return [pytest.approx(value / lsb, abs=0.51) for value in values]


@pytest.mark.parametrize("is_fast", [False, True])
def test_the_model_agrees_and_does_not_complain(is_fast):
    bench = modelled(is_fast=is_fast)
    assert list(bench.identity.who_am_i) == [0xD4, 0x49]
    assert bench.identity.self_test == BOTH_PASSED
    assert not any(sample.has_gap for sample in bench.samples(20))
    assert bench.chip.complaint is None


@pytest.mark.parametrize("turn", range(3))
def test_the_models_motion_arrives_in_its_frame(turn):
    bench = modelled()

    def turned(values: Triple) -> Triple:
        x, y, z = values[turn:] + values[:turn]
        return x, y, z

    gyr, acc, mag = (
        turned((1.0, -2.0, 30.0)),
        turned((-9.0, 70.0, 3.0)),
        turned((20.0, -45.0, 150.0)),
    )
    bench.chip.hold(gyr, acc, mag)
    sample = settled(bench)
    identity = bench.identity
    assert list(axes(sample.gyr)) == approx(gyr, identity.gyr_lsb_nrad_s * 1e-9)
    assert list(axes(sample.acc)) == approx(acc, identity.acc_lsb_nm_s2 * 1e-9)
    assert list(axes(sample.mag)) == approx(mag, identity.mag_lsb_pt * 1e-6)


@pytest.mark.parametrize("celsius", [-40.0, 0.0, 25.0, 36.6, 85.0])
def test_the_models_temperature_arrives(celsius):
    bench = modelled()
    lib.lsm9ds0_chip_set_temperature(bench.chip.c, celsius)
    # An eighth of a degree, rounded twice.
    assert settled(bench).temperature_cdeg == pytest.approx(celsius * 100, abs=7)


@pytest.mark.parametrize("is_fast", [False, True])
@pytest.mark.parametrize("g_ppm", [-20_000, 0, 20_000])
@pytest.mark.parametrize("xm_ppm", [-20_000, -1000, 0, 20_000])
def test_clocks_that_differ_double_nothing_and_lose_little(is_fast, g_ppm, xm_ppm):
    bench = modelled(is_fast=is_fast, g_rate_error_ppm=g_ppm, xm_rate_error_ppm=xm_ppm)
    fields = []
    for turn in range(bench.identity.rate_hz * 2):
        # No two measurements are equal; more than the field that was held before.
        bench.chip.hold(mag=(0, 21 + 0.05 * turn, 0))
        sample = bench.sample()
        assert bench.driver.held == 0
        assert not sample.has_gap
        if sample.has_mag:
            fields.append(sample.mag.y)
    assert all(one < two for one, two in itertools.pairwise(fields))
    measured = 200 * (1 + (xm_ppm - g_ppm) * 1e-6)
    assert 0.75 * measured <= len(fields) <= measured + 2


def test_a_models_wire_pulled_anywhere_is_reported_and_the_next_set_up_works():
    count = modelled().transactions
    assert count > 100
    for pulled_at in range(1, count + 1):
        bench = Bench(Model())
        bench.pulled_at = pulled_at
        assert bench.set_up() == lib.SENSOR_BUS_FAILED
        assert bench.set_up() == lib.SENSOR_OK, f"after transaction {pulled_at}"
        assert bench.identity.self_test == BOTH_PASSED
        assert bench.sample().acc.z == pytest.approx(1 / 0.732e-3, abs=0.51)
        assert bench.chip.complaint is None


@pytest.mark.parametrize("at_byte", [0, 1, 2])
def test_a_refused_byte_is_a_failed_bus(at_byte):
    bench = Bench(Model())
    bench.chip.fault(
        lib.CHIP_FAULT_NACK, first=3, transactions=1_000_000, at_byte=at_byte
    )
    assert bench.set_up() == lib.SENSOR_BUS_FAILED


def test_a_held_data_line_is_a_failed_bus():
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_STUCK_SDA, from_ns=400_000_000)
    assert bench.set_up() == lib.SENSOR_BUS_FAILED


@pytest.mark.parametrize("die", [lib.LSM9DS0_CHIP_G, lib.LSM9DS0_CHIP_XM])
@pytest.mark.parametrize("from_ms", [0, 500, 1000])
def test_a_model_that_never_gets_ready_is_stuck_in_bounded_time(die, from_ms):
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_NO_DATA_READY, die=die, from_ns=from_ms * 1_000_000)
    assert bench.set_up() == lib.SENSOR_STUCK
    lib.i2c_slave_clear_faults(lib.lsm9ds0_chip_wire(bench.chip.c))
    assert bench.set_up() == lib.SENSOR_OK


def test_a_model_without_magnetometer_has_six_axes():
    bench = Bench(Model())
    bench.chip.fault(lib.CHIP_FAULT_NO_MAG)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0xD4, 0]
    assert bench.identity.self_test == BOTH_PASSED | lib.SELF_TEST_MAG_FAILED
    assert not any(sample.has_mag for sample in bench.samples(40))


@pytest.mark.parametrize(
    ("kind", "verdict"),
    [
        (lib.CHIP_FAULT_GYR_SELF_TEST, ACC_PASSED | GYR_FAILED),
        (lib.CHIP_FAULT_ACC_SELF_TEST, ACC_FAILED | GYR_PASSED),
    ],
)
def test_a_weak_sensor_fails_its_self_test(kind, verdict):
    bench = Bench(Model())
    bench.chip.fault(kind)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.self_test == verdict


def test_an_accelerometer_whose_clock_stops_ends_the_models_samples():
    bench = modelled()
    bench.samples(5)
    bench.chip.fault(lib.CHIP_FAULT_NO_DATA_READY, die=lib.LSM9DS0_CHIP_XM)
    bench.samples(4)
    assert bench.is_refused(bench.take())


def test_a_chip_whose_power_went_is_set_up_again():
    bench = modelled()
    lib.lsm9ds0_chip_power_cycle(bench.chip.c, round(bench.chip.now_us * 1000))
    assert bench.set_up() == lib.SENSOR_OK
    assert settled(bench).acc.z == pytest.approx(1 / 0.732e-3, abs=0.51)
    assert bench.chip.complaint is None


def test_data_ready_stands_until_the_sample_is_read():
    bench = modelled()
    assert not bench.chip.is_ready
    bench.chip.now_us += 20_000
    assert bench.chip.is_ready
    address, reg, length = bench.bursts[0]
    data = ffi.new("uint8_t[]", 23)
    assert bench.chip.read(None, address, reg, data, length) == lib.BUS_OK
    assert not bench.chip.is_ready
    ffi.memmove(data + 7, block()[7:], 16)
    assert bench.parse(bytes(data)).has_gap, "the chip overwrote some"
    assert not bench.sample().has_gap
