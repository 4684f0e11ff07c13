# SPDX-License-Identifier: MIT
"""The model of the MPU-9250 against the manufacturers' documents.

Numbers are typed from RM-MPU-9250A-00 (RM), PS-MPU-9250A-01 (PS), AN-MPU-9250A-03 (ST)
and the AK8963 data sheet (AK), not taken from the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import pytest

import native

MPU, AK = 0x68, 0x0C
G = 9.80665
MS = 1_000_000

ffi, lib = native.load(
    extra_sources=["sim/chips/mpu9250.c"],
    extra_headers=["sim/chips/mpu9250.h"],
    core=False,
)


class Chip:
    """A chip, the time, and an I2C master at 400 kHz."""

    def __init__(self, **config: Any) -> None:
        self.config = ffi.new("struct mpu9250_chip_config *")
        self.config[0] = lib.mpu9250_chip_defaults()
        self.config.startup_ns = 0
        for name, value in config.items():
            setattr(self.config, name, value)
        self.chip = ffi.gc(lib.mpu9250_chip_new(self.config), lib.mpu9250_chip_free)
        self.now = ffi.new("uint64_t *", 0)

    def read(self, reg: int, length: int = 1, address: int = MPU) -> list[int]:
        data = ffi.new("uint8_t[]", length)
        assert self.try_read(reg, data, address) == 0
        return list(data)

    def try_read(self, reg: int, data: Any = None, address: int = MPU) -> int:
        data = ffi.new("uint8_t[1]") if data is None else data
        return int(
            lib.mpu9250_chip_read_registers(
                self.chip, self.now, address, reg, data, len(data)
            )
        )

    def write(self, reg: int, *values: int, address: int = MPU) -> None:
        assert self.try_write(reg, *values, address=address) == 0

    def try_write(self, reg: int, *values: int, address: int = MPU) -> int:
        return int(
            lib.mpu9250_chip_write_registers(
                self.chip, self.now, address, reg, bytes(values), len(values)
            )
        )

    def wait(self, ms: float) -> None:
        self.now[0] += round(ms * MS)
        lib.mpu9250_chip_advance(self.chip, self.now[0])

    def hold(
        self,
        gyr: tuple[float, float, float] = (0.0, 0.0, 0.0),
        acc: tuple[float, float, float] = (0.0, 0.0, G),
        mag: tuple[float, float, float] = (0.0, 20.0, -40.0),
    ) -> None:
        lib.mpu9250_chip_hold(self.chip, gyr, acc, mag)

    def fault(self, kind: str, **fields: int) -> None:
        fault = ffi.new("struct mpu9250_chip_fault *")
        fault.kind = getattr(lib, f"MPU9250_CHIP_{kind}")
        for name, value in fields.items():
            setattr(fault, name, value)
        assert lib.mpu9250_chip_add_fault(self.chip, fault)

    def words(self, reg: int, count: int) -> list[int]:
        data = bytes(self.read(reg, 2 * count))
        return [
            int.from_bytes(data[i : i + 2], "big", signed=True)
            for i in range(0, len(data), 2)
        ]

    def int_is_high(self) -> bool:
        return bool(lib.mpu9250_chip_int_is_high(self.chip))

    def edges(self, ms: float) -> list[int]:
        """When INT rises within the time, in ns."""
        end = self.now[0] + round(ms * MS)
        rises = []
        level = self.int_is_high()
        while (event := lib.mpu9250_chip_next_event(self.chip)) <= end:
            lib.mpu9250_chip_advance(self.chip, event)
            self.now[0] = event
            if self.int_is_high() and not level:
                rises.append(event)
            level = self.int_is_high()
        self.now[0] = end
        lib.mpu9250_chip_advance(self.chip, end)
        return rises

    def edge(self) -> None:
        """Go on to the next rise of INT."""
        while self.int_is_high():
            self._step()
        while not self.int_is_high():
            self._step()

    def _step(self) -> None:
        self.now[0] = lib.mpu9250_chip_next_event(self.chip)
        lib.mpu9250_chip_advance(self.chip, self.now[0])

    def complaint(self) -> str | None:
        text = lib.mpu9250_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()

    def ak_mode(self, mode: int) -> None:
        """AK 6.3: through power-down, with 100 us in it; by the bypass."""
        self.write(0x0A, 0x00, address=AK)
        self.wait(0.1)
        self.write(0x0A, mode, address=AK)


def recorder(quantity: int) -> tuple[Any, list[tuple[int, int]]]:
    """A motion that stands still, and the windows over which it was asked for it."""
    asked: list[tuple[int, int]] = []

    @ffi.callback(
        "void(void *, enum mpu9250_chip_quantity, int64_t, int64_t, double *)"
    )
    def motion(_context: Any, which: int, start: int, end: int, mean: Any) -> None:
        if which == quantity:
            asked.append((start, end))
        mean[0] = mean[1] = mean[2] = 0.0

    return motion, asked


@pytest.fixture
def chip() -> Iterator[Chip]:
    chip = Chip()
    yield chip
    assert chip.complaint() is None


def sampling(chip: Chip, divider: int = 4, dlpf: int = 3) -> None:
    chip.write(26, dlpf)
    chip.write(25, divider)
    chip.write(56, 0x01)


def bypass(chip: Chip) -> None:
    chip.write(106, 0x00)
    chip.write(55, 0x02)


# Registers


def test_reset_values_are_those_of_the_register_map(chip: Chip) -> None:
    defaults = lib.mpu9250_chip_defaults()
    expected = [0] * 128
    expected[58] = 0x01  # the sample clock runs
    expected[107] = 0x01  # RM 3
    expected[117] = 0x71
    expected[0:3] = list(defaults.gyr_self_test)
    expected[13:16] = list(defaults.acc_self_test)
    # In two bursts: FIFO_R_W, 116, is the one register that a burst stays at.
    assert [*chip.read(0, 116), 0, *chip.read(117, 11)] == expected


def test_ad0_chooses_the_address() -> None:
    chip = Chip(ad0=True)
    assert chip.read(117, address=0x69) == [0x71]
    assert chip.try_read(117, address=0x68) == -1


def test_nothing_answers_until_start_up_is_over() -> None:
    chip = Chip(startup_ns=100 * MS)
    assert chip.try_read(117) == -1
    chip.wait(100)
    assert chip.read(117) == [0x71]
    chip.write(107, 0x80)
    assert chip.try_read(117) == -1
    chip.wait(100)
    assert chip.read(117) == [0x71]


def test_h_reset_takes_registers_back_but_not_the_ak8963(chip: Chip) -> None:
    sampling(chip)
    bypass(chip)
    chip.ak_mode(0x16)
    chip.write(107, 0x80)
    assert chip.read(25, 3) == [0, 0, 0]
    assert chip.read(107) == [0x01]
    assert lib.mpu9250_chip_peek_ak8963(chip.chip, 0x0A) == 0x16


def test_read_only_registers_keep_their_value_and_complain() -> None:
    chip = Chip()
    chip.write(117, 0x55)
    assert chip.read(117) == [0x71]
    assert chip.complaint() is not None


def test_unmodelled_registers_complain() -> None:
    for reg, value in ((35, 0x78), (106, 0x40), (107, 0x20), (56, 0x10)):
        chip = Chip()
        chip.write(reg, value)
        assert chip.complaint() is not None


# The sample clock


@pytest.mark.parametrize(
    ("fchoice_b", "dlpf", "divider", "hz"),
    [
        (0, 3, 4, 200.0),
        (0, 1, 0, 1000.0),
        (0, 6, 255, 1000 / 256),
        (0, 0, 4, 8000.0),  # RM 4.4: the divider works with the DLPF on only
        (0, 7, 4, 8000.0),
        (1, 3, 4, 32000.0),
        (2, 3, 4, 32000.0),
    ],
)
def test_data_ready_comes_at_the_rate_of_the_registers(
    chip: Chip, fchoice_b: int, dlpf: int, divider: int, hz: float
) -> None:
    chip.write(27, fchoice_b)
    sampling(chip, divider, dlpf)
    chip.write(55, 0x00)
    before = lib.mpu9250_chip_samples(chip.chip)
    chip.wait(2048)
    count = lib.mpu9250_chip_samples(chip.chip) - before
    assert abs(count - 2.048 * hz) <= 1


def test_edges_are_5_ms_apart_at_200_hz(chip: Chip) -> None:
    sampling(chip)
    edges = chip.edges(1000)
    assert len(edges) == 200
    assert {b - a for a, b in itertools.pairwise(edges)} == {5 * MS}


@pytest.mark.parametrize("ppm", [-10_000.0, 250.0, 10_000.0])
def test_a_rate_error_adds_up_without_drift(ppm: float) -> None:
    chip = Chip(rate_error_ppm=ppm)
    sampling(chip)
    edges = chip.edges(20_000)
    period = (edges[-1] - edges[0]) / (len(edges) - 1)
    assert period == pytest.approx(5 * MS / (1 + ppm * 1e-6), abs=0.01)


def test_a_sleeping_chip_takes_no_samples(chip: Chip) -> None:
    sampling(chip)
    chip.write(107, 0x41)
    assert chip.edges(100) == []
    chip.write(107, 0x01)
    assert len(chip.edges(100)) == 20


# INT


def test_int_is_a_pulse_of_50_us(chip: Chip) -> None:
    sampling(chip)
    event = lib.mpu9250_chip_next_event(chip.chip)
    lib.mpu9250_chip_advance(chip.chip, event)
    assert chip.int_is_high()
    lib.mpu9250_chip_advance(chip.chip, event + 49_999)
    assert chip.int_is_high()
    lib.mpu9250_chip_advance(chip.chip, event + 50_000)
    assert not chip.int_is_high()


def test_a_latched_int_stays_until_the_status_is_read(chip: Chip) -> None:
    chip.write(55, 0x20)
    sampling(chip)
    assert len(chip.edges(100)) == 1
    assert chip.int_is_high()
    chip.read(59, 14)
    assert chip.int_is_high()
    assert chip.read(58) == [0x01]
    assert not chip.int_is_high()
    assert chip.read(58) == [0x00]


def test_any_read_clears_a_latched_int_where_told_so(chip: Chip) -> None:
    chip.write(55, 0x30)
    sampling(chip)
    chip.edges(6)
    assert chip.int_is_high()
    chip.read(59, 14)
    assert not chip.int_is_high()


def test_int_can_be_active_low(chip: Chip) -> None:
    chip.write(55, 0xA0)
    assert chip.int_is_high()
    sampling(chip)
    chip.wait(6)
    assert not chip.int_is_high()


def test_no_int_without_its_enable_bit(chip: Chip) -> None:
    sampling(chip)
    chip.write(56, 0x00)
    assert chip.edges(100) == []
    assert chip.read(58) == [0x01]


# Numbers


@pytest.mark.parametrize("fs_sel", range(4))
def test_gyroscope_counts_over_the_ranges(chip: Chip, fs_sel: int) -> None:
    full = math.radians(250.0 * 2**fs_sel)
    chip.write(27, fs_sel << 3)
    sampling(chip)
    chip.hold(gyr=(0.5 * full, -0.25 * full, 3.0 * full))
    chip.wait(100)
    assert chip.words(67, 3) == [16384, -8192, 32767]
    chip.hold(gyr=(-3.0 * full, 0.6 * full / 32768, -0.4 * full / 32768))
    chip.wait(100)
    assert chip.words(67, 3) == [-32768, 1, 0]


@pytest.mark.parametrize("afs_sel", range(4))
def test_accelerometer_counts_over_the_ranges(chip: Chip, afs_sel: int) -> None:
    full = 2.0 * 2**afs_sel * G
    chip.write(28, afs_sel << 3)
    sampling(chip)
    chip.hold(acc=(0.5 * full, -0.25 * full, 3.0 * full))
    chip.wait(100)
    assert chip.words(59, 3) == [16384, -8192, 32767]
    chip.hold(acc=(-3.0 * full, 0.6 * full / 32768, 0.0))
    chip.wait(100)
    assert chip.words(59, 3) == [-32768, 1, 0]


def test_sensitivities_are_those_of_the_product_specification(chip: Chip) -> None:
    sampling(chip)
    chip.hold(gyr=(math.radians(100), 0, 0), acc=(0, 0, G))
    chip.wait(100)
    assert chip.words(67, 1)[0] == pytest.approx(100 * 131, rel=1e-3)  # PS 3.1
    assert chip.words(63, 1) == [16384]  # PS 3.2


def test_temperature_by_the_data_sheets_formula() -> None:
    for celsius in (-40.0, 21.0, 25.0, 85.0):
        chip = Chip(temperature_c=celsius)
        sampling(chip)
        chip.wait(10)
        assert chip.words(65, 1)[0] / 333.87 + 21.0 == pytest.approx(celsius, abs=2e-3)


@pytest.mark.parametrize(("dlpf", "hz"), [(1, 184), (2, 92), (3, 41), (4, 20), (5, 10)])
def test_the_gyroscope_is_averaged_over_its_bandwidth(dlpf: int, hz: float) -> None:
    motion, asked = recorder(lib.MPU9250_CHIP_GYR)
    chip = Chip(motion=motion)
    chip.write(26, dlpf)
    chip.write(25, 4)
    chip.wait(50)
    start, end = asked[-1]
    assert end - start == pytest.approx(0.443e9 / hz, abs=1)
    assert end - asked[-2][1] == 5 * MS


@pytest.mark.parametrize(("dlpf", "hz"), [(2, 99), (3, 44.8), (4, 21.2), (6, 5.05)])
def test_the_accelerometer_has_a_bandwidth_of_its_own(dlpf: int, hz: float) -> None:
    motion, asked = recorder(lib.MPU9250_CHIP_ACC)
    chip = Chip(motion=motion)
    chip.write(29, dlpf)
    sampling(chip)
    chip.wait(50)
    start, end = asked[-1]
    assert end - start == pytest.approx(0.443e9 / hz, abs=1)


def test_disabled_axes_and_sensors_that_start_read_zero(chip: Chip) -> None:
    sampling(chip)
    chip.hold(gyr=(1, 1, 1), acc=(5, 5, 5))
    chip.wait(30)
    assert chip.words(67, 3) == [0, 0, 0]  # PS 3.1: 35 ms
    assert 0 not in chip.words(59, 3)  # PS 3.2: 20 ms
    chip.wait(20)
    assert 0 not in chip.words(67, 3)
    chip.write(108, 0b00_010_001)
    chip.wait(10)
    assert [word == 0 for word in chip.words(59, 3)] == [False, True, False]
    assert [word == 0 for word in chip.words(67, 3)] == [False, False, True]


def test_offset_registers_add_their_steps(chip: Chip) -> None:
    sampling(chip)
    chip.hold(acc=(0, 0, 0))
    chip.write(19, 0x00, 0x64)  # 100 steps of 4 counts at 250 deg/s
    chip.write(119, 0x01, 0x00)  # 128 steps of 0.98 mg
    chip.wait(100)
    assert chip.words(67, 1) == [400]
    assert chip.words(59, 1) == [round(128 * 0.98e-3 * 16384)]


def test_a_burst_is_of_one_instant(chip: Chip) -> None:
    sampling(chip)
    chip.wait(100)
    chip.hold(gyr=(1, 1, 1), acc=(0, 0, 0))
    lib.mpu9250_chip_start(chip.chip, chip.now[0], MPU, False)
    lib.mpu9250_chip_write(chip.chip, chip.now[0], 59)
    lib.mpu9250_chip_start(chip.chip, chip.now[0], MPU, True)
    first = [lib.mpu9250_chip_read(chip.chip, chip.now[0], True) for _ in range(6)]
    chip.wait(20)  # four samples come meanwhile
    rest = [lib.mpu9250_chip_read(chip.chip, chip.now[0], i < 7) for i in range(8)]
    lib.mpu9250_chip_stop(chip.chip, chip.now[0])
    assert first == [0, 0, 0, 0, 0x40, 0]
    assert rest[2:] == [0] * 6
    assert chip.words(67, 3)[0] != 0


# Self-test


def self_test_ratios(chip: Chip) -> list[float]:
    """ST 3: responses over factory trim, gyroscope then accelerometer."""
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


# AK8963 by the bypass


def test_the_ak8963_is_behind_the_bypass_only(chip: Chip) -> None:
    assert chip.try_read(0x00, address=AK) == -1
    bypass(chip)
    assert chip.read(0x00, address=AK) == [0x48]
    chip.write(106, 0x20)  # the chip's own master takes the bus
    assert chip.try_read(0x00, address=AK) == -1


def test_asa_is_in_the_fuse_rom(chip: Chip) -> None:
    bypass(chip)
    chip.ak_mode(0x0F)
    assert chip.read(0x10, 3, address=AK) == [176, 178, 166]
    assert chip.read(0x10, 4, address=AK) == [176, 178, 166, 176]  # AK 7.2.3: a ring


def test_asa_outside_fuse_rom_mode_is_a_complaint() -> None:
    chip = Chip()
    bypass(chip)
    assert chip.read(0x10, address=AK) == [0]
    assert chip.complaint() is not None


def field(chip: Chip) -> list[float]:
    """The field in the MPU's axes by the data sheet's formula, uT."""
    data = bytes(chip.read(0x03, 7, address=AK))
    lsb = 0.15 if data[6] & 0x10 else 0.6
    own = [
        int.from_bytes(data[2 * i : 2 * i + 2], "little", signed=True)
        * ((asa - 128) * 0.5 / 128 + 1)
        * lsb
        for i, asa in enumerate((176, 178, 166))
    ]
    return [own[1], own[0], -own[2]]  # PS 9.1


@pytest.mark.parametrize(("bits", "lsb"), [(0x10, 0.15), (0x00, 0.6)])
def test_the_true_field_comes_out_of_the_formula(
    chip: Chip, bits: int, lsb: float
) -> None:
    true = (30.0, -12.5, 47.0)
    chip.hold(mag=true)
    bypass(chip)
    chip.ak_mode(bits | 0x06)
    chip.wait(8)
    # Half a count, and the adjustment stretches it by up to 1.2.
    assert field(chip) == pytest.approx(true, abs=0.6 * lsb)


@pytest.mark.parametrize(("mode", "period_ms"), [(0x12, 125.0), (0x16, 10.0)])
def test_continuous_modes_measure_at_8_and_100_hz(
    chip: Chip, mode: int, period_ms: float
) -> None:
    bypass(chip)
    chip.ak_mode(mode)
    chip.wait(7.1)
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(0.2)  # AK 5.3.1: 7.2 ms a measurement
    assert chip.read(0x02, 8, address=AK)[0] == 0x01
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(period_ms - 1.0)
    assert chip.read(0x02, address=AK) == [0x00]
    chip.wait(1.0)
    assert chip.read(0x02, address=AK) == [0x01]


def test_a_single_measurement_ends_in_power_down(chip: Chip) -> None:
    bypass(chip)
    chip.ak_mode(0x11)
    chip.wait(8)
    assert chip.read(0x02, address=AK) == [0x01]
    assert chip.read(0x0A, address=AK) == [0x10]
    chip.wait(100)
    chip.read(0x03, 7, address=AK)
    assert chip.read(0x02, address=AK) == [0x00]


def test_skipped_data_set_dor_until_data_are_read(chip: Chip) -> None:
    bypass(chip)
    chip.ak_mode(0x16)
    chip.wait(30)
    assert chip.read(0x02, address=AK) == [0x03]
    chip.read(0x03, 7, address=AK)
    assert chip.read(0x02, address=AK) == [0x00]


def test_data_stay_until_st2_is_read(chip: Chip) -> None:
    bypass(chip)
    chip.ak_mode(0x16)
    chip.wait(8)
    chip.hold(mag=(100.0, 100.0, 100.0))
    low = chip.read(0x03, 1, address=AK)
    chip.wait(50)
    assert chip.read(0x03, 1, address=AK) == low
    chip.read(0x09, address=AK)
    chip.wait(10)
    assert chip.read(0x03, 1, address=AK) != low


def test_a_strong_field_overflows(chip: Chip) -> None:
    bypass(chip)
    chip.hold(mag=(1637.0, 1637.0, 1637.0))  # AK 6.4.3.6: sum of 4912 uT
    chip.ak_mode(0x16)
    chip.wait(8)
    assert chip.read(0x09, address=AK) == [0x10]
    chip.hold(mag=(1638.0, 1637.0, 1638.0))
    chip.wait(10)
    assert chip.read(0x09, address=AK) == [0x18]
    chip.hold(mag=(0.0, 9000.0, 0.0))
    chip.wait(10)
    assert chip.read(0x03, 2, address=AK) == list((32760).to_bytes(2, "little"))


def test_the_ak8963_self_test_is_within_its_limits(chip: Chip) -> None:
    bypass(chip)
    chip.write(0x0A, 0x00, address=AK)
    chip.wait(1)
    chip.write(0x0C, 0x40, address=AK)
    chip.write(0x0A, 0x18, address=AK)
    chip.wait(8)
    x, y, z = (value / 0.15 for value in field(chip))
    assert -200 <= y <= 200  # AK 9.4.4, in its own axes
    assert -200 <= x <= 200
    assert -3200 <= -z <= -800


def test_a_mode_change_without_power_down_is_refused() -> None:
    chip = Chip()
    bypass(chip)
    chip.ak_mode(0x16)
    chip.write(0x0A, 0x0F, address=AK)
    assert chip.read(0x0A, address=AK) == [0x16]
    assert "power-down" in str(chip.complaint())


def test_a_mode_within_100_us_of_power_down_is_refused() -> None:
    chip = Chip()
    bypass(chip)
    chip.ak_mode(0x16)
    chip.write(0x0A, 0x00, address=AK)
    chip.write(0x0A, 0x16, address=AK)
    assert chip.read(0x0A, address=AK) == [0x00]
    assert "100 us" in str(chip.complaint())


def test_a_soft_reset_takes_the_ak8963_back(chip: Chip) -> None:
    bypass(chip)
    chip.ak_mode(0x16)
    chip.write(0x0B, 0x01, address=AK)
    assert chip.read(0x0A, address=AK) == [0x00]
    chip.wait(50)
    assert chip.read(0x02, address=AK) == [0x00]


def test_the_field_is_that_of_the_middle_of_the_measurement() -> None:
    motion, asked = recorder(lib.MPU9250_CHIP_MAG)
    chip = Chip(motion=motion)
    bypass(chip)
    chip.ak_mode(0x16)
    started = chip.now[0]
    chip.wait(20)
    start, end = asked[0]
    assert start == end
    assert end == pytest.approx(started + 3.6 * MS, abs=30_000)
    assert asked[1][0] - asked[0][0] == 10 * MS


# The chip's own I2C master


def burst_of_22(chip: Chip, ctrl: int = 0x4D) -> None:
    """ST1, the data and ST2 of the AK8963 behind the chip's own 14 bytes."""
    bypass(chip)
    chip.ak_mode(0x16)
    chip.write(55, 0x00)
    chip.write(106, 0x20)
    chip.write(36, ctrl)
    chip.write(37, 0x80 | AK, 0x02, 0x80 | 8)
    sampling(chip)


