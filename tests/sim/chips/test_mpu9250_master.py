# SPDX-License-Identifier: MIT
"""The model of the MPU-9250 against the manufacturers' documents: its own I2C
master.

Numbers are typed from RM-MPU-9250A-00 (RM) and the AK8963 data sheet (AK), not taken
from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.mpu9250_desk import AK, Chip
from sim.chips.sensor_desk import MS


def test_a_burst_of_22_bytes_has_all_nine_axes(chip: Chip) -> None:
    chip.hold(mag=(30.0, -12.5, 47.0))
    chip.burst_of_22()
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
            assert adjusted == pytest.approx(-12.5, abs=0.1)  # its x axis is our y axis
            assert burst[21] == 0x10
    assert flags.count(0x01) == 10  # 100 Hz in samples at 200 Hz
    assert flags.count(0x00) == 10


@pytest.mark.parametrize(("ctrl", "waits"), [(0x4D, True), (0x0D, False)])
def test_wait_for_es_puts_int_behind_the_external_bytes(
    chip: Chip, ctrl: int, waits: bool
) -> None:
    chip.burst_of_22(ctrl)
    started = chip.now[0]  # a little after the restart of the sample clock
    edges = chip.edges(100)[1:]
    # START, address, register, START, address and 8 bytes: 101 bits at 400 kHz.
    late = 101 * 2500 if waits else 0
    assert len(edges) >= 18
    for edge in edges:
        since = (edge - late - started) % (5 * MS)
        # The clock restarted at SMPLRT_DIV, one write before `started`.
        assert 5 * MS - since < 200_000


@pytest.mark.parametrize(("delay", "is_torn"), [(0x00, True), (0x80, False)])
def test_the_shadow_delays_external_bytes_until_all_are_there(
    chip: Chip, delay: int, is_torn: bool
) -> None:
    chip.burst_of_22(0x0D)
    chip.write(103, delay)
    chip.hold(mag=(300.0, 300.0, -300.0))
    chip.wait(50)
    chip.hold(mag=(-300.0, -300.0, 300.0))
    seen = set()
    end = chip.now[0] + 30 * MS
    while (event := chip.next_event()) < end:
        chip.advance(event)
        # Signs of the three axes, which differ between the two fields.
        signs = [chip.peek(reg) >> 7 for reg in (75, 77, 79)]
        seen.add(tuple(signs))
    assert {(0, 0, 0), (1, 1, 1)} <= seen
    assert (len(seen) > 2) is is_torn


def test_slaves_share_the_external_bytes_in_their_order(chip: Chip) -> None:
    chip.bypass()
    chip.write(55, 0)
    chip.write(37, 0x80 | AK, 0x00, 0x80 | 2)
    chip.write(43, 0x80 | AK, 0x00, 0x80 | 1)
    chip.write(106, 0x20)
    chip.sample()
    chip.wait(20)
    assert chip.read(73, 4) == [0x48, 0x9A, 0x48, 0x00]
    chip.write(39, 0x02)  # slave 0 off: its bytes stay (RM 4.25)
    chip.wait(20)
    assert chip.read(73, 4) == [0x48, 0x9A, 0x48, 0x00]


def test_bytes_of_a_word_can_be_swapped(chip: Chip) -> None:
    chip.bypass()
    chip.write(55, 0)
    chip.write(37, 0x80 | AK, 0x00, 0x80 | 0x40 | 3)
    chip.write(106, 0x20)
    chip.sample()
    chip.wait(20)
    assert chip.read(73, 3) == [0x9A, 0x48, 0x00]
    chip.write(39, 0x80 | 0x50 | 3)  # words start at odd registers
    chip.wait(20)
    assert chip.read(73, 3) == [0x48, 0x00, 0x9A]


def test_slave_4_reads_and_writes_once(chip: Chip) -> None:
    chip.write(106, 0x20)
    chip.sample()
    chip.write(49, 0x80 | AK, 0x00)
    chip.write(52, 0x80)
    chip.wait(10)
    assert chip.read(52, 3) == [0x00, 0x48, 0x40]
    assert chip.read(54) == [0x00]
    chip.write(49, AK, 0x0A, 0x16, 0x80)
    chip.wait(10)
    assert chip.peek_ak8963(0x0A) == 0x16


def test_slave_0_writes_its_data_out(chip: Chip) -> None:
    chip.write(106, 0x20)
    chip.sample()
    chip.write(99, 0x16)
    chip.write(37, AK, 0x0A, 0x81)
    chip.wait(10)
    assert chip.peek_ak8963(0x0A) == 0x16


def test_delayed_slaves_come_every_so_many_samples(chip: Chip) -> None:
    chip.write(106, 0x20)
    chip.write(52, 4)  # one sample in 5
    chip.write(103, 0x01)
    chip.write(37, 0x80 | 0x33, 0x00, 0x81)  # no such slave: each try sets a NACK bit
    chip.sample()
    chip.read(54)
    tries = 0
    for _ in range(50):
        chip.edges(5)
        tries += chip.read(54)[0] & 1
    assert tries == 10


def test_a_missing_slave_leaves_its_nack_bit(chip: Chip) -> None:
    chip.fault("NO_MAG")
    chip.write(106, 0x20)
    chip.write(36, 0x4D)
    chip.write(40, 0x80 | AK, 0x00, 0x81)
    chip.sample()
    assert len(chip.edges(20)) == 4
    assert chip.read(54) == [0x02]
    assert chip.read(73) == [0]
