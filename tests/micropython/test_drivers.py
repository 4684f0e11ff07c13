# SPDX-License-Identifier: MIT
"""Sensors through MicroPython's I2C, against their models: the drivers of core/ behind
the module, and those of the package."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode
from micropython_tape import Command

pytestmark = pytest.mark.long

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "firmware" / "micropython"
FIRST_US, EACH_US, MOTIONS = 3_000_000, 100_000, 20  # as in driven.py
KINDS = {"mpu9250": 200, "lsm9ds0": 380}  # samples a second


def orders() -> list[str]:
    """All raw samples."""
    wanted = [("rate", (1, 1000)), ("fields", (int(schema.StreamFlags.RAW), 0))]
    frames = []
    for token, (name, arguments) in enumerate(wanted, start=1):
        fields = {"command": name, "token": token, "arguments": arguments}
        frames.append(encode_frame(encode("command", fields, token, 0)).hex())
    return frames


def driven(
    micropython: Command, kind: str, variant: str, folder: Path, bus: str = "i2c"
) -> list[Message]:
    frames = folder / f"{variant}-{bus}"
    words = [*micropython, HERE / "driven.py", HERE / "fake", PACKAGE, kind, variant]
    done = subprocess.run(
        [*words, bus, frames, *orders()], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    messages = [decode(content) for content in FrameDecoder().feed(frames.read_bytes())]
    assert all(isinstance(message, Message) for message in messages)
    return [message for message in messages if isinstance(message, Message)]


def held(messages: list[Message]) -> list[dict[str, Any]]:
    """The last raw message of each motion, with its last magnetic field."""
    found = []
    for number in range(MOTIONS):
        end_us = FIRST_US + (number + 1) * EACH_US
        raws = [
            m.fields
            for m in messages
            if m.name == "raw" and end_us - EACH_US <= m.time_us < end_us
        ]
        fields = [raw["mag"] for raw in raws if raw["mag"] is not None]
        found.append({**raws[-1], "mag": fields[-1] if fields else None})
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_the_package_reads_what_core_reads(
    micropython: Command, tmp_path: Path, kind: str
) -> None:
    module = driven(micropython, kind, "module", tmp_path)
    plain = driven(micropython, kind, "plain", tmp_path)
    theirs, ours = held(module), held(plain)
    assert ours == theirs
    # Not of one motion all the time.
    assert len({str(raw["acc"]) for raw in ours}) == MOTIONS
    assert sum(raw["mag"] is not None for raw in ours) == MOTIONS
    for messages in (module, plain):
        hello = [m for m in messages if m.name == "hello"][-1].fields
        assert hello["sensor"] == kind
        assert hello["sample_rate"] == KINDS[kind]
        raws = [m.time_us for m in messages if m.name == "raw"]
        assert len(raws) == pytest.approx((raws[-1] - raws[0]) * 1e-6 * KINDS[kind], 3)
    assert about(plain) == about(module)


@pytest.mark.parametrize("variant", ["module", "plain"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_sensor_on_spi_is_read_as_on_i2c(
    micropython: Command, tmp_path: Path, kind: str, variant: str
) -> None:
    wired = [
        driven(micropython, kind, variant, tmp_path, bus) for bus in ("i2c", "spi")
    ]
    over_i2c, over_spi = (held(messages) for messages in wired)
    assert over_spi == over_i2c
    assert len(over_spi) == MOTIONS


def about(messages: list[Message]) -> list[Any]:
    """The sensor's fields in a hello."""
    hello = [m for m in messages if m.name == "hello"][-1].fields
    names = ("who_am_i", "mag_adjust", "acc_lsb", "gyr_lsb", "mag_lsb", "sample_rate")
    return [hello[name] for name in names]
