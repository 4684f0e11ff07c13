# SPDX-License-Identifier: MIT
"""Madgwick's filter of the package against the same filter of core/ in fixed point."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fakes import HELLO, POSE
from imud import _core, rotation
from imud.rotation import FloatArray
from imud.virtual import sensors
from imud.wire import schema
from imud.wire.messages import Message, decode, encode
from micropython_frames import PACKAGE, PROGRAMS

SECONDS = 30
LSM9DS0 = {"acc_lsb": 7178468e-9, "gyr_lsb": 1221730e-9, "mag_lsb": 8000e-6}
RATE_HZ = 380
STEP = 4  # samples of a step of the filter
MAG_EVERY = 4


@dataclass(frozen=True)
class Tape:
    """A hello, the contents of raw messages, and the true orientations."""

    hello: bytes
    raws: list[bytes]
    truth: FloatArray


def taped(acc: FloatArray, gyr: FloatArray, mag: FloatArray, **others: Any) -> Tape:
    """What an LSM9DS0 sends of it; `flags`: of its first sample."""
    fields = HELLO | {"sensor": "lsm9ds0", "sample_rate": RATE_HZ, "params_digest": 0}
    fields |= LSM9DS0
    counts = [
        np.clip(np.rint(kind / LSM9DS0[name]), -32767, 32767).astype(int)
        for kind, name in ((acc, "acc_lsb"), (gyr, "gyr_lsb"), (mag, "mag_lsb"))
    ]
    raws = []
    for number, (force, rate, field) in enumerate(zip(*counts, strict=True)):
        raw = {
            "acc": tuple(force.tolist()),
            "gyr": tuple(rate.tolist()),
            "mag": tuple(field.tolist()) if number % MAG_EVERY == 0 else None,
            "temperature": 25.0,
            "sample_flags": others.get("flags", ()) if number == 0 else (),
        }
        time_us = 1000 + number * 1_000_000 // RATE_HZ
        raws.append(encode("raw", raw, number, time_us))
    return Tape(encode("hello", fields, 0, 0), raws, others.get("truth", acc))


@pytest.fixture(scope="module")
def tape() -> Tape:
    """A hand."""
    moved = sensors.generate(SECONDS, seed=3)
    times = np.arange((SECONDS - 1) * RATE_HZ) / RATE_HZ
    at = np.rint(times * moved.rate_hz).astype(int)
    return taped(moved.acc[at], moved.gyr[at], moved.mag[at], truth=moved.quat[at])


def in_micropython(
    stock: Path, tape: Tape, folder: Path, rate_hz: int = 100
) -> list[Message]:
    """The poses of the package's filter at `rate_hz` steps per second."""
    hello, raws, poses = (folder / name for name in ("hello", "raws", "poses"))
    hello.write_bytes(tape.hello)
    raws.write_bytes(b"".join(tape.raws))
    path = f"{PROGRAMS / 'fake'}:{PACKAGE.parent}"
    done = subprocess.run(
        [stock, PROGRAMS / "fuse.py", hello, raws, poses, str(rate_hz)],
        env=os.environ | {"MICROPYPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    data, size = poses.read_bytes(), len(encode("pose", POSE, 0, 0))
    pieces = [decode(data[at : at + size]) for at in range(0, len(data), size)]
    return [each for each in pieces if isinstance(each, Message)]


def in_core(tape: Tape, every: int) -> list[Message]:
    """The poses of the fixed-point filter, one for every few samples."""
    replay = _core.Replay(tape.hello, b"")
    replay.restart(int(schema.Filter.MADGWICK))
    found = []
    for number, raw in enumerate(tape.raws):
        replay.step(raw)
        if number % every == every - 1:
            found.append(decode(replay.pose(number, 0)))
    return [each for each in found if isinstance(each, Message)]


def quaternions(poses: list[Message]) -> FloatArray:
    found = np.array([pose.fields["q"] for pose in poses])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def degrees_apart(a: FloatArray, b: FloatArray) -> FloatArray:
    cosines = np.abs(np.sum(a * b, axis=1))
    return np.asarray(np.degrees(2 * np.arccos(np.clip(cosines, 0, 1))))


def rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def test_it_has_the_equations_of_core(stock: Path, tape: Tape, tmp_path: Path) -> None:
    ours = quaternions(in_micropython(stock, tape, tmp_path, RATE_HZ))
    theirs = quaternions(in_core(tape, 1))
    assert len(ours) == len(tape.raws)
    assert degrees_apart(ours, theirs).max() < 0.02


def test_at_fewer_steps_it_stays_near(stock: Path, tape: Tape, tmp_path: Path) -> None:
    ours, theirs = in_micropython(stock, tape, tmp_path), in_core(tape, STEP)
    assert len(ours) == len(tape.raws) // STEP
    settled = 3 * RATE_HZ // STEP
    errors = [
        degrees_apart(quaternions(poses), tape.truth[STEP - 1 :: STEP])[settled:]
        for poses in (ours, theirs)
    ]
    assert rms(errors[1]) < 3
    assert rms(errors[0]) < rms(errors[1]) + 1
    assert degrees_apart(quaternions(ours), quaternions(theirs)).max() < 4


def test_a_bias_is_found_at_rest_alone(stock: Path, tmp_path: Path) -> None:
    seconds = 10
    count = seconds * RATE_HZ
    still = np.tile([0.0, 0.0, 9.81], (count, 1))
    field = np.tile([0.0, 20.0, -44.0], (count, 1))
    turns = np.tile([0.02, -0.03, 0.01], (count, 1))  # what it says at rest, rad/s
    turns[: 2 * RATE_HZ, 2] += np.sin(np.arange(2 * RATE_HZ) / 50)
    poses = in_micropython(stock, taped(still, turns, field, flags=("gap",)), tmp_path)
    flags = [set(pose.fields["pose_flags"]) for pose in poses]
    step_hz = RATE_HZ // STEP
    assert flags[0] == {"starting", "uncalibrated", "gap"}
    assert "uncalibrated" in flags[3 * step_hz]
    assert flags[4 * step_hz] == set()
    # Level and to the north, which it would not be with that rate left in.
    last = quaternions(poses)[-step_hz:]
    assert degrees_apart(last, np.array([[1.0, 0, 0, 0]])).max() < 0.1


def test_without_a_field_the_heading_is_free(stock: Path, tmp_path: Path) -> None:
    count = 5 * RATE_HZ
    still = np.tile([3.0, 4.0, 8.0], (count, 1))
    tape = taped(still, np.zeros((count, 3)), np.zeros((count, 3)))
    (last,) = in_micropython(stock, tape, tmp_path)[-1:]
    assert set(last.fields["pose_flags"]) == {"mag_absent", "heading_free"}
    up = still[0] / np.linalg.norm(still[0])
    world = rotation.rotate(quaternions([last])[0], up)
    assert world == pytest.approx([0, 0, 1], abs=1e-3)