def test_a_burst_of_22_bytes_has_all_nine_axes(chip: Chip) -> None:
    chip.hold(mag=(30.0, -12.5, 47.0))
    burst_of_22(chip)
    chip.wait(100)
    flags = []
    for _ in range(20):
        chip.edge()
        burst = bytes(chip.read(59, 22))
        flags.append(burst[14])
        assert burst[4:6] == b"\x40\x00"
        if burst[14] & 1:
            raw = int.from_bytes(burst[15:17], "little", signed=True)
            adjusted = raw * 0.15 * ((176 - 128) * 0.5 / 128 + 1)
            assert adjusted == pytest.approx(-12.5, abs=0.1)  # its x is our y
            assert burst[21] == 0x10
    assert flags.count(0x01) == 10  # 100 Hz of 200
    assert flags.count(0x00) == 10


@pytest.mark.parametrize(("ctrl", "waits"), [(0x4D, True), (0x0D, False)])
def test_wait_for_es_puts_int_behind_the_external_bytes(
    chip: Chip, ctrl: int, waits: bool
) -> None:
    burst_of_22(chip, ctrl)
    started = chip.now[0]  # the sample clock starts with the last of its registers
    edges = chip.edges(100)[1:]
    # START, address, register, START, address and 8 bytes: 101 bits at 400 kHz.
    late = 101 * 2500 if waits else 0
    assert len(edges) >= 18
    for edge in edges:
        since = (edge - late - started) % (5 * MS)
        # STOP of the write to INT_ENABLE, and of the one before it.
        assert 5 * MS - since < 200_000


