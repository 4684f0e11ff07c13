# SPDX-License-Identifier: MIT
"""The models of the sensors on the I2C bus: who answers, and their common faults."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from sim.chips import lis3mdl_desk, lsm6dsox_desk, lsm9ds0_desk, mpu9250_desk
from sim.chips.sensor_desk import MS, SensorDesk

# Of each model: address, register WHO_AM_I, its value, a register to write.
PLACES = {
    "mpu9250": (mpu9250_desk.MPU, 117, 0x71, 55),
    "lsm9ds0": (lsm9ds0_desk.XM, 0x0F, 0x49, 0x22),
    "lsm6dsox": (lsm6dsox_desk.IMU, 0x0F, 0x6C, 0x0D),
    "lis3mdl": (lis3mdl_desk.MAG, 0x0F, 0x3D, 0x24),
}
DESKS: dict[str, Any] = {
    "mpu9250": mpu9250_desk,
    "lsm9ds0": lsm9ds0_desk,
    "lsm6dsox": lsm6dsox_desk,
    "lis3mdl": lis3mdl_desk,
}


class Wired:
    """A sensor of any kind; one register is read, another one written."""

    def __init__(self, name: str) -> None:
        self.desk: SensorDesk = DESKS[name].Chip()
        self.address, self.who_am_i, self.identity, self.writable = PLACES[name]

    def try_read(self) -> int:
        return self.desk.try_get(self.address, self.who_am_i)

    def read(self) -> int:
        return self.desk.get(self.address, self.who_am_i)[0]

    def try_write(self) -> int:
        return self.desk.try_put(self.address, self.writable, 0x00)


@pytest.fixture(params=PLACES)
def chip(request: pytest.FixtureRequest) -> Iterator[Wired]:
    chip = Wired(request.param)
    yield chip
    assert chip.desk.complaint() is None


def test_nobody_answers_without_a_start_or_past_the_last_byte(chip: Wired) -> None:
    desk = chip.desk
    assert not desk.send(chip.who_am_i)
    assert desk.start(chip.address, is_read=True)
    assert not desk.send(chip.who_am_i)
    desk.receive(ack=False)
    assert desk.receive() == 0xFF
    desk.stop()
    assert desk.transactions() == 1


def test_a_repeated_start_goes_on_with_the_transaction(chip: Wired) -> None:
    assert chip.read() == chip.identity
    assert chip.try_write() == 0
    assert chip.desk.transactions() == 2


@pytest.mark.parametrize("byte", [0, 1, 2])
def test_a_nack_hits_its_byte_of_its_transaction(chip: Wired, byte: int) -> None:
    chip.desk.fault("NACK", first=3, transactions=1, at_byte=byte)
    assert [chip.try_write() for _ in range(5)] == [0, 0, -1, 0, 0]
    assert chip.desk.transactions() == 5


def test_a_nack_lasts_for_its_span(chip: Wired) -> None:
    chip.desk.fault("NACK", from_ns=10 * MS, for_ns=10 * MS)
    assert chip.try_read() == 0
    chip.desk.wait(11)
    assert chip.try_read() == -1
    chip.desk.wait(9)
    assert chip.try_read() == 0


def test_a_stuck_line_needs_its_clocks(chip: Wired) -> None:
    desk = chip.desk
    desk.fault("STUCK_SDA", first=2, transactions=1, at_byte=2, clocks=5)
    assert chip.try_read() == 0
    assert chip.try_read() == -3
    assert chip.try_write() == -3
    for pulse in range(5):
        assert desk.holds_sda(), pulse
        desk.pulse()
    assert not desk.holds_sda()
    desk.stop()
    assert chip.read() == chip.identity


def test_a_stuck_line_can_free_itself(chip: Wired) -> None:
    chip.desk.fault("STUCK_SDA", from_ns=5 * MS, for_ns=3 * MS)
    assert chip.try_read() == 0
    chip.desk.wait(5)
    assert chip.try_read() == -3
    chip.desk.wait(3)
    assert chip.try_read() == 0


def test_a_stuck_line_without_clocks_stays_until_faults_are_cleared(
    chip: Wired,
) -> None:
    chip.desk.fault("STUCK_SDA")
    for _ in range(20):
        chip.desk.pulse()
    assert chip.try_read() == -3
    chip.desk.clear_faults()
    assert chip.try_read() == 0


def test_who_am_i_can_be_wrong(chip: Wired) -> None:
    chip.desk.fault("WRONG_WHO_AM_I", value=0x68)
    assert chip.read() == 0x68
    chip.desk.clear_faults()
    assert chip.read() == chip.identity


def test_there_is_room_for_32_faults(chip: Wired) -> None:
    for _ in range(32):
        chip.desk.fault("NACK", first=100, transactions=1)
    assert not chip.desk.try_fault("NACK")
