# SPDX-License-Identifier: MIT
"""The model of the MPU-9250 against the manufacturers' documents: registers, sample
clock, interrupts, faults.

Numbers are typed from RM-MPU-9250A-00 (RM) and PS-MPU-9250A-01 (PS), not taken from the
model.
"""

from __future__ import annotations

import itertools

import pytest

from sim.chips.mpu9250_desk import AK, Chip, lib
from sim.chips.sensor_desk import MS


def test_reset_values_are_those_of_the_register_map(chip: Chip) -> None:
    defaults = lib.mpu9250_chip_defaults()
    expected = [0] * 128
    expected[58] = 0x01  # the sample clock runs
    expected[107] = 0x01  # RM 3
    expected[117] = 0x71
    expected[0:3] = list(defaults.gyr_self_test)
    expected[13:16] = list(defaults.acc_self_test)
    # Two bursts, because a burst that reaches FIFO_R_W (116) stays there.
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
    chip.sample()
    chip.bypass()
    chip.ak_mode(0x16)
    chip.write(107, 0x80)
    assert chip.read(25, 3) == [0, 0, 0]
    assert chip.read(107) == [0x01]
    assert chip.peek_ak8963(0x0A) == 0x16


def test_read_only_registers_keep_their_value_and_complain() -> None:
    chip = Chip()
    chip.write(117, 0x55)
    assert chip.read(117) == [0x71]
    assert chip.complaint() is not None


def test_unmodelled_registers_complain() -> None:
    slaves = (37, 0x0C), (39, 0xC0), (40, 0x8C), (52, 0x84), (99, 0x16), (103, 0x80)
    for reg, value in ((35, 0x78), (106, 0x40), (107, 0x20), (56, 0x10), *slaves):
        chip = Chip()
        chip.write(reg, value)
        assert chip.complaint() is not None


@pytest.mark.parametrize(
    ("fchoice_b", "dlpf", "divider", "hz"),
    [
        (0, 3, 4, 200.0),
        (0, 1, 0, 1000.0),
        (0, 6, 255, 1000 / 256),
        (0, 0, 4, 8000.0),  # RM 4.4: the divider needs the DLPF
        (0, 7, 4, 8000.0),
        (1, 3, 4, 32000.0),
        (2, 3, 4, 32000.0),
    ],
)
def test_data_ready_comes_at_the_rate_of_the_registers(
    chip: Chip, fchoice_b: int, dlpf: int, divider: int, hz: float
) -> None:
    chip.write(27, fchoice_b)
    chip.sample(divider, dlpf)
    chip.write(55, 0x00)
    before = chip.call("samples", lib.CHIP_GYR)
    chip.wait(2048)
    count = chip.call("samples", lib.CHIP_GYR) - before
    assert abs(count - 2.048 * hz) <= 1


def test_edges_are_5_ms_apart_at_200_hz(chip: Chip) -> None:
    chip.sample()
    edges = chip.edges(1000)
    assert len(edges) == 200
    assert {b - a for a, b in itertools.pairwise(edges)} == {5 * MS}


@pytest.mark.parametrize("ppm", [-10_000.0, 250.0, 10_000.0])
def test_a_rate_error_adds_up_without_drift(ppm: float) -> None:
    chip = Chip(rate_error_ppm=ppm)
    chip.sample()
    edges = chip.edges(20_000)
    period = (edges[-1] - edges[0]) / (len(edges) - 1)
    assert period == pytest.approx(5 * MS / (1 + ppm * 1e-6), abs=0.01)


def test_a_sleeping_chip_takes_no_samples(chip: Chip) -> None:
    chip.sample()
    chip.write(107, 0x41)
    assert chip.edges(100) == []
    chip.write(107, 0x01)
    assert len(chip.edges(100)) == 20


def test_int_is_a_pulse_of_50_us(chip: Chip) -> None:
    chip.sample()
    event = chip.next_event()
    chip.advance(event)
    assert chip.int_is_high()
    chip.advance(event + 49_999)
    assert chip.int_is_high()
    chip.advance(event + 50_000)
    assert not chip.int_is_high()


def test_a_latched_int_stays_until_the_status_is_read(chip: Chip) -> None:
    chip.write(55, 0x20)
    chip.sample()
    assert len(chip.edges(100)) == 1
    assert chip.int_is_high()
    chip.read(59, 14)
    assert chip.int_is_high()
    assert chip.read(58) == [0x01]
    assert not chip.int_is_high()
    assert chip.read(58) == [0x00]


def test_any_read_clears_a_latched_int_where_told_so(chip: Chip) -> None:
    chip.write(55, 0x30)
    chip.sample()
    chip.edges(6)
    assert chip.int_is_high()
    chip.read(59, 14)
    assert not chip.int_is_high()


def test_int_can_be_active_low(chip: Chip) -> None:
    chip.write(55, 0xA0)
    assert chip.int_is_high()
    chip.sample()
    chip.wait(6)
    assert not chip.int_is_high()


def test_no_int_without_its_enable_bit(chip: Chip) -> None:
    chip.sample()
    chip.write(56, 0x00)
    assert chip.edges(100) == []
    assert chip.read(58) == [0x01]


def test_an_mpu6500_has_no_magnetometer() -> None:
    chip = Chip(who_am_i=0x70, has_ak8963=False)
    assert chip.read(117) == [0x70]
    chip.bypass()
    assert chip.try_read(0x00, address=AK) == -1


def test_data_ready_can_stop(chip: Chip) -> None:
    chip.sample()
    chip.fault("NO_DATA_READY", from_ns=chip.now[0] + 100 * MS, for_ns=50 * MS)
    assert len(chip.edges(100)) == 20
    assert chip.edges(50) == []
    assert len(chip.edges(100)) == 20


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    chip.sample()
    chip.wait(100)
    frozen = chip.words(59, 7)
    chip.fault("FROZEN")
    chip.hold(gyr=(1, 2, 3), acc=(4, 5, 6))
    assert len(chip.edges(100)) == 20
    assert chip.words(59, 7) == frozen
    chip.clear_faults()
    chip.wait(10)
    assert chip.words(59, 7) != frozen


def test_power_loss_forgets_everything(chip: Chip) -> None:
    chip.burst_of_22()
    chip.wait(50)
    chip.call("power_cycle", chip.now[0])
    assert chip.read(25, 3) == [0, 0, 0]
    assert chip.peek_ak8963(0x0A) == 0
