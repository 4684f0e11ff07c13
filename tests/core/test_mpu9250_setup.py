# SPDX-License-Identifier: MIT
"""The set-up of the MPU-9250, against the chip's model, and every failure of it."""

from __future__ import annotations

import pytest

from core.mpu9250_desk import (
    ACC_LSB,
    GYR_LSB,
    HOST_JUDGES,
    MAG_LSB,
    Bench,
    G,
    Scripted,
    lib,
    running,
    scripted,
)


def test_set_up_leaves_the_chip_as_the_documents_want_it():
    bench = running()
    assert bench.complaint is None
    # Register map, by number: rate divider, filters, ranges.
    assert [bench.chip.peek(reg) for reg in range(25, 30)] == [4, 2, 0x18, 0x18, 2]
    assert bench.chip.peek(36) == 0x4D  # wait for external sensors, 400 kHz
    assert [bench.chip.peek(reg) for reg in (37, 38, 39)] == [0x8C, 0x02, 0x88]
    assert bench.chip.peek(55) == 0x00  # INT: pulse, push-pull, active high
    assert bench.chip.peek(56) == 0x01  # data-ready
    assert bench.chip.peek(106) == 0x20  # the I2C master is on
    assert bench.chip.peek(107) == 0x01  # awake, clock by the gyroscope
    assert bench.chip.peek(0x0A, 2) == 0x16  # 100 Hz, 16 bits
    assert bench.chip.peek(0x0C, 2) == 0x00  # no self-test field


def test_identity_tells_chip_units_and_verdict():
    identity = running(mag_adjust=[170, 180, 160]).identity
    assert identity.kind == lib.SENSOR_MPU9250
    assert list(identity.who_am_i) == [0x71, 0x48]
    assert list(identity.mag_adjust) == [170, 180, 160]
    assert identity.self_test == HOST_JUDGES
    assert identity.rate_hz == 200
    assert identity.gyr_lsb_nrad_s == round(GYR_LSB * 1e9)
    assert identity.acc_lsb_nm_s2 == round(ACC_LSB * 1e9)
    assert identity.mag_lsb_pt == round(MAG_LSB * 1e6)


def test_a_burst_is_one_read_of_all_sensors():
    assert running().bursts == [(0x68, 0x3B, 22)]


def test_set_up_waits_as_long_as_the_documents_want():
    bench = Bench()
    assert bench.set_up(100) == lib.SENSOR_OK
    log = [(us / 1e3, what, reg) for us, what, _, reg, _ in bench.log]
    resets, wakes = (
        [t for t, *what in log if what == ["write", 107]][i] for i in (0, 1)
    )
    identified = next(t for t, *what in log if what == ["read", 117])
    assert identified >= 100  # after power: the start-up of the registers
    assert identified < next(t for t, what, _ in log if what == "write")
    assert wakes - resets >= 100
    assert next(t for t, *_ in log if t > resets) == wakes
    reads = [t for t, *what in log if what == ["read", 59]]
    assert len(reads) == 3
    assert reads[0] - wakes >= 35  # the gyroscope's start-up
    # Six delays of the low-pass after each change of the stimulus.
    changes = [t for t, *what in log if what == ["write", 28]]
    for read, changed in zip(reads, changes, strict=False):
        assert read - changed >= 100


@pytest.mark.parametrize("who", [0x00, 0xFF])
def test_a_bus_that_nobody_drives_is_no_chip(who):
    bench = Bench()
    bench.chip.fault("WRONG_WHO_AM_I", value=who)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert bench.identity.who_am_i[0] == who


@pytest.mark.parametrize("who", range(1, 0xFF))
def test_a_chip_of_any_other_identity_runs_and_is_named(who):
    bench = running(who_am_i=who)
    assert bench.identity.kind == lib.SENSOR_MPU9250
    assert list(bench.identity.who_am_i) == [who, 0x48]
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)


