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


def test_a_missing_slave_leaves_its_nack_bit(chip: Chip) -> None:
    chip.fault("NO_MAG")
    chip.write(106, 0x20)
    chip.write(36, 0x4D)
    chip.write(37, 0x80 | AK, 0x00, 0x81)
    chip.sample()
    assert len(chip.edges(20)) == 4
    assert chip.read(54) == [0x01]
    assert chip.read(73) == [0]
