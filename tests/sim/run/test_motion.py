# SPDX-License-Identifier: MIT
"""The motion file of a virtual board: its means and its end."""

from __future__ import annotations

import json
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import native
from nano_desk import NANO, image, run


@pytest.fixture(scope="module")
def desk() -> Path:
    return image()


ffi, lib = native.load()


def stream(rate_hz: float, count: int, records: list[list[float]]) -> bytes:
    head = b"IMUMOT1\x00" + struct.pack("<dQQ", rate_hz, count, 0)
    return head + b"".join(struct.pack("<9f", *record) for record in records)


@pytest.fixture
def ramp(tmp_path: Path) -> Iterator[Any]:
    """100 Hz; axis a of record i is i * (a + 1), with a corner at record 50."""
    records = [
        [min(i, 100 - i) * (axis + 1.0) for axis in range(9)] for i in range(101)
    ]
    path = tmp_path / "motion"
    path.write_bytes(stream(100.0, 0, records))
    motion = ffi.new("struct motion *")
    assert lib.motion_open(motion, str(path).encode()) == ffi.NULL
    yield motion
    lib.motion_close(motion)


def mean(motion: Any, quantity: int, start_ms: float, end_ms: float) -> list[float]:
    out = ffi.new("double[3]")
    lib.motion_mean(motion, quantity, round(start_ms * 1e6), round(end_ms * 1e6), out)
    return list(out)


def test_before_its_start_a_motion_stands(ramp: Any) -> None:
    assert mean(ramp, 0, 0, 500) == [0, 0, 0]
    lib.motion_begin(ramp, 1_000_000_000)
    assert mean(ramp, 0, 900, 1000) == [0, 0, 0]


def test_means_over_a_motion_are_exact(ramp: Any) -> None:
    lib.motion_begin(ramp, 0)
    assert mean(ramp, 0, 100, 100) == pytest.approx([10, 20, 30])
    assert mean(ramp, 1, 103, 103) == pytest.approx([41.2, 51.5, 61.8])
    assert mean(ramp, 0, 101, 117)[0] == pytest.approx(10.9)
    # The window contains the corner at 500 ms: less two triangles.
    assert mean(ramp, 0, 497, 506)[0] == pytest.approx(50 - (9 + 36) / 2 / 9 / 10)
    assert mean(ramp, 0, -30, 10)[0] == pytest.approx(0.5 / 4)


def test_after_its_end_a_motion_stands(ramp: Any) -> None:
    lib.motion_begin(ramp, 0)
    assert not lib.motion_is_over(ramp, 999_000_000)
    assert lib.motion_is_over(ramp, 1_000_000_000)
    assert mean(ramp, 2, 1000, 5000) == pytest.approx([0, 0, 0])


def test_a_run_ends_with_its_motion(desk: Path, tmp_path: Path) -> None:
    path = tmp_path / "motion"
    path.write_bytes(stream(50.0, 26, [[0, 0, 0, 0, 0, 9.81, 0, 20, -40]] * 40))
    _, summary = run(desk, tmp_path, "--motion", str(path))
    # 100 ms before it, 25 intervals of 20 ms, and 20 ms in which the last bytes leave.
    assert summary["seconds"] == pytest.approx(0.62, abs=0.0011)
    _, summary = run(desk, tmp_path, "--motion", str(path), "--seconds", "1.5")
    assert summary["seconds"] == pytest.approx(1.5, abs=1e-5)


def test_a_motion_can_come_through_a_pipe(desk: Path, tmp_path: Path) -> None:
    records = stream(50.0, 0, [[0.0] * 9] * 26)
    summary = tmp_path / "summary.json"
    subprocess.run(
        [NANO, "--image", desk, "--motion", "-", "--summary", summary],
        input=records,
        capture_output=True,
        check=True,
    )
    seconds = json.loads(summary.read_text())["seconds"]
    assert seconds == pytest.approx(0.62, abs=0.0011)
