# SPDX-License-Identifier: MIT
"""How the MPU-9250's driver monitors its chip: registers that change unexpectedly,
a magnetometer that goes, comes back, or holds its bus."""

from __future__ import annotations

import pytest

from core.mpu9250_desk import (
    ACC_LSB,
    MAG_LSB,
    Bench,
    G,
    ffi,
    lib,
    running,
)

ROUND = 13  # checks that read back all registers, one each
# Register map, by number, with a value that is not the driver's.
FLIPS = {
    25: 0x00,  # rate divider
    26: 0x03,  # filters
    27: 0x00,  # ranges
    28: 0x00,
    29: 0x03,
    36: 0x00,  # the master: clock, its slave
    37: 0x0C,
    38: 0x03,
    39: 0x00,
    55: 0x80,  # data-ready pin
    56: 0x00,
    107: 0x00,  # clock
    108: 0x07,  # axes off
}


def clock_nine_times(bench: Bench) -> bool:
    """Free the bus as a board does; true where the data line is high then."""
    for _ in range(9):
        bench.now_ns += 10_000
        bench.chip.pulse()
    return not bench.chip.holds_sda()


def test_a_healthy_chip_passes_every_check_by_one_read_each():
    bench = running()
    before = bench.transactions
    results = bench.checks(4 * ROUND)
    assert set(results) == {lib.SENSOR_BUSY, lib.SENSOR_OK}
    assert results.count(lib.SENSOR_OK) == 4
    assert bench.transactions - before == 4 * ROUND  # samples are not counted
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)
    assert bench.complaint is None


def check_until_failure(bench: Bench, most: int) -> int:
    for _ in range(most):
        bench.driver.mag_age = 0  # as after a measurement
        result = bench.check()
        if result < 0:
            return result
    raise AssertionError("nothing was noticed")


@pytest.mark.parametrize(("reg", "value"), FLIPS.items())
def test_a_register_that_changes_by_itself_is_noticed_within_a_round(reg, value):
    bench = running()
    bench.flip(bench.chip, reg, value)
    assert check_until_failure(bench, ROUND) == lib.SENSOR_UNSET
    assert bench.identity.wrong_register == reg
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.wrong_register == 0
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)


def test_a_chip_that_lost_its_power_alone_is_noticed_by_the_next_check():
    bench = running()
    bench.chip.fault("BROWN_OUT", from_ns=bench.now_ns)
    bench.let_pass(200_000)
    assert check_until_failure(bench, ROUND) == lib.SENSOR_UNSET
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)


def test_a_pulled_wire_is_reported_by_a_check():
    bench = running()
    bench.pulled_at = bench.transactions + 1
    assert bench.check() == lib.SENSOR_BUS_NACK


def test_an_absent_magnetometer_is_found_when_it_answers():
    bench = Bench()
    bench.chip.fault("NO_MAG")
    assert bench.set_up() == lib.SENSOR_OK
    assert all(result >= 0 for result in bench.checks(3 * ROUND))
    assert bench.chip.peek(55) == 0x00, "the bypass is not left on"
    bench.chip.clear_faults()
    assert check_until_failure(bench, ROUND) == lib.SENSOR_MAG_CHANGED
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x71, 0x48]
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)


def test_looking_for_a_magnetometer_disturbs_no_sample():
    bench = running(who_am_i=0x70, has_ak8963=False)
    for _ in range(3 * ROUND):
        assert bench.samples(3)[-1].acc.z == pytest.approx(G / ACC_LSB, abs=1)
        before_ns = bench.now_ns
        assert bench.check() >= 0
        assert bench.now_ns - before_ns < 400_000
    assert bench.complaint is None


@pytest.mark.parametrize("clocks", range(1, 10))
def test_a_magnetometer_that_holds_its_bus_is_clocked_free(clocks):
    bench = running()
    bench.chip.fault("MAG_HUNG", from_ns=bench.now_ns, clocks=clocks)
    bench.let_pass(20_000)
    # Its chip waits for it, so that data-ready stops: the probe sets it up again.
    assert bench.set_up() == lib.SENSOR_MAG_STUCK
    assert clock_nine_times(bench)
    assert bench.set_up() == lib.SENSOR_OK
    assert list(bench.identity.who_am_i) == [0x71, 0x48]
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)
    assert bench.complaint is None


def test_a_magnetometer_that_holds_its_bus_from_power_on_is_left_out():
    # Nothing will free it, and through the bypass it would hold the host's bus.
    bench = Bench()
    bench.chip.fault("MAG_HUNG")
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.kind == lib.SENSOR_MPU6500
    assert all(result >= 0 for result in bench.checks(5 * ROUND))
    assert bench.settled().acc.z == pytest.approx(G / ACC_LSB, abs=1)