@pytest.mark.parametrize(("delay", "is_torn"), [(0x00, True), (0x80, False)])
def test_the_shadow_delays_external_bytes_until_all_are_there(
    chip: Chip, delay: int, is_torn: bool
) -> None:
    burst_of_22(chip, 0x0D)
    chip.write(103, delay)
    chip.hold(mag=(300.0, 300.0, -300.0))
    chip.wait(50)
    chip.hold(mag=(-300.0, -300.0, 300.0))
    seen = set()
    end = chip.now[0] + 30 * MS
    while (event := lib.mpu9250_chip_next_event(chip.chip)) < end:
        lib.mpu9250_chip_advance(chip.chip, event)
        # The high bytes of the three axes: signs change from one block to the next.
        signs = [lib.mpu9250_chip_peek(chip.chip, reg) >> 7 for reg in (75, 77, 79)]
        seen.add(tuple(signs))
    assert {(0, 0, 0), (1, 1, 1)} <= seen
    assert (len(seen) > 2) is is_torn


def test_slaves_share_the_external_bytes_in_their_order(chip: Chip) -> None:
    bypass(chip)
    chip.write(55, 0)
    chip.write(37, 0x80 | AK, 0x00, 0x80 | 2)
    chip.write(43, 0x80 | AK, 0x00, 0x80 | 1)
    chip.write(106, 0x20)
    sampling(chip)
    chip.wait(20)
    assert chip.read(73, 4) == [0x48, 0x9A, 0x48, 0x00]
    chip.write(39, 0x02)  # slave 0 off: its place stays (RM 4.25)
    chip.wait(20)
    assert chip.read(73, 4) == [0x48, 0x9A, 0x48, 0x00]


