# SPDX-License-Identifier: MIT
"""The model of the LSM9DS0 against the manufacturer's documents.

Numbers are typed from the data sheet, DocID024763 rev 2 (DS; registers by their names
there), and from application notes on parts of the family (AN4505, AN3308), not taken
from the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import pytest

import native

G, XM = 0x6B, 0x1D
ON = 0x80  # bit 7 of the sub-address: move on with each byte
GRAVITY = 9.80665
MS = 1_000_000

ffi, lib = native.load(
    extra_sources=["sim/chips/lsm9ds0.c"],
    extra_headers=["sim/chips/lsm9ds0.h"],
    core=False,
)

GYR, ACC, MAG = lib.LSM9DS0_CHIP_GYR, lib.LSM9DS0_CHIP_ACC, lib.LSM9DS0_CHIP_MAG
DRDY_G = lib.LSM9DS0_CHIP_DRDY_G
INT1, INT2 = lib.LSM9DS0_CHIP_INT1_XM, lib.LSM9DS0_CHIP_INT2_XM
# Where each sensor lives: address, status register, first output register.
PLACES = {GYR: (G, 0x27, 0x28), ACC: (XM, 0x27, 0x28), MAG: (XM, 0x07, 0x08)}


class Chip:
    """A chip, the time, and an I2C master at 400 kHz."""

    def __init__(self, **config: Any) -> None:
        self.config = ffi.new("struct lsm9ds0_chip_config *")
        self.config[0] = lib.lsm9ds0_chip_defaults()
        self.config.startup_ns = 0
        self.config.gyr_turn_on_ns = 0
        for name, value in config.items():
            setattr(self.config, name, value)
        self.chip = ffi.gc(lib.lsm9ds0_chip_new(self.config), lib.lsm9ds0_chip_free)
        self.now = ffi.new("uint64_t *", 0)

    def read(self, address: int, sub: int, length: int = 1) -> list[int]:
        data = ffi.new("uint8_t[]", length)
        assert self.try_read(address, sub, data) == 0
        return list(data)

    def try_read(self, address: int, sub: int, data: Any = None) -> int:
        data = ffi.new("uint8_t[1]") if data is None else data
        return int(
            lib.lsm9ds0_chip_read_registers(
                self.chip, self.now, address, sub, data, len(data)
            )
        )

    def write(self, address: int, sub: int, *values: int) -> None:
        assert self.try_write(address, sub, *values) == 0

    def try_write(self, address: int, sub: int, *values: int) -> int:
        return int(
            lib.lsm9ds0_chip_write_registers(
                self.chip, self.now, address, sub, bytes(values), len(values)
            )
        )

    def wait(self, ms: float) -> None:
        self.now[0] += round(ms * MS)
        lib.lsm9ds0_chip_advance(self.chip, self.now[0])

    def hold(
        self,
        gyr: tuple[float, float, float] = (0.0, 0.0, 0.0),
        acc: tuple[float, float, float] = (0.0, 0.0, GRAVITY),
        mag: tuple[float, float, float] = (0.0, 20.0, -40.0),
    ) -> None:
        lib.lsm9ds0_chip_hold(self.chip, gyr, acc, mag)

    def fault(self, kind: str, die: str = "BOTH", **fields: int) -> None:
        fault = ffi.new("struct lsm9ds0_chip_fault *")
        fault.kind = getattr(lib, f"LSM9DS0_CHIP_{kind}")
        fault.die = getattr(lib, f"LSM9DS0_CHIP_{die}")
        for name, value in fields.items():
            setattr(fault, name, value)
        assert lib.lsm9ds0_chip_add_fault(self.chip, fault)

    def counts(self, quantity: int) -> list[int]:
        """The three axes, as one burst brings them."""
        address, _, out = PLACES[quantity]
        data = bytes(self.read(address, ON | out, 6))
        return [
            int.from_bytes(data[i : i + 2], "little", signed=True) for i in (0, 2, 4)
        ]

    def status(self, quantity: int) -> int:
        address, reg, _ = PLACES[quantity]
        return self.read(address, reg)[0]

    def samples(self, quantity: int) -> int:
        return int(lib.lsm9ds0_chip_samples(self.chip, quantity))

    def is_high(self, pin: int) -> bool:
        return bool(lib.lsm9ds0_chip_pin_is_high(self.chip, pin))

    def sample(self, quantity: int) -> int:
        """Go on to the next sample of a sensor; return its time."""
        before = self.samples(quantity)
        while self.samples(quantity) == before:
            self.now[0] = lib.lsm9ds0_chip_next_event(self.chip)
            lib.lsm9ds0_chip_advance(self.chip, self.now[0])
        return int(self.now[0])

    def times(self, quantity: int, count: int) -> list[int]:
        return [self.sample(quantity) for _ in range(count)]

    def complaint(self) -> str | None:
        text = lib.lsm9ds0_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()

    def run_gyro(self, ctrl1: int = 0xBF, ctrl4: int = 0xA0) -> None:
        """By default 380 Hz, 100 Hz wide, BDU, 2000 deg/s."""
        self.write(G, 0x22, 0x08)
        self.write(G, 0x23, ctrl4)
        self.write(G, 0x20, ctrl1)

    def run_accel(self, ctrl1: int = 0x8F, ctrl2: int = 0xA0) -> None:
        """By default 400 Hz, BDU, 362 Hz wide, 16 g; data-ready on INT1_XM."""
        self.write(XM, 0x22, 0x04)
        self.write(XM, 0x21, ctrl2)
        self.write(XM, 0x20, ctrl1)

    def run_mag(self, ctrl5: int = 0xF4, ctrl6: int = 0x00, ctrl7: int = 0x00) -> None:
        """By default 100 Hz, high resolution, 2 gauss; data-ready on INT2_XM."""
        self.write(XM, 0x23, 0x04)
        self.write(XM, 0x24, ctrl5)
        self.write(XM, 0x25, ctrl6)
        self.write(XM, 0x26, ctrl7)


def recorder(quantity: int) -> tuple[Any, list[tuple[int, int]]]:
    """A motion that stands still, and the windows over which it was asked for it."""
    asked: list[tuple[int, int]] = []

    @ffi.callback(
        "void(void *, enum lsm9ds0_chip_quantity, int64_t, int64_t, double *)"
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


every_sensor = pytest.mark.parametrize("quantity", [GYR, ACC, MAG])


def run(chip: Chip, quantity: int, *, bdu: bool = True) -> None:
    if quantity == GYR:
        chip.run_gyro(ctrl4=0xA0 if bdu else 0x20)
    elif quantity == ACC:
        chip.run_accel(ctrl1=0x8F if bdu else 0x87)
    else:
        chip.write(XM, 0x20, 0x0F if bdu else 0x07)
        chip.run_mag()


# Registers


def test_reset_values_are_those_of_the_register_map(chip: Chip) -> None:
    expected = [0] * 128
    expected[0x0F] = 0xD4  # DS WHO_AM_I_G
    expected[0x20] = 0x07  # DS CTRL_REG1_G
    expected[0x2F] = 0x20  # DS 4.3: in bypass mode the FIFO remains empty
    assert chip.read(G, ON | 0, 128) == expected
    expected[0x0F] = 0x49  # DS WHO_AM_I_XM
    expected[0x12] = 0xE8
    expected[0x20] = 0x07
    expected[0x24] = 0x18  # DS CTRL_REG5_XM: M_ODR 110
    expected[0x25] = 0x20  # DS CTRL_REG6_XM: 4 gauss
    expected[0x26] = 0x02  # DS CTRL_REG7_XM: power-down
    assert chip.read(XM, ON | 0, 128) == expected


def test_the_polarity_at_reset_can_be_the_other_one() -> None:
    chip = Chip(int_ctrl_reg_m=0x00)
    assert chip.read(XM, 0x12) == [0x00]
    assert chip.is_high(INT1)  # active low, and at rest


@pytest.mark.parametrize(
    ("config", "g", "xm"),
    # DS 6.1: 110101x and 0011110 or 0011101
    [((False, False), 0x6A, 0x1E), ((True, True), 0x6B, 0x1D)],
)
def test_the_sa0_pins_choose_the_addresses(
    config: tuple[bool, bool], g: int, xm: int
) -> None:
    chip = Chip(sa0_g=config[0], sa0_xm=config[1])
    answering = [a for a in range(128) if chip.try_read(a, 0x0F) == 0]
    assert answering == sorted([g, xm])
    assert chip.read(g, 0x0F) == [0xD4]
    assert chip.read(xm, 0x0F) == [0x49]


def test_nothing_answers_until_the_boot_procedure_is_over() -> None:
    chip = Chip(startup_ns=lib.lsm9ds0_chip_defaults().startup_ns)
    assert chip.try_read(G, 0x0F) == chip.try_read(XM, 0x0F) == -1
    chip.wait(10)  # AN4505: about 10 ms
    assert chip.read(G, 0x0F) == [0xD4]
    assert chip.read(XM, 0x0F) == [0x49]


@pytest.mark.parametrize("address", [G, XM])
def test_bit_7_of_the_sub_address_makes_it_move_on(chip: Chip, address: int) -> None:
    assert chip.read(address, 0x20, 3) == [0x07, 0x07, 0x07]  # DS 6.1
    after = chip.read(address, ON | 0x20, 3)
    assert after == [0x07, 0x00, 0x00]
    chip.write(address, ON | 0x20, 0x03, 0x10)
    assert chip.read(address, ON | 0x20, 2) == [0x03, 0x10]
    chip.write(address, 0x20, 0x00, 0x05)  # both to one register
    assert chip.read(address, ON | 0x20, 2) == [0x05, 0x10]


def test_the_dies_have_registers_of_their_own(chip: Chip) -> None:
    chip.write(G, 0x21, 0x2A)
    chip.write(XM, 0x21, 0xD8)
    assert chip.read(G, 0x21) == [0x2A]
    assert chip.read(XM, 0x21) == [0xD8]
    assert lib.lsm9ds0_chip_peek_g(chip.chip, 0x21) == 0x2A
    assert lib.lsm9ds0_chip_peek_xm(chip.chip, 0x21) == 0xD8


def test_nobody_answers_past_the_last_byte(chip: Chip) -> None:
    assert not lib.lsm9ds0_chip_write(chip.chip, 0, 0x20)  # no START
    lib.lsm9ds0_chip_start(chip.chip, 0, G, True)
    assert not lib.lsm9ds0_chip_write(chip.chip, 0, 0x20)
    lib.lsm9ds0_chip_read(chip.chip, 0, False)
    assert lib.lsm9ds0_chip_read(chip.chip, 0, True) == 0xFF
    lib.lsm9ds0_chip_stop(chip.chip, 0)


WRITABLE = {
    G: {*range(0x20, 0x26), 0x2E, 0x30, *range(0x32, 0x39)},
    XM: {0x12, *range(0x14, 0x27), 0x2E, 0x30, *range(0x32, 0x35)}
    | {0x36, 0x37, 0x38, *range(0x3A, 0x40)},
}


@pytest.mark.parametrize("address", [G, XM])
def test_reserved_and_read_only_registers_stay_and_complain(address: int) -> None:
    for reg in range(128):
        chip = Chip()
        before = chip.read(address, reg)
        chip.write(address, reg, before[0])
        has_complained = chip.complaint() is not None
        assert has_complained is (reg not in WRITABLE[address]), hex(reg)
        assert chip.read(address, reg) == before


@pytest.mark.parametrize(
    ("address", "reg", "value", "kept"),
    [
        (G, 0x21, 0x40, 0x00),  # DS CTRL_REG2_G: must not be changed
        (G, 0x23, 0x08, 0x00),
        (G, 0x24, 0x20, 0x00),
        (XM, 0x1F, 0x08, 0x00),
        (XM, 0x25, 0x21, 0x20),
        (XM, 0x25, 0xA0, 0x20),
        (XM, 0x26, 0x0A, 0x02),
        (XM, 0x26, 0x12, 0x02),
    ],
)
def test_reserved_bits_stay_and_complain(
    address: int, reg: int, value: int, kept: int
) -> None:
    chip = Chip()
    chip.write(address, reg, value)
    assert "reserved" in str(chip.complaint())
    assert chip.read(address, reg) == [kept]


@pytest.mark.parametrize(
    ("address", "reg", "value"),
    [
        (G, 0x22, 0x80),  # interrupts on INT_G
        (G, 0x22, 0x04),  # FIFO watermark on DRDY_G
        (G, 0x23, 0x01),  # 3-wire SPI
        (G, 0x24, 0x40),  # FIFO
        (G, 0x24, 0x10),  # high-pass filter
        (G, 0x24, 0x01),  # its data
        (G, 0x2E, 0x40),  # stream mode
        (G, 0x30, 0x20),
        (XM, 0x12, 0xE9),  # magnetic interrupt
        (XM, 0x16, 0x01),  # offset
        (XM, 0x1F, 0x40),
        (XM, 0x22, 0x20),
        (XM, 0x23, 0x01),
        (XM, 0x26, 0x22),  # AFDS: filtered acceleration
        (XM, 0x2E, 0x20),
        (XM, 0x30, 0x01),
        (XM, 0x38, 0x01),
        (XM, 0x3E, 0x01),
    ],
)
def test_what_is_not_modelled_complains(address: int, reg: int, value: int) -> None:
    chip = Chip()
    chip.write(address, reg, value)
    assert "not modelled" in str(chip.complaint())


@pytest.mark.parametrize(
    "writes",
    [
        [(G, 0x23, 0x04)],  # DS CTRL_REG4_G: ST 10
        [(XM, 0x20, 0xB7)],  # DS CTRL_REG1_XM: AODR 1011
        [(XM, 0x21, 0x28)],  # DS CTRL_REG2_XM: AFS 101
        [(XM, 0x21, 0x06)],  # AST 11: not allowed
        [(XM, 0x24, 0x34)],  # DS CTRL_REG5_XM: M_RES 01
        [(XM, 0x26, 0x00)],  # M_ODR 110, as after reset: do not use
        [(XM, 0x24, 0x14), (XM, 0x20, 0x57), (XM, 0x26, 0x00)],  # 100 Hz beside 50
        [(XM, 0x24, 0x14), (XM, 0x26, 0x00), (XM, 0x20, 0x17)],
    ],
)
def test_values_that_the_data_sheet_forbids_complain(
    writes: list[tuple[int, int, int]],
) -> None:
    chip = Chip()
    for address, reg, value in writes:
        assert chip.complaint() is None
        chip.write(address, reg, value)
    assert chip.complaint() is not None


@pytest.mark.parametrize("ctrl1", [0x07, 0x67, 0xA7])
def test_100_hz_of_the_magnetometer_goes_with_the_accelerometer_off_or_fast(
    chip: Chip, ctrl1: int
) -> None:
    chip.write(XM, 0x20, ctrl1)
    chip.run_mag()


def test_a_reboot_clears_its_bit_and_keeps_the_registers() -> None:
    chip = Chip(startup_ns=10 * MS)
    chip.wait(10)
    chip.run_gyro()
    chip.run_accel()
    chip.write(G, 0x24, 0x80)
    chip.write(XM, 0x1F, 0x80)
    before = chip.samples(GYR), chip.samples(ACC)
    chip.wait(9)
    assert chip.read(G, 0x24) == chip.read(XM, 0x1F) == [0x80]
    assert (chip.samples(GYR), chip.samples(ACC)) == before
    chip.wait(10)
    assert chip.read(G, 0x24) == chip.read(XM, 0x1F) == [0x00]
    assert chip.read(G, 0x20) == [0xBF]
    assert chip.read(XM, 0x20) == [0x8F]
    assert chip.samples(GYR) > before[0]
    assert chip.samples(ACC) > before[1]
    assert chip.complaint() is None
    chip.write(XM, 0x1F, 0x80)
    chip.write(XM, 0x20, 0x07)
    assert "reboot" in str(chip.complaint())


# Sample clocks


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


def test_mlp_slows_the_magnetometer_to_3_hz(chip: Chip) -> None:
    chip.run_mag(ctrl7=0x04)  # DS CTRL_REG7_XM
    first, second = chip.times(MAG, 2)
    assert second - first == 320 * MS


def test_all_is_off_after_power_up(chip: Chip) -> None:
    assert lib.lsm9ds0_chip_next_event(chip.chip) == 2**64 - 1
    chip.wait(1000)
    assert [chip.status(q) for q in (GYR, ACC, MAG)] == [0, 0, 0]


def test_power_down_and_sleep_stop_a_sensor(chip: Chip) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.run_mag()
    chip.wait(100)
    chip.write(G, 0x20, 0xB8)  # DS table 22: PD 1, no axis: sleep
    chip.write(XM, 0x20, 0x0F)
    chip.write(XM, 0x26, 0x03)
    before = [chip.samples(q) for q in (GYR, ACC, MAG)]
    chip.wait(1000)
    chip.write(G, 0x20, 0xB7)  # PD 0: power-down
    chip.wait(1000)
    assert [chip.samples(q) for q in (GYR, ACC, MAG)] == before


def test_a_single_conversion_is_one(chip: Chip) -> None:
    chip.run_mag(ctrl7=0x01)
    assert chip.read(XM, 0x26) == [0x01]
    chip.wait(1000)
    assert chip.samples(MAG) == 1
    assert chip.read(XM, 0x26) == [0x02]
    chip.write(XM, 0x26, 0x01)
    chip.wait(1000)
    assert chip.samples(MAG) == 2


def test_the_dies_drift_apart_by_their_clocks() -> None:
    chip = Chip(g_rate_error_ppm=1000.0, xm_rate_error_ppm=-500.0)
    chip.run_gyro()
    chip.run_accel()
    chip.run_mag()
    start = [chip.samples(q) for q in (GYR, ACC, MAG)]
    chip.wait(100_000)
    taken = [chip.samples(q) - s for q, s in zip((GYR, ACC, MAG), start, strict=True)]
    assert taken == pytest.approx([38_038, 39_980, 9_995], abs=1)


@pytest.mark.parametrize("ppm", [-10_000.0, 250.0, 10_000.0])
def test_a_rate_error_adds_up_without_drift(ppm: float) -> None:
    chip = Chip(g_rate_error_ppm=ppm)
    chip.run_gyro(ctrl1=0xFF)
    times = chip.times(GYR, 15_201)
    period = (times[-1] - times[0]) / 15_200
    assert period == pytest.approx(1e9 / 760 / (1 + ppm * 1e-6), abs=0.01)


# Numbers


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


def test_bytes_can_be_big_endian_in_the_gyroscope(chip: Chip) -> None:
    chip.run_gyro(ctrl4=0xE0)  # DS CTRL_REG4_G: BLE
    chip.hold(gyr=(math.radians(0x1234 * 0.07), 0, 0))
    chip.sample(GYR)
    assert chip.read(G, ON | 0x28, 2) == [0x12, 0x34]


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
    chip.write(G, 0x24, 0x02)  # DS CTRL_REG5_G: Out_Sel
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


@pytest.mark.parametrize(("quantity", "hz"), [(GYR, 380), (ACC, 400)])
def test_recorded_motion_is_brought_to_the_rate_alone(quantity: int, hz: float) -> None:
    motion, asked = recorder(quantity)
    chip = Chip(motion=motion, is_recorded=True)
    run(chip, quantity)
    now = chip.sample(quantity)
    half = round(0.5e9 / hz)
    assert asked == [(now - half, now + half)]


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
    chip.write(G, 0x20, 0xB8)  # from sleep it is on at once: it swings on
    chip.write(G, 0x20, 0xBF)
    chip.sample(GYR)
    assert 0 not in chip.counts(GYR)
    chip.write(G, 0x20, 0x00)
    chip.write(G, 0x20, 0xBF)
    chip.sample(GYR)
    assert chip.counts(GYR) == [0, 0, 0]


@pytest.mark.parametrize(
    ("celsius", "counts"), [(25.0, 0), (26.0, 8), (-40.0, -520), (85.0, 480)]
)
def test_temperature_in_eighths_of_a_degree(
    chip: Chip, celsius: float, counts: int
) -> None:
    lib.lsm9ds0_chip_set_temperature(chip.chip, celsius)
    chip.run_mag()
    chip.sample(MAG)
    data = bytes(chip.read(XM, ON | 0x05, 2))  # DS table 4: 8 LSB/degC
    assert int.from_bytes(data, "little", signed=True) == counts


def test_temperature_stands_without_its_enable_bit(chip: Chip) -> None:
    lib.lsm9ds0_chip_set_temperature(chip.chip, 40.0)
    chip.run_mag(ctrl5=0x74)
    chip.sample(MAG)
    assert chip.read(XM, ON | 0x05, 2) == [0, 0]


# Status, block data update, data-ready


@every_sensor
def test_a_sample_sets_its_flags_and_high_bytes_clear_them(
    chip: Chip, quantity: int
) -> None:
    address, _, out = PLACES[quantity]
    run(chip, quantity)
    chip.sample(quantity)
    assert chip.status(quantity) == 0x0F
    chip.read(address, out)  # X low: nothing (AN3308)
    assert chip.status(quantity) == 0x0F
    seen = []
    for reg in (out + 1, out + 3, out + 5):
        chip.read(address, reg)
        seen.append(chip.status(quantity))
    assert seen == [0x0E, 0x0C, 0x00]


@every_sensor
def test_a_sample_unread_is_overrun(chip: Chip, quantity: int) -> None:
    run(chip, quantity)
    chip.sample(quantity)
    chip.sample(quantity)
    assert chip.status(quantity) == 0xFF
    chip.counts(quantity)
    assert chip.status(quantity) == 0x00


@every_sensor
def test_without_bdu_a_word_can_be_torn(chip: Chip, quantity: int) -> None:
    address, _, out = PLACES[quantity]
    chip.hold(gyr=(1, 1, 1), acc=(3, 3, 3), mag=(30, 30, 30))
    run(chip, quantity, bdu=False)
    chip.sample(quantity)
    low = chip.read(address, out)
    chip.hold(gyr=(0, 0, 0), acc=(0, 0, 0), mag=(0, 0, 0))
    chip.sample(quantity)
    assert low != [0]
    assert chip.read(address, out + 1) == [0]


@every_sensor
def test_bdu_holds_an_axis_until_both_halves_are_read(
    chip: Chip, quantity: int
) -> None:
    address, _, out = PLACES[quantity]
    chip.hold(gyr=(1, 1, 1), acc=(3, 3, 3), mag=(30, 30, 30))
    run(chip, quantity)
    chip.sample(quantity)
    before = chip.counts(quantity)
    chip.sample(quantity)
    low = chip.read(address, out)
    chip.hold(gyr=(0, 0, 0), acc=(0, 0, 0), mag=(0, 0, 0))
    chip.sample(quantity)
    word = bytes(low + chip.read(address, out + 1))
    assert int.from_bytes(word, "little", signed=True) == before[0]
    # It is followed by what came meanwhile, which is new.
    assert chip.status(quantity) & 0x09 == 0x09
    assert chip.counts(quantity) == [0, 0, 0]


def test_bdu_does_not_hold_the_axes_together(chip: Chip) -> None:
    chip.hold(acc=(3, 3, 3))
    chip.run_accel()
    chip.sample(ACC)
    old = round(3 / GRAVITY * 1000 / 0.732)
    lib.lsm9ds0_chip_start(chip.chip, chip.now[0], XM, False)
    lib.lsm9ds0_chip_write(chip.chip, chip.now[0], ON | 0x28)
    lib.lsm9ds0_chip_start(chip.chip, chip.now[0], XM, True)
    data = [lib.lsm9ds0_chip_read(chip.chip, chip.now[0], True) for _ in range(3)]
    chip.hold(acc=(0, 0, 0))
    chip.sample(ACC)  # after X and a half of Y
    data += [lib.lsm9ds0_chip_read(chip.chip, chip.now[0], i < 2) for i in range(3)]
    lib.lsm9ds0_chip_stop(chip.chip, chip.now[0])
    words = [
        int.from_bytes(bytes(data[i : i + 2]), "little", signed=True) for i in (0, 2, 4)
    ]
    assert words == [old, old, 0]


def test_two_samples_behind_a_held_axis_are_an_overrun(chip: Chip) -> None:
    chip.run_gyro()
    chip.sample(GYR)
    chip.read(G, 0x28)
    chip.sample(GYR)
    assert chip.status(GYR) & 0x90 == 0x00
    chip.sample(GYR)
    assert chip.status(GYR) & 0x10 == 0x10


@every_sensor
def test_bdu_off_lets_go(chip: Chip, quantity: int) -> None:
    address, _, out = PLACES[quantity]
    run(chip, quantity)
    chip.sample(quantity)
    chip.read(address, out)
    chip.hold(gyr=(1, 1, 1), acc=(3, 3, 3), mag=(30, 30, 30))
    chip.sample(quantity)
    chip.write(*{G: (G, 0x23, 0x20), XM: (XM, 0x20, 0x87)}[address])
    x, y, _ = chip.counts(quantity)
    assert x == y


def test_disabled_axes_are_not_updated(chip: Chip) -> None:
    chip.hold(gyr=(1, 1, 1), acc=(3, 3, 3))
    chip.run_gyro(ctrl1=0xBD)  # Z, X
    chip.run_accel(ctrl1=0x8A)  # Y
    chip.sample(GYR)
    chip.sample(ACC)
    chip.sample(GYR)
    chip.sample(ACC)
    assert chip.status(GYR) & 0x0F == 0x0D
    assert chip.status(ACC) & 0x0F == 0x0A
    assert [c != 0 for c in chip.counts(GYR)] == [True, False, True]
    assert [c != 0 for c in chip.counts(ACC)] == [False, True, False]
    assert chip.status(GYR) == 0x00  # only enabled axes count


def test_an_axis_that_is_off_holds_no_flag_up(chip: Chip) -> None:
    chip.run_gyro()
    chip.sample(GYR)
    chip.write(G, 0x20, 0xBD)  # Y off, its value unread
    chip.read(G, 0x29)
    chip.read(G, 0x2D)
    assert not chip.is_high(DRDY_G)


PINS = [
    (GYR, DRDY_G, None),
    (ACC, INT1, (0x22, 0x04)),
    (ACC, INT2, (0x23, 0x08)),
    (MAG, INT1, (0x22, 0x02)),
    (MAG, INT2, (0x23, 0x04)),
]


@pytest.mark.parametrize(("quantity", "pin", "enable"), PINS)
def test_data_ready_is_high_from_the_sample_until_all_is_read(
    chip: Chip, quantity: int, pin: int, enable: tuple[int, int] | None
) -> None:
    run(chip, quantity)
    chip.write(XM, ON | 0x22, 0x00, 0x00)
    if enable is not None:
        chip.write(XM, *enable)
    assert not chip.is_high(pin)
    chip.sample(quantity)
    others = {DRDY_G, INT1, INT2} - {pin}
    assert chip.is_high(pin)
    assert not any(chip.is_high(other) for other in others - {DRDY_G})
    chip.sample(quantity)
    assert chip.is_high(pin)  # no edge without a reading
    address, _, out = PLACES[quantity]
    chip.read(address, ON | out, 5)
    assert chip.is_high(pin)
    chip.read(address, out + 5)
    assert not chip.is_high(pin)


def test_data_ready_of_the_gyroscope_has_its_enable_bit(chip: Chip) -> None:
    chip.run_gyro()
    chip.write(G, 0x22, 0x00)
    chip.sample(GYR)
    assert not chip.is_high(DRDY_G)
    chip.write(G, 0x22, 0x28)  # H_Lactive is of INT_G
    assert chip.is_high(DRDY_G)


def test_pins_of_the_xm_die_can_be_active_low(chip: Chip) -> None:
    chip.write(XM, 0x12, 0xE0)  # DS INT_CTRL_REG_M: IEA
    chip.run_accel()
    assert chip.is_high(INT1)
    chip.sample(ACC)
    assert not chip.is_high(INT1)
    assert chip.is_high(INT2)


def test_one_pin_can_tell_of_both_sensors(chip: Chip) -> None:
    chip.run_accel()
    chip.run_mag()
    chip.write(XM, 0x22, 0x06)
    chip.sample(MAG)
    chip.counts(MAG)
    assert chip.is_high(INT1)
    chip.counts(ACC)
    assert not chip.is_high(INT1)


def test_edges_follow_the_rate_where_each_sample_is_read(chip: Chip) -> None:
    chip.run_gyro(ctrl1=0xFF)
    rises = []
    for _ in range(760):
        assert not chip.is_high(DRDY_G)
        rises.append(chip.sample(GYR))
        assert chip.is_high(DRDY_G)
        assert chip.read(G, ON | 0x27, 7)[0] == 0x0F
    steps = {b - a for a, b in itertools.pairwise(rises)}
    assert steps == {1_315_789, 1_315_790}  # 760 Hz, to the nanosecond


# Self-test


@pytest.mark.parametrize(
    ("fs", "low", "high"),
    [(0, 20, 250), (1, 70, 400), (2, 150, 1000)],  # DS table 3
)
@pytest.mark.parametrize(
    ("st", "signs"),
    [(1, [1, -1, -1]), (3, [-1, 1, 1])],  # DS CTRL_REG4_G
)
def test_a_good_gyroscope_passes_its_self_test(
    chip: Chip, fs: int, low: float, high: float, st: int, signs: list[int]
) -> None:
    mdps = (8.75, 17.50, 70.0)[fs]
    chip.hold(gyr=(0.1, 0.1, -0.1))
    chip.run_gyro(ctrl4=0x80 | (fs << 4))
    chip.sample(GYR)
    off = chip.counts(GYR)
    chip.write(G, 0x23, 0x80 | (fs << 4) | (st << 1))
    chip.sample(GYR)
    on = chip.counts(GYR)
    dps = [(b - a) * mdps / 1000 for a, b in zip(off, on, strict=True)]
    assert [math.copysign(1, v) for v in dps] == signs
    assert all(low <= abs(v) <= high for v in dps)


@pytest.mark.parametrize(("ast", "sign"), [(1, 1), (2, -1)])  # DS CTRL_REG2_XM
@pytest.mark.parametrize(("afs", "mg"), [(0, 0.061), (3, 0.244)])
def test_a_good_accelerometer_passes_its_self_test(
    chip: Chip, ast: int, sign: int, afs: int, mg: float
) -> None:
    chip.run_accel(ctrl2=afs << 3)
    chip.sample(ACC)
    off = chip.counts(ACC)
    chip.write(XM, 0x21, (afs << 3) | (ast << 1))
    chip.sample(ACC)
    on = chip.counts(ACC)
    responses = [sign * (b - a) * mg for a, b in zip(off, on, strict=True)]
    assert all(60 <= response <= 1700 for response in responses)  # DS table 3


@pytest.mark.parametrize("kind", ["GYR_SELF_TEST", "ACC_SELF_TEST"])
def test_a_broken_sensor_fails_its_self_test(chip: Chip, kind: str) -> None:
    chip.hold(acc=(0, 0, 0))
    chip.fault(kind)
    chip.run_gyro(ctrl4=0x82)
    chip.run_accel(ctrl2=0x02)
    chip.sample(ACC)
    chip.sample(GYR)
    gyr_dps = [abs(c) * 0.00875 for c in chip.counts(GYR)]
    acc_mg = [c * 0.061 for c in chip.counts(ACC)]
    assert (max(gyr_dps) < 20) is (kind == "GYR_SELF_TEST")
    assert (max(acc_mg) < 60) is (kind == "ACC_SELF_TEST")


# Faults


@pytest.mark.parametrize("byte", [0, 1, 2])
def test_a_nack_hits_its_byte_of_its_transaction(chip: Chip, byte: int) -> None:
    chip.fault("NACK", first=3, transactions=1, at_byte=byte)
    results = [chip.try_write(XM, 0x22, 0x04) for _ in range(5)]
    assert results == [0, 0, -1, 0, 0]
    assert lib.lsm9ds0_chip_transactions(chip.chip) == 5


def test_a_nack_lasts_for_its_span_and_is_of_its_die(chip: Chip) -> None:
    chip.fault("NACK", "G", from_ns=10 * MS, for_ns=10 * MS)
    assert chip.try_read(G, 0x0F) == 0
    chip.wait(11)
    assert chip.try_read(G, 0x0F) == -1
    assert chip.try_read(XM, 0x0F) == 0
    chip.wait(9)
    assert chip.try_read(G, 0x0F) == 0


def test_a_stuck_line_needs_its_clocks(chip: Chip) -> None:
    chip.fault("STUCK_SDA", first=2, transactions=1, at_byte=2, clocks=5)
    assert chip.try_read(G, 0x0F) == 0
    assert chip.try_read(G, 0x0F) == -3
    assert chip.try_read(XM, 0x0F) == -3  # one wire for both
    for pulse in range(5):
        assert lib.lsm9ds0_chip_holds_sda(chip.chip, chip.now[0]), pulse
        lib.lsm9ds0_chip_scl_pulse(chip.chip, chip.now[0])
    assert not lib.lsm9ds0_chip_holds_sda(chip.chip, chip.now[0])
    lib.lsm9ds0_chip_stop(chip.chip, chip.now[0])
    assert chip.read(G, 0x0F) == [0xD4]


def test_a_stuck_line_can_free_itself(chip: Chip) -> None:
    chip.fault("STUCK_SDA", from_ns=5 * MS, for_ns=3 * MS)
    assert chip.try_read(XM, 0x0F) == 0
    chip.wait(5)
    assert chip.try_read(XM, 0x0F) == -3
    chip.wait(3)
    assert chip.try_read(XM, 0x0F) == 0


@pytest.mark.parametrize(
    ("die", "goes_on"), [("BOTH", [0, 0]), ("G", [0, 40]), ("XM", [38, 0])]
)
def test_data_ready_can_stop(chip: Chip, die: str, goes_on: list[int]) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.wait(100)
    chip.fault("NO_DATA_READY", die, from_ns=chip.now[0], for_ns=100 * MS)
    before = [chip.samples(q) for q in (GYR, ACC)]
    chip.wait(99.9)
    middle = [chip.samples(q) for q in (GYR, ACC)]
    taken = [b - a for a, b in zip(before, middle, strict=True)]
    assert taken == pytest.approx(goes_on, abs=1)
    chip.wait(100)
    after = [chip.samples(q) for q in (GYR, ACC)]
    assert min(b - a for a, b in zip(middle, after, strict=True)) >= 37


@pytest.mark.parametrize(
    ("die", "expected"),
    [("BOTH", [0x68, 0x68]), ("G", [0x68, 0x49]), ("XM", [0xD4, 0x68])],
)
def test_who_am_i_can_be_wrong_in_either_half(
    chip: Chip, die: str, expected: list[int]
) -> None:
    chip.fault("WRONG_WHO_AM_I", die, value=0x68)
    assert chip.read(G, 0x0F) + chip.read(XM, 0x0F) == expected


def test_a_dead_magnetometer_leaves_the_accelerometer(chip: Chip) -> None:
    chip.fault("NO_MAG")
    chip.run_accel()
    chip.run_mag()
    chip.wait(1000)
    assert chip.status(MAG) == 0x00
    assert chip.counts(MAG) == [0, 0, 0]
    assert not chip.is_high(INT2)
    assert chip.is_high(INT1)


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.sample(GYR)
    chip.sample(ACC)
    frozen = chip.counts(GYR)
    chip.fault("FROZEN", "G")
    chip.hold(gyr=(1, 2, 3), acc=(4, 5, 6))
    chip.sample(ACC)
    chip.sample(GYR)
    assert chip.status(GYR) & 0x0F == 0x0F
    assert chip.counts(GYR) == frozen
    assert 0 not in chip.counts(ACC)
    lib.lsm9ds0_chip_clear_faults(chip.chip)
    chip.sample(GYR)
    assert chip.counts(GYR) != frozen


def test_power_loss_forgets_everything(chip: Chip) -> None:
    chip.run_gyro()
    chip.run_accel()
    chip.run_mag()
    chip.wait(50)
    lib.lsm9ds0_chip_power_cycle(chip.chip, chip.now[0])
    assert chip.read(G, ON | 0x20, 5) == [0x07, 0, 0, 0, 0]
    assert chip.read(XM, ON | 0x20, 7) == [0x07, 0, 0, 0, 0x18, 0x20, 0x02]
    chip.wait(100)
    assert [chip.status(q) for q in (GYR, ACC, MAG)] == [0, 0, 0]


def test_two_chips_do_the_same() -> None:
    def story() -> list[int]:
        chip = Chip(g_rate_error_ppm=37.0, xm_rate_error_ppm=-11.0)
        chip.run_gyro()
        chip.run_accel()
        chip.run_mag()
        told = []
        for i in range(200):
            chip.hold(gyr=(0.01 * i, 0, 0), acc=(0, 0.1 * i, 0), mag=(0, 0, 0.2 * i))
            told += [chip.sample(GYR), *chip.read(G, ON | 0x27, 7)]
            told += chip.read(XM, ON | 0x07, 7) + chip.read(XM, ON | 0x27, 7)
        return told

    assert story() == story()


def test_there_is_room_for_32_faults(chip: Chip) -> None:
    for _ in range(32):
        chip.fault("NACK", first=100, transactions=1)
    fault = ffi.new("struct lsm9ds0_chip_fault *")
    assert not lib.lsm9ds0_chip_add_fault(chip.chip, fault)
