# SPDX-License-Identifier: MIT
"""The Pico's image in rp2040js with an LSM6DSOX and a LIS3MDL in place of an MPU-9250:
it finds the pair by itself, with a data-ready wire and, on a Qwiic cable, without."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from demanded import leave_out
from imud.virtual.boards import PICO as VIRTUAL
from length import choose
from system.test_pico import assert_the_poses_are_the_hosts, followed
from system.virtual import PICO, Stub

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR, IMAGE = ROOT / VIRTUAL.simulator, ROOT / VIRTUAL.image
PAIR = ("--sensor", "lsm6dsox")

if not (SIMULATOR.exists() and IMAGE.exists()):
    leave_out("the virtual Pico is not there", is_whole_file=True)


@pytest.fixture
def pico(tmp_path: Path) -> Stub:
    board = dataclasses.replace(PICO, rate_hz=208)
    return Stub(board, SIMULATOR, IMAGE, tmp_path)


@pytest.mark.parametrize("ready", ["wire", "none"])
def test_the_pair_is_found_and_its_poses_are_the_hosts(pico: Stub, ready: str) -> None:
    seconds = choose(everyday=9, long=60)
    done = followed(pico, seconds, *PAIR, "--ready", ready)
    hello = done.named("hello")[-1].fields
    assert hello["sensor"] == "lsm6dsox"
    assert list(hello["who_am_i"]) == [0x6C, 0x3D]
    passed = {"acc_passed", "gyr_passed", "mag_passed"}
    assert set(hello["self_test"]) == passed
    assert not {"bus_fault", "sensor_fault"} & {event for event, _ in done.events}
    assert (("data_ready_polled", "no_data_ready") in done.events) == (ready == "none")
    assert_the_poses_are_the_hosts(done, 100 * (seconds - 3))
    raws = done.named("raw")
    times = np.array([raw.time_us for raw in raws])
    assert np.diff(times) == pytest.approx(1e6 / 208, abs=250)
    fields = sum(raw.fields["mag"] is not None for raw in raws)
    assert fields / (times[-1] - times[0]) * 1e6 == pytest.approx(80, abs=1)
    assert done.summary["late"] == 0
