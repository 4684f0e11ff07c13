# SPDX-License-Identifier: MIT
"""The Pico's image in rp2040js with an LSM6DSOX and a LIS3MDL in place of an MPU-9250:
it finds the pair by itself, with a data-ready wire and, on a Qwiic cable and with a
relative of the LSM6DSOX, without; and an LSM6DSV16X.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common import scoring
from benchmarks.firmware.pico import off_grid_us
from demanded import leave_out
from imud.virtual import sensors
from imud.virtual.boards import PICO as VIRTUAL
from imud.virtual.motion import Motion
from length import choose
from system.test_pico import (
    CLICK,
    assert_the_poses_are_the_hosts,
    followed,
    with_micropython,
)
from system.virtual import PICO, Run, Stub, run, write_hand

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR, IMAGE = ROOT / VIRTUAL.simulator, ROOT / VIRTUAL.image
PAIR = ("--sensor", "lsm6dsox")
# By how it is wired: the name, its driver's word, the identity, the rate.
SENSORS = {
    "wire": ("lsm6dsox", "lsm6dsox", 0x6C, 208),
    "none": ("ism330dhcx", "lsm6dsox", 0x6B, 208),
    "dsv": ("lsm6dsv16x", "lsm6dsv16x", 0x70, 200),
}
PERIOD_US = 32e6 / 6667  # the sensor's clock, divided by 32
PAIRED = dataclasses.replace(PICO, rate_hz=208)
SECONDS = choose(everyday=5, long=60)

if not (SIMULATOR.exists() and IMAGE.exists()):
    leave_out("the virtual Pico is not there", is_whole_file=True)


@pytest.fixture
def pico(tmp_path: Path) -> Stub:
    return Stub(PAIRED, SIMULATOR, IMAGE, tmp_path)


@pytest.fixture(scope="module")
def run_with(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Run]:
    """The same seconds in a hand, by the word of SENSORS."""

    @functools.cache
    def run_with(ready: str) -> Run:
        folder = tmp_path_factory.mktemp(ready)
        name, _, _, rate_hz = SENSORS[ready]
        board = dataclasses.replace(PICO, rate_hz=rate_hz)
        stub = Stub(board, SIMULATOR, IMAGE, folder)
        words = ("--motion", write_hand(folder / "hand", SECONDS), *CLICK)
        words += (*stub.raw_too, "--sensor", name)
        words += ("--ready", "none" if ready == "none" else "wire")
        return run(stub, SECONDS, *words)

    return run_with


@pytest.mark.sampled(2)
@pytest.mark.parametrize("ready", SENSORS)
def test_the_pair_is_found_and_its_poses_are_the_hosts(
    run_with: Callable[[str], Run], ready: str
) -> None:
    done = run_with(ready)
    hello = done.named("hello")[-1].fields
    _, word, who, rate_hz = SENSORS[ready]
    assert hello["sensor"] == word
    assert list(hello["who_am_i"]) == [who, 0x3D]
    passed = {"acc_passed", "gyr_passed", "mag_passed"}
    assert set(hello["self_test"]) == passed
    assert not {"bus_fault", "sensor_fault"} & {event for event, _ in done.events}
    assert (("data_ready_polled", "no_data_ready") in done.events) == (ready == "none")
    assert_the_poses_are_the_hosts(done, 100 * (SECONDS - 3))
    raws = done.named("raw")
    times = np.array([raw.time_us for raw in raws])
    assert np.diff(times) == pytest.approx(1e6 / rate_hz, abs=250)
    fields = sum(raw.fields["mag"] is not None for raw in raws)
    assert fields / (times[-1] - times[0]) * 1e6 == pytest.approx(80, abs=1)
    assert done.summary["late"] == 0


def test_without_a_wire_times_are_those_of_the_edges_and_poses_as_good(
    run_with: Callable[[str], Run],
) -> None:
    hand = sensors.generate(SECONDS, seed=3)
    wired, polled = run_with("wire"), run_with("none")
    # The sensor's clock is the same in both.
    edges_us, times_us = (
        np.array([raw.time_us for raw in done.named("raw")]) for done in (wired, polled)
    )
    phase_us = np.median(off_grid_us(edges_us - edges_us[0], PERIOD_US))
    late_us = off_grid_us(times_us - edges_us[0] - phase_us, PERIOD_US)
    assert np.sqrt(np.mean(late_us**2)) < 30
    assert np.percentile(np.abs(late_us), 99) < 100
    errors = [tilt_error_deg(done, hand) for done in (wired, polled)]
    assert errors[1] == pytest.approx(errors[0], abs=0.1)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("ready", ["wire", "none"])
def test_micropython_finds_the_pair_too(pico: Stub, ready: str) -> None:
    done = followed(
        with_micropython(pico), 30, *PAIR, "--wire", "usb", "--ready", ready
    )
    hello = done.named("hello")[-1].fields
    assert (hello["board"], hello["sensor"]) == ("micropython", "lsm6dsox")
    assert list(hello["who_am_i"]) == [0x6C, 0x3D]
    assert_the_poses_are_the_hosts(done, 2700)


def tilt_error_deg(done: Run, hand: Motion) -> float:
    """Rms over the poses of the second half, which knows where down is."""
    heard = done.named("pose")
    poses = heard[len(heard) // 2 :]
    times_us = np.array([pose.time_us for pose in poses])
    times_s = (times_us - done.summary["motion_start_us"]) * 1e-6
    found = np.array([pose.fields["q"] for pose in poses])
    tilt = scoring.errors_at(times_s, found, hand).inclination
    return float(np.sqrt(np.mean(tilt**2)))
