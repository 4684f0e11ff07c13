# SPDX-License-Identifier: MIT
"""The module imuprobe in MicroPython on this machine: the probe of core/, in every
bit."""

from __future__ import annotations

from pathlib import Path

import pytest

from bits.processors import replayed
from imud.wire import schema
from length import choose
from micropython_tape import (
    ABOUT,
    ALL,
    RATE_HZ,
    Command,
    Tape,
    fed,
    hand,
    sent,
    taped,
)
from system.virtual import F405, Stub, run, write_hand

LSM9DS0 = (int(schema.Sensor.LSM9DS0), 380, 7178468, 1221730, 8000, 0xD4)
SECONDS = choose(everyday=12, long=62)


def test_its_poses_are_those_of_the_native_core(
    with_module: Command, tmp_path: Path
) -> None:
    tape = Tape()
    tape.command(1, "rate", 1, RATE_HZ)
    tape.command(2, "fields", ALL)
    tape.command(3, "start")
    tape.sensor(4, *ABOUT)
    for number, (time_us, values) in enumerate(hand(SECONDS)):
        tape.sample(time_us, values)
        if number == 1000:
            tape.command(time_us + 100, "tare", 1)
        if number == 1500:
            tape.command(time_us + 100, "restart", int(schema.Filter.MAHONY))
    contents = fed(with_module, tape, tmp_path)
    poses = [content for content in contents if content[0] == 0x06]
    assert len(poses) > 100 * (SECONDS - 1)
    assert poses == list(replayed(contents))
    status = sent(contents, "status")[-1].fields
    assert status["messages_dropped"] == 0
    assert status["samples_read"] == status["samples_fused"]


def test_it_takes_commands_in_any_pieces(with_module: Command, tmp_path: Path) -> None:
    runs = []
    for size in (99, 1, 7):
        tape = Tape()
        for number, name in enumerate(("start", "rate", "fields", "stop")):
            tape.command(100 + number, name, 1, 50, size)
        runs.append(fed(with_module, tape, tmp_path))
    replies = [reply.fields["result"] for reply in sent(runs[0], "reply")]
    assert replies == ["ok"] * 4
    assert runs[1] == runs[2] == runs[0]


def test_its_settings_survive_and_a_boot_is_counted(
    with_module: Command, tmp_path: Path
) -> None:
    memory = tmp_path / "settings"
    counts = []
    for _ in range(3):
        tape = Tape()
        tape.command(100, "rate", 0, 50)
        tape.sensor(101, *ABOUT)
        for time_us, values in hand(2):
            tape.sample(time_us, values)
        hellos = sent(fed(with_module, tape, tmp_path, memory), "hello")
        counts.append((hellos[0].fields["boot_count"], hellos[0].fields["pose_rate"]))
        assert {hello.fields["probe_id"] for hello in hellos} == {fnv(b"host")}
    assert counts == [(1, 100), (2, 50), (3, 50)]


def fnv(data: bytes) -> bytes:
    """FNV-1a of 64 bits, little endian."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value.to_bytes(8, "little")


@pytest.mark.long
def test_the_samples_of_the_c_board_give_its_poses(
    with_module: Command, f405: Path, f405_image: Path, tmp_path: Path
) -> None:
    stub = Stub(F405, f405, f405_image, tmp_path)
    moved = write_hand(tmp_path / "hand", SECONDS)
    words = ("--motion", moved, "--press", "200000:300000", *stub.raw_too)
    done = run(stub, SECONDS, *words)
    tape = taped(done.named("raw"), LSM9DS0)
    contents = fed(with_module, tape, tmp_path)
    theirs, ours = (
        [content[5:] for content in each if content[0] == 0x06]  # but for their numbers
        for each in (done.contents, contents)
    )
    assert len(ours) > 100 * (SECONDS - 2)
    assert ours == theirs