def test_a_magnetometer_that_holds_its_bus_as_it_is_looked_for_is_clocked_free():
    bench = Bench()
    bench.chip.fault("NO_MAG")
    assert bench.set_up() == lib.SENSOR_OK
    bench.chip.clear_faults()
    bench.chip.fault("MAG_HUNG", from_ns=bench.now_ns, clocks=4)
    results = bench.checks(ROUND)
    assert results[-1] == lib.SENSOR_MAG_STUCK
    assert clock_nine_times(bench)
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.kind == lib.SENSOR_MPU9250


def spoil(bench: Bench) -> int:
    """A set-up in which the magnetometer holds the bus once it is on the host's."""
    bench.call("begin")
    bench.log.clear()
    while not bench.log or bench.log[-1][1::2] != ("write", 55):
        if (result := bench.step()) != lib.SENSOR_BUSY:
            return result
        bench.let_pass(1000)
    bench.chip.fault("MAG_HUNG", from_ns=bench.now_ns, clocks=9)
    while (result := bench.step()) == lib.SENSOR_BUSY:
        bench.let_pass(1000)
    assert clock_nine_times(bench)
    return result


def test_a_magnetometer_that_spoils_three_set_ups_is_left_out_for_a_while():
    bench = Bench()
    for _ in range(3):
        assert spoil(bench) == lib.SENSOR_MAG_STUCK
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.kind == lib.SENSOR_MPU6500
    results = bench.checks(8 * ROUND)
    assert all(result >= 0 for result in results[:-1])
    assert results[-1] == lib.SENSOR_MAG_CHANGED
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.identity.kind == lib.SENSOR_MPU9250


def kinds_of(bench: Bench, set_ups: int) -> tuple[list[int], list[int]]:
    """The kind of sensor in each of some set-ups in a row, and its looks."""
    kinds, looks = [], []
    for _ in range(set_ups):
        assert bench.set_up() == lib.SENSOR_OK
        kinds.append(bench.identity.kind)
        looks.append(1)
        while bench.samples(4) and bench.check() >= 0:
            looks[-1] += 1
    return kinds, looks


def test_a_magnetometer_that_never_measures_is_left_out_and_tried_ever_later():
    bench = Bench()
    bench.chip.fault("MAG_IDLE")
    kinds, looks = kinds_of(bench, 8)
    nine, six = lib.SENSOR_MPU9250, lib.SENSOR_MPU6500
    assert kinds == [nine, nine, nine, six, nine, six, nine, six]
    assert looks[0] == 6
    assert [count // ROUND for count in looks[3::2]] == [8, 16, 32]
    bench.chip.clear_faults()
    assert bench.set_up() == lib.SENSOR_OK
    assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)
    assert set(bench.checks(ROUND)) == {lib.SENSOR_BUSY, lib.SENSOR_OK}
    assert bench.driver.mag_failures == 0
    assert bench.complaint is None


PHASES = 30


def reset_in_the_midst_of_a_read(phase: int, *, stops_the_master: bool) -> Bench:
    """Reset the processor at some time of the read of the magnetometer, of 0.25 ms."""
    bench = running()
    bench.samples(5)
    bench.next_edge()  # data-ready follows the read
    bench.now_ns += 4_660_000 + phase * 280_000 // PHASES
    bench.chip.call("advance", bench.now_ns)
    if not stops_the_master:
        value = ffi.new("uint8_t *", 0x80)
        bench.write_chip(None, 0x68, 107, value, 1)  # H_RESET and nothing before it
        return bench
    bench.call("begin")
    while bench.chip.peek(107) == 0x01 and bench.chip.peek(56) == 0x01:
        bench.step()
        bench.let_pass(1000)
    return bench


def is_hung(bench: Bench) -> bool:
    result = bench.set_up()
    if result == lib.SENSOR_OK:
        return bool(bench.identity.kind != lib.SENSOR_MPU9250)
    return True


def test_a_chip_reset_while_its_master_reads_hangs_the_magnetometer():
    hung = [
        is_hung(reset_in_the_midst_of_a_read(phase, stops_the_master=False))
        for phase in range(PHASES)
    ]
    assert 5 <= sum(hung) < PHASES


def test_the_driver_stops_the_master_first_so_that_it_never_hangs():
    for phase in range(PHASES):
        bench = reset_in_the_midst_of_a_read(phase, stops_the_master=True)
        assert not is_hung(bench), f"phase {phase}"
        assert bench.settled_mag().y == pytest.approx(20 / MAG_LSB, abs=1.5)
