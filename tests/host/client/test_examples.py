# SPDX-License-Identifier: MIT
"""The examples, each as a program of its own beside a daemon."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes import PATIENCE_S, POSE, free_endpoint
from programs import ran
from speaking import speaking

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture
def endpoint(tmp_path: Path) -> Iterator[str]:
    with speaking(tmp_path) as daemon:
        yield daemon.endpoint


def run(example: str, *arguments: object) -> str:
    command = [sys.executable, str(EXAMPLES / example), *map(str, arguments)]
    done = ran(*command, timeout=2 * PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_follow_pose_prints_poses_and_what_it_missed(endpoint: str) -> None:
    *poses, missed = run("follow_pose.py", endpoint).splitlines()
    assert len(poses) > 100
    assert {line.split(maxsplit=1)[1] for line in poses} == {
        "yaw 90.0, pitch -90.0, roll 0.0 degrees"
    }
    assert missed == "missed: 0"


def test_record_writes_each_pose_once_and_in_order(
    endpoint: str, tmp_path: Path
) -> None:
    path = tmp_path / "poses.csv"
    assert run("record.py", path, endpoint) == "0 missed\n"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    numbers = [int(row["number"]) for row in rows]
    assert len(rows) > 100
    assert numbers == list(range(numbers[0], numbers[0] + len(rows)))
    assert {tuple(float(row[axis]) for axis in "wxyz") for row in rows} == {POSE["q"]}


def test_command_makes_the_only_probe_stream(endpoint: str) -> None:
    assert run("command.py", endpoint).endswith("streams from here on\n")


def test_command_says_why_it_could_not() -> None:
    done = ran(
        *(sys.executable, str(EXAMPLES / "command.py"), free_endpoint()),
        timeout=PATIENCE_S,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("command.py: no imud at")


def test_an_example_fits_a_page() -> None:
    for path in EXAMPLES.iterdir():
        if path.is_file() and path.stem != "zenoh_pico":
            lines = [line for line in path.read_text().splitlines() if line]
            assert len(lines) <= 20, path