def test_bytes_of_a_word_can_be_swapped(chip: Chip) -> None:
    bypass(chip)
    chip.write(55, 0)
    chip.write(37, 0x80 | AK, 0x00, 0x80 | 0x40 | 3)
    chip.write(106, 0x20)
    sampling(chip)
    chip.wait(20)
    assert chip.read(73, 3) == [0x9A, 0x48, 0x00]
    chip.write(39, 0x80 | 0x50 | 3)  # words start at odd registers
    chip.wait(20)
    assert chip.read(73, 3) == [0x48, 0x00, 0x9A]


def test_slave_4_reads_and_writes_once(chip: Chip) -> None:
    chip.write(106, 0x20)
    sampling(chip)
    chip.write(49, 0x80 | AK, 0x00)
    chip.write(52, 0x80)
    chip.wait(10)
    assert chip.read(52, 3) == [0x00, 0x48, 0x40]
    assert chip.read(54) == [0x00]
    chip.write(49, AK, 0x0A, 0x16, 0x80)
    chip.wait(10)
    assert lib.mpu9250_chip_peek_ak8963(chip.chip, 0x0A) == 0x16


def test_slave_0_writes_its_data_out(chip: Chip) -> None:
    chip.write(106, 0x20)
    sampling(chip)
    chip.write(99, 0x16)
    chip.write(37, AK, 0x0A, 0x81)
    chip.wait(10)
    assert lib.mpu9250_chip_peek_ak8963(chip.chip, 0x0A) == 0x16


