# SPDX-License-Identifier: MIT
"""The model of the LIS3MDL against the manufacturer's documents: status, block data
update (BDU), data-ready, self-test and faults.

Numbers are typed from the data sheet, DocID024204 rev 4 (DS), and from AN4602 (AN) as
others quote them, not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.lis3mdl_desk import MAG, ON, Chip
from sim.chips.sensor_desk import MS


def test_a_sample_sets_its_flags_and_high_bytes_clear_them(chip: Chip) -> None:
    chip.run()
    chip.sample()
    assert chip.status() == 0x0F
    chip.get(MAG, 0x28)  # the low byte of X clears no flag
    assert chip.status() == 0x0F
    seen = []
    for reg in (0x29, 0x2B, 0x2D):
        chip.get(MAG, reg)
        seen.append(chip.status())
    assert seen == [0x0E, 0x0C, 0x00]


def test_a_sample_unread_is_overrun(chip: Chip) -> None:
    chip.run()
    chip.sample()
    chip.sample()
    assert chip.status() == 0xFF
    chip.counts()
    assert chip.status() == 0x00


def test_drdy_is_high_from_the_sample_until_all_is_read(chip: Chip) -> None:
    chip.run()
    assert not chip.is_high()
    chip.sample()
    assert chip.is_high()
    chip.get(MAG, ON | 0x28, 5)
    assert chip.is_high()
    chip.get(MAG, 0x2D)
    assert not chip.is_high()


def test_without_bdu_a_burst_across_an_update_is_torn(chip: Chip) -> None:
    chip.hold(mag=(30, 30, 30))
    chip.run(bdu=False)
    chip.sample()
    before = chip.counts()[0]
    chip.start(MAG, is_read=False)
    chip.send(ON | 0x28)
    chip.start(MAG, is_read=True)
    data = [chip.receive()]
    chip.hold(mag=(0, 0, 0))
    chip.sample()
    data += [chip.receive(ack=i < 4) for i in range(5)]
    chip.stop()
    assert data == [before & 0xFF, 0, 0, 0, 0, 0]


def test_bdu_holds_an_axis_until_both_halves_are_read(chip: Chip) -> None:
    chip.hold(mag=(30, 30, 30))
    chip.run()
    chip.sample()
    before = chip.counts()
    chip.sample()
    low = chip.get(MAG, 0x28)
    chip.hold(mag=(0, 0, 0))
    chip.sample()
    word = bytes(low + chip.get(MAG, 0x29))
    assert int.from_bytes(word, "little", signed=True) == before[0]
    # Then the sample that came meanwhile shows, and is flagged as new.
    assert chip.status() & 0x09 == 0x09
    assert chip.counts() == [0, 0, 0]


def test_two_samples_behind_a_held_axis_are_an_overrun(chip: Chip) -> None:
    chip.run()
    chip.sample()
    chip.get(MAG, 0x28)
    chip.sample()
    assert chip.status() & 0x90 == 0x00
    chip.sample()
    assert chip.status() & 0x10 == 0x10


def test_bdu_off_lets_go(chip: Chip) -> None:
    chip.run()
    chip.sample()
    chip.get(MAG, 0x28)
    chip.hold(mag=(30, 30, 30))
    chip.sample()
    chip.write(0x24, 0x00)
    x, y, _ = chip.counts()
    assert x == y


def test_a_good_magnetometer_passes_its_self_test(chip: Chip) -> None:
    chip.run(ctrl1=0x1C, ctrl2=0x40)
    chip.sample()
    off = chip.counts()
    chip.write(0x20, 0x1D)
    chip.sample()
    on = chip.counts()
    x, y, z = [(b - a) / 2281 for a, b in zip(off, on, strict=True)]
    assert 1.0 <= x <= 3.0  # AN: at 12 gauss
    assert 1.0 <= y <= 3.0
    assert 0.1 <= z <= 1.0


def test_a_magnetometer_that_dies_answers_no_more(chip: Chip) -> None:
    chip.run()
    chip.fault("NO_MAG", from_ns=100 * MS, for_ns=100 * MS)
    assert chip.try_get(MAG, 0x0F) == 0
    chip.wait(100)
    assert chip.try_get(MAG, 0x0F) == -1
    chip.wait(100)
    assert chip.try_get(MAG, 0x0F) == 0


def test_data_ready_can_stop(chip: Chip) -> None:
    chip.run()
    chip.wait(100)
    chip.fault("NO_DATA_READY", from_ns=chip.now[0], for_ns=100 * MS)
    before = chip.samples()
    chip.wait(99.9)
    assert chip.samples() == before
    chip.wait(100)
    assert chip.samples() - before == pytest.approx(8, abs=1)


def test_who_am_i_can_be_wrong(chip: Chip) -> None:
    chip.fault("WRONG_WHO_AM_I", value=0x40)
    assert chip.read(0x0F) == 0x40


def test_outputs_can_freeze_while_data_ready_goes_on(chip: Chip) -> None:
    chip.run()
    chip.sample()
    frozen = chip.counts()
    chip.fault("FROZEN")
    chip.hold(mag=(1, 2, 3))
    chip.sample()
    assert chip.status() & 0x0F == 0x0F
    assert chip.counts() == frozen
    chip.clear_faults()
    chip.sample()
    assert chip.counts() != frozen


def test_a_register_can_flip(chip: Chip) -> None:
    chip.run()
    chip.fault("REGISTER_FLIP", reg=0x22, value=0x03, from_ns=100 * MS)
    chip.wait(150)
    before = chip.samples()
    chip.wait(100)
    assert chip.read(0x22) == 0x03
    assert chip.samples() == before


@pytest.mark.parametrize("how", ["power_cycle", "BROWN_OUT"])
def test_power_loss_forgets_everything(chip: Chip, how: str) -> None:
    chip.run()
    chip.wait(50)
    if how == "power_cycle":
        chip.call(how, chip.now[0])
    else:
        chip.fault(how, from_ns=chip.now[0])
    assert chip.get(MAG, ON | 0x20, 5) == [0x10, 0, 0x03, 0, 0]
    chip.wait(100)
    assert chip.status() == 0
