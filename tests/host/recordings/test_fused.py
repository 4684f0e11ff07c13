# SPDX-License-Identifier: MIT
"""`imud export --fuse`: poses of a log's raw samples are the probe's own, bit by bit;
those of others' recordings are right within what they state, whatever their rate."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.common import scoring
from core.desk import lib
from imud import cli
from imud.recordings import foreign_log, fused
from imud.virtual import sensors
from imud.virtual.motion import Motion
from imud.wire.frame import encode_frame
from twin_bench import followed

SECONDS, SETTLED_S = 14.0, 8.0
# Of two axes and of one, within which 95 % of errors lie.
OF_TILT, OF_HEADING = 2.45, 1.96

Said = pytest.CaptureFixture[str]


def poses(path: Path, folder: Path, *options: str) -> list[dict[str, str]]:
    words = ["export", str(path), "--out", str(folder), *options]
    assert cli.main(words) == 0
    (table,) = folder.glob("*-pose.csv")
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> Any:
    return np.array([float(row[name] or "nan") for row in rows])


def table(hand: Motion, rate_hz: float, path: Path, *, has_mag: bool = True) -> Path:
    """As another program writes it."""
    at_s = np.arange(int(SECONDS * rate_hz)) / rate_hz
    times_s = np.arange(len(hand)) / hand.rate_hz
    vectors = (hand.acc, hand.gyr, hand.mag)[: 3 if has_mag else 2]
    axes = [np.interp(at_s, times_s, axis) for each in vectors for axis in each.T]
    names = ["time_s", *(f"{sensor}_{axis}" for sensor in "agm" for axis in "xyz")]
    rows = np.column_stack([at_s, *axes])
    head = ",".join(names[: rows.shape[1]])
    np.savetxt(path, rows, "%.6f", delimiter=",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def hand() -> Motion:
    return sensors.generate(SECONDS, seed=3)


def test_they_are_the_probes_own_in_every_column(tmp_path: Path, capsys: Said) -> None:
    life = followed().live(620)
    life.order(lib.COMMAND_TARE, 0)
    life.live(200)
    life.order(lib.COMMAND_RESTART)
    life.live(300)
    capture = tmp_path / "of_a_uart.bin"
    capture.write_bytes(b"\0" + b"".join(map(encode_frame, life.contents)))
    own = poses(capture, tmp_path / "own")
    capsys.readouterr()
    computed = poses(capture, tmp_path / "fused", "--fuse")
    assert f"{len(own)} poses computed of its raw samples\n" in capsys.readouterr().out
    assert not [*(tmp_path / "fused").glob("*-raw.csv")]
    others = {"seq", "number", "missing", "t_ns", "time_utc"}  # of another message
    for rows in (own, computed):
        for row in rows:
            for name in others & row.keys():
                del row[name]
    assert own == computed


def test_samples_in_runs_are_fused_as_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    """With messages lost, twice, damaged and of another kind among them."""
    life = followed().live(400)
    life.order(lib.COMMAND_TARE, 0)
    life.live(300)
    contents = [*life.contents]
    contents[500:504] = []
    contents[700:700] = contents[695:700]
    contents[900] = contents[900][:-1] + b"\xff"
    capture = tmp_path / "of_a_uart.bin"
    capture.write_bytes(b"\0" + b"".join(map(encode_frame, contents)))
    in_runs = poses(capture, tmp_path / "runs", "--fuse")
    monkeypatch.setattr(fused, "RUN_MIN", 10**6)
    assert poses(capture, tmp_path / "one", "--fuse") == in_runs
    assert any("gap" in row["flags"] for row in in_runs)
    capsys.readouterr()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rate_hz", [20, 57, 120, 900])
def test_those_of_other_rates_hold_what_they_state(
    hand: Motion, rate_hz: int, tmp_path: Path
) -> None:
    rows = poses(table(hand, rate_hz, tmp_path / "a.csv"), tmp_path, "--fuse")
    assert len(rows) == pytest.approx(SECONDS * min(rate_hz, 100), abs=8)
    times_s = (column(rows, "t_device_us") - foreign_log.FIRST_US) * 1e-6
    found = np.stack([column(rows, f"q_{axis}") for axis in "wxyz"], axis=1)
    errors = scoring.errors_at(times_s, found, hand)
    tilt, heading = (column(rows, f"{name}_sigma_deg") for name in ("tilt", "heading"))
    late = (times_s > SETTLED_S) & (times_s < SECONDS - 0.1)
    assert np.mean(np.abs(errors.inclination) < OF_TILT * tilt, where=late) > 0.95
    known = late & np.isfinite(heading)
    assert known.sum() > 0.5 * late.sum()
    assert np.mean(np.abs(errors.heading) < OF_HEADING * heading, where=known) > 0.95
    assert np.sqrt(np.mean(errors.inclination**2, where=late)) < 2.0


def test_too_few_samples_a_second_are_told(
    hand: Motion, tmp_path: Path, capsys: Said
) -> None:
    slow = table(hand, 10, tmp_path / "slow.csv")
    assert cli.main(["export", str(slow), "--fuse", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "10 samples a second are too few; 20 are needed" in said
    assert not [*tmp_path.glob("*-pose.csv")]


def test_the_drift_without_a_magnetometer_is_a_number(
    hand: Motion, tmp_path: Path, capsys: Said
) -> None:
    six = table(hand, 100, tmp_path / "six.csv", has_mag=False)
    rows = poses(six, tmp_path, "--fuse")
    assert not np.isfinite(column(rows, "heading_sigma_deg")).any()
    said = capsys.readouterr().out
    assert "no magnetometer: its heading drifts by up to" in said
    assert "degrees a minute" in said