def test_delayed_slaves_come_every_so_many_samples(chip: Chip) -> None:
    chip.write(106, 0x20)
    chip.write(52, 4)  # one sample in 5
    chip.write(103, 0x01)
    chip.write(37, 0x80 | 0x33, 0x00, 0x81)  # nobody: each try leaves a NACK bit
    sampling(chip)
    chip.read(54)
    tries = 0
    for _ in range(50):
        chip.edges(5)
        tries += chip.read(54)[0] & 1
    assert tries == 10


def test_a_missing_slave_leaves_its_nack_bit(chip: Chip) -> None:
    chip.fault("NO_AK8963")
    chip.write(106, 0x20)
    chip.write(36, 0x4D)
    chip.write(40, 0x80 | AK, 0x00, 0x81)
    sampling(chip)
    assert len(chip.edges(20)) == 4
    assert chip.read(54) == [0x02]
    assert chip.read(73) == [0]


# Faults


def test_an_mpu6500_has_no_magnetometer() -> None:
    chip = Chip(who_am_i=0x70, has_ak8963=False)
    assert chip.read(117) == [0x70]
    bypass(chip)
    assert chip.try_read(0x00, address=AK) == -1


@pytest.mark.parametrize("byte", [0, 1, 2])
def test_a_nack_hits_its_byte_of_its_transaction(chip: Chip, byte: int) -> None:
    chip.fault("NACK", first=3, transactions=1, at_byte=byte)
    results = [chip.try_write(55, 0x00) for _ in range(5)]
    assert results == [0, 0, -1, 0, 0]
    assert lib.mpu9250_chip_transactions(chip.chip) == 5


