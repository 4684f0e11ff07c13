# SPDX-License-Identifier: MIT
"""The Nano's image for an LSM6DSOX and a LIS3MDL in simavr: two bursts a sample."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bits.processors import replayed
from demanded import leave_out
from imud.virtual.boards import NANO as VIRTUAL
from system.virtual import FIELDS_ALL, NANO, Stub, run, send, write_hand

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR = ROOT / VIRTUAL.simulator
IMAGE = ROOT / ".pio" / "build" / "nano_lsm6dsox" / "firmware.elf"
QUIET = {
    "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no",
    "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
}

if not SIMULATOR.exists():
    leave_out("the virtual Nano is not there", is_whole_file=True)


@pytest.fixture(scope="module")
def image() -> Path:
    words = ["-m", "platformio", "run", "--silent", "-e", IMAGE.parent.name]
    subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env=os.environ | QUIET,
        check=True,
        stdin=subprocess.DEVNULL,
    )
    return IMAGE


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_its_poses_are_in_every_bit_those_of_the_host(
    image: Path, tmp_path: Path
) -> None:
    seconds = 20
    board = dataclasses.replace(NANO, rate_hz=208)
    stub = Stub(board, SIMULATOR, image, tmp_path)
    # Before the sensor is ready: without a self-test that takes a quarter of a second.
    orders = (FIELDS_ALL, send("rate", 1, 208, token=6), send("start", 0, token=9))
    sent = [
        word
        for at_us, order in zip((90_000, 100_000, 120_000), orders, strict=True)
        for word in ("--send", f"{at_us}:{order}")
    ]
    motion = write_hand(tmp_path / "hand", seconds)
    done = run(stub, seconds, "--sensor", "lsm6dsox", "--motion", motion, *sent)
    hello = done.named("hello")[-1].fields
    assert (hello["sensor"], list(hello["who_am_i"])) == ("lsm6dsox", [0x6C, 0x3D])
    both = zip(done.contents, done.messages, strict=True)
    poses = [content for content, message in both if message.name == "pose"]
    assert len(poses) > 95 * seconds
    assert poses == list(replayed(done.contents))
    fields = sum(raw.fields["mag"] is not None for raw in done.named("raw"))
    assert fields == pytest.approx(79 * seconds, abs=10)
    assert done.summary["late"] == 0
    assert done.last_status["bus_faults"] == 0