# Registers that are not an MPU-9250's, as often as they repeat; all at 0x68. DS3231 at
# a Wednesday 12:45; DS1307 with RAM as it may start; PCF8523 on a Monday in June;
# DS3232 with RAM of zeros; BMI160 and ICM-20948, which have their names at 0x00.
OTHERS = {
    "DS3231": bytes.fromhex("304512032811260000000000000000 1c080019"),
    "DS1307": bytes.fromhex("30451203281126") + bytes([0xFF] * 57),
    "PCF8523": bytes.fromhex("000000304512280106260000000000000000 0000"),
    "DS3232": bytes.fromhex("304512032811260000000000000000 1c08001940") + bytes(236),
    "BMI160": b"\xd1" + bytes(127),
    "ICM-20948": b"\xea" + bytes(127),
}


@pytest.mark.parametrize("name", OTHERS)
def test_nothing_is_written_to_another_chip_at_the_address(name):
    registers = OTHERS[name]

    def read(_, __, reg, data, length):
        for at in range(length):
            data[at] = registers[(reg + at) % len(registers)]
        return lib.BUS_OK

    writes: list[object] = []
    bench = Bench(read=read, write=lambda *what: writes.append(what) or lib.BUS_OK)
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert writes == []
    named = {"BMI160": 0xD1, "ICM-20948": 0xEA}.get(name)
    assert named in (None, bench.identity.who_am_i[0])


@pytest.mark.parametrize("power", [(0x00, 0), (0x40, 0), (0x01, 0x3F)])
def test_a_known_name_runs_however_another_firmware_left_it(power):
    chip = Scripted()
    chip.registers[107:109] = bytes(power)
    assert Bench(read=chip.read, write=chip.write).set_up() == lib.SENSOR_OK
    chip.name = 0x75
    chip.registers[107:109] = bytes(power)
    assert Bench(read=chip.read, write=chip.write).set_up() == lib.SENSOR_WRONG_CHIP


@pytest.mark.parametrize("reg", [25, 26, 27, 28, 29, 36, 37, 39, 56, 107])
def test_a_chip_whose_registers_keep_nothing_is_refused(reg):
    # A real-time clock or an EEPROM at the same address is such a chip.
    bench = scripted(deaf={reg})
    assert bench.set_up() == lib.SENSOR_UNSET
    assert bench.identity.wrong_register == reg


def assert_six_axes(bench: Bench) -> None:
    assert bench.identity.who_am_i[1] == 0
    assert list(bench.identity.mag_adjust) == [0, 0, 0]
    assert bench.identity.self_test == HOST_JUDGES
    assert bench.bursts[0][2] == 14
    bench.chip.hold(gyr=(1, 0, 0))
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
    assert bench.identity.kind == lib.SENSOR_MPU6500
    assert_six_axes(bench)
    assert (
        bench.chip.peek(106) == 0x00
    )  # no master that polls without an answer at each sample


def test_a_magnetometer_that_comes_back_is_found_by_the_next_set_up():
    bench = Bench()
    bench.chip.fault("NO_MAG")
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == 0
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x71, 0x48]
    assert bench.identity.self_test == HOST_JUDGES


@pytest.mark.parametrize("mag_id", [0x00, 0x47, 0x49, 0xFF])
def test_another_chip_at_the_magnetometers_address_is_not_used(mag_id):
    writes: list[object] = []
    bench = scripted(mag_id=mag_id, _write_mag=lambda *what: writes.append(what) or 0)
    assert bench.set_up() == lib.SENSOR_OK
    assert writes == []
    assert bench.identity.kind == lib.SENSOR_MPU6500
    assert bench.identity.who_am_i[1] == 0
    assert bench.bursts[0][2] == 14


@pytest.mark.parametrize(("refusals", "is_found"), [(1, True), (50, True), (51, False)])
def test_a_magnetometer_may_refuse_for_a_while(refusals, is_found):
    bench = scripted(refusals=refusals)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.who_am_i[1] == (0x48 if is_found else 0)