def test_a_nack_lasts_for_its_span(chip: Chip) -> None:
    chip.fault("NACK", from_ns=10 * MS, for_ns=10 * MS)
    assert chip.try_read(117) == 0
    chip.wait(11)
    assert chip.try_read(117) == -1
    chip.wait(9)
    assert chip.try_read(117) == 0


def test_a_stuck_line_needs_its_clocks(chip: Chip) -> None:
    chip.fault("STUCK_SDA", first=2, transactions=1, at_byte=2, clocks=5)
    assert chip.try_read(117) == 0
    assert chip.try_read(117) == -3
    assert chip.try_read(117) == -3
    for pulse in range(5):
        assert lib.mpu9250_chip_holds_sda(chip.chip, chip.now[0]), pulse
        lib.mpu9250_chip_scl_pulse(chip.chip, chip.now[0])
    assert not lib.mpu9250_chip_holds_sda(chip.chip, chip.now[0])
    lib.mpu9250_chip_stop(chip.chip, chip.now[0])
    assert chip.read(117) == [0x71]


def test_a_stuck_line_can_free_itself(chip: Chip) -> None:
    chip.fault("STUCK_SDA", from_ns=5 * MS, for_ns=3 * MS)
    assert chip.try_read(117) == 0
    chip.wait(5)
    assert chip.try_read(117) == -3
    chip.wait(3)
    assert chip.try_read(117) == 0


