# SPDX-License-Identifier: MIT
"""Motions of a virtual probe from logs, captures and exported tables."""

from __future__ import annotations

import io
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fakes import FakeProbe
from imud import cli
from imud.errors import ConfigError, FileError
from imud.params.trusted import known_to
from imud.recordings import motions
from imud.virtual import motion
from imud.virtual.boards import NANO
from imud.virtual.memory import memory_with
from imud.virtual.motion import MotionError
from log_files import records, write

ROOT = Path(__file__).resolve().parents[3]
LSB = {"acc_lsb": 0.001, "gyr_lsb": 0.002, "mag_lsb": 0.25}


def capture(path: Path, *probes: FakeProbe, without: range = range(0)) -> Path:
    """Hundred raw samples of each; those with these numbers never came. Every second
    one has a new reading of the magnetometer.
    """
    data = [probe.say("hello", raw_rate=200, sample_rate=200) for probe in probes]
    for number in range(100):
        for probe in probes:
            mag = (4, 8, number) if number % 2 == 0 else None
            counts = {"acc": (1, 2, number), "gyr": (3, 0, -number), "mag": mag}
            said = probe.say("raw", **counts)
            data += [] if number in without else [said]
    path.write_bytes(b"\0" + b"".join(data))
    return path


def test_counts_become_what_the_sensor_felt_before_any_calibration(
    tmp_path: Path,
) -> None:
    probe = FakeProbe(**LSB)
    found = motions.load(capture(tmp_path / "uart.bin", probe))
    felt = found.motion
    assert (len(felt), felt.rate_hz) == (100, pytest.approx(200.0))
    assert felt.acc[-1] == pytest.approx([0.001, 0.002, 0.099])
    assert felt.gyr[-1] == pytest.approx([0.006, 0.0, -0.198])
    assert felt.mag[-1] == pytest.approx([1.0, 2.0, 24.5])
    assert found.probe == probe.name
    assert (found.filled, found.left_out_s) == (0, 0.0)


def test_short_gaps_are_filled_and_of_longer_ones_the_longest_stretch_is_taken(
    tmp_path: Path,
) -> None:
    file = capture(tmp_path / "a.bin", FakeProbe(**LSB), without=range(40, 45))
    found = motions.load(file)
    assert (len(found.motion), found.filled) == (100, 5)
    assert found.motion.acc[:, 2] == pytest.approx(0.001 * np.arange(100))
    assert "5 missing samples filled in" in motions.words_of(file, found)
    file = capture(tmp_path / "b.bin", FakeProbe(**LSB), without=range(30, 55))
    found = motions.load(file)
    assert len(found.motion) == 45
    assert found.motion.acc[0, 2] == pytest.approx(0.055)
    assert found.left_out_s == pytest.approx(29 * 0.005)
    assert "0.1 s across gaps left out" in motions.words_of(file, found)


def test_of_several_probes_one_is_named(tmp_path: Path) -> None:
    left, right = FakeProbe(**LSB), FakeProbe(**LSB, probe_id=bytes(range(8)))
    one, other = (
        capture(tmp_path / f"{n}.bin", p) for n, p in enumerate((left, right))
    )
    both = tmp_path / "both.bin"
    both.write_bytes(one.read_bytes() + other.read_bytes())
    with pytest.raises(ConfigError, match=f"choose one with --probe: .*{left.name}"):
        motions.load(both)
    assert motions.load(both, right.name).probe == right.name
    with pytest.raises(ConfigError, match=f"no raw samples of nobody; .*{left.name}"):
        motions.load(both, "nobody")


def test_what_has_no_samples_says_what_to_do(tmp_path: Path) -> None:
    probe = FakeProbe()
    poses = tmp_path / "poses.bin"
    poses.write_bytes(b"\0" + probe.say("hello") + probe.poses(5))
    with pytest.raises(FileError, match=r"has no raw samples; set"):
        motions.load(poses)
    few = capture(tmp_path / "few.bin", FakeProbe(**LSB), without=range(10, 100))
    with pytest.raises(MotionError, match="10 raw samples in a row are too few"):
        motions.load(few)


def test_an_exported_table_is_a_motion_by_the_same_names(tmp_path: Path) -> None:
    put = [record for record in records(300) if record.topic == "raw"]
    assert len(put) > 20
    log = write(tmp_path, records(300))
    assert cli.main(["export", str(log), "--to", "csv", "--out", str(tmp_path)]) == 0
    (table,) = tmp_path.glob("*-raw.csv")
    header = table.read_text("utf-8").splitlines()[0].split(",")
    for names in motion.CSV_COLUMNS.values():
        assert {*names} <= {*header}
    felt = motions.load(table).motion
    assert felt.acc[0].tolist() == list(put[0].values["acc_m_s2"])
    with pytest.raises(ConfigError, match="leave out --probe"):
        motions.load(table, "left")


def test_a_field_log_moves_a_virtual_probe_as_it_was_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through the very image, which anybody may have changed; from stdin, too."""
    first, second = tmp_path / "first.bin", tmp_path / "second.bin"
    again = ["--stream", "--raw", "--fast", "--record"]
    assert cli.main(["sim", "nano", "--seconds", "12", *again, str(first)]) == 0
    stdin = SimpleNamespace(buffer=io.BytesIO(first.read_bytes()))
    monkeypatch.setattr("sys.stdin", stdin)
    assert cli.main(["sim", "nano", "--motion", "-", *again, str(second)]) == 0
    assert "samples at 200 Hz of" in capsys.readouterr().err
    before, after = motions.load(first).motion, motions.load(second).motion
    assert len(after) > len(before) - 250
    # What was felt first is repeated while the second probe starts.
    shift = min(range(300), key=lambda n: apart(before.gyr, after.gyr, n))
    assert apart(before.gyr, after.gyr, shift) < 0.02
    assert apart(before.acc, after.acc, shift) < 0.2


def apart(before: np.ndarray, after: np.ndarray, shift: int) -> float:
    """Rms difference where the second is that many samples behind."""
    count = min(len(before) - shift, len(after)) - 300
    return float(np.sqrt(np.mean((before[shift : shift + count] - after[:count]) ** 2)))


@pytest.mark.parametrize("board", ["nano", "f405"])
def test_the_params_of_a_log_are_in_force_on_a_board_of_its_kind(
    board: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records_ = known_to(0.02, 0.4)
    image, simulator = NANO.image, NANO.simulator
    memory_with(ROOT / image, ROOT / simulator, records_, tmp_path / "memory")
    first, second = tmp_path / "first.bin", tmp_path / "second.bin"
    options = ["--stream", "--raw", "--fast", "--record"]
    remembers = ["--eeprom", str(tmp_path / "memory"), "--seconds", "6"]
    assert cli.main(["sim", "nano", *remembers, *options, str(first)]) == 0
    assert motions.load(first).records == records_
    assert cli.main(["sim", board, "--motion", str(first), *options, str(second)]) == 0
    said = capsys.readouterr().err
    if board == "nano":
        assert "its params are active" in said
        assert motions.load(second).records == records_
    else:
        assert "its params are those of a nano and not used" in said
        assert motions.load(second).records == b""