def test_data_ready_can_stop(chip: Chip) -> None:
    sampling(chip)
    chip.fault("NO_DATA_READY", from_ns=chip.now[0] + 100 * MS, for_ns=50 * MS)
    assert len(chip.edges(100)) == 20
    assert chip.edges(50) == []
    assert len(chip.edges(100)) == 20


def test_who_am_i_can_be_wrong(chip: Chip) -> None:
    chip.fault("WRONG_WHO_AM_I", value=0x68)
    assert chip.read(117) == [0x68]


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    sampling(chip)
    chip.wait(100)
    frozen = chip.words(59, 7)
    chip.fault("FROZEN")
    chip.hold(gyr=(1, 2, 3), acc=(4, 5, 6))
    assert len(chip.edges(100)) == 20
    assert chip.words(59, 7) == frozen
    lib.mpu9250_chip_clear_faults(chip.chip)
    chip.wait(10)
    assert chip.words(59, 7) != frozen


def test_power_loss_forgets_everything(chip: Chip) -> None:
    burst_of_22(chip)
    chip.wait(50)
    lib.mpu9250_chip_power_cycle(chip.chip, chip.now[0])
    assert chip.read(25, 3) == [0, 0, 0]
    assert lib.mpu9250_chip_peek_ak8963(chip.chip, 0x0A) == 0
